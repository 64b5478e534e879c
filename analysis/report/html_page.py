"""A run's report: one HTML page that needs no network, and its tables as LaTeX, Markdown and CSV."""

import base64
import hashlib
import itertools
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from cooploc.analysis.claims import at_looks, family, multiverse, verdicts
from cooploc.analysis.claims.ledger import BASE, Ledger
from cooploc.analysis.claims.trial_table import collect
from cooploc.analysis.execution.stored_run import Kept
from cooploc.analysis.formats import counted
from cooploc.analysis.metrics import certificate_line, outliers
from cooploc.analysis.metrics.compare import compare
from cooploc.analysis.metrics.crlb import floors
from cooploc.analysis.metrics.decisions import with_decisions
from cooploc.analysis.metrics.pooling import notes
from cooploc.analysis.metrics.stopping import ANYTIME, FIXED
from cooploc.analysis.plot import style
from cooploc.analysis.report import claim_tables, latex, result_tables, summaries
from cooploc.analysis.report.experiments import Experiment, Numbers, experiment
from cooploc.analysis.report.failures import failures
from cooploc.analysis.report.methods import FLOORED, methods
from cooploc.analysis.report.reproduce import PAGE, embedded
from cooploc.analysis.report.tables import Table, numbers, words

LEGEND = (
    'A change is b/a - 1: negative where the error falls. "66 % more accurate" is judged as a change of -66 %; what '
    "the same interval means for a ratio of errors of 1.66, a change of -40 %, is said beside it. Each verdict, taken "
    "alone, is wrong in at most one of twenty repetitions of the run, so that of many some are wrong: how many are "
    "expected to be is said with them. It stands where that holds of all judged cases together (Holm). "
    "Readings: paper, as it stands; others as the ledger describes them. No verdict rests on one reading: the study "
    "readings runs all that the ledger declares, and cl.readings judges every claim in each."
)


def write(kept: Kept, ledger: Ledger, out: Path) -> Path:
    """Write the page and its tables into a directory; returns the page's path.

    Raises:
        BadInput: estimators of one scenario ran on different streams.
        OSError: a file cannot be written.

    """
    context = content(kept, ledger)
    (out / "tables").mkdir(parents=True, exist_ok=True)
    shown: list[Table] = context.pop("tables")
    for one in shown:
        for ending, written in (("tex", one.latex()), ("md", one.markdown()), ("csv", one.csv())):
            (out / "tables" / f"{one.name}.{ending}").write_text(written, encoding="utf-8")
    names = [one.name for one in shown]
    (out / "tables" / "all.tex").write_text(latex.document(names, context["title"]), encoding="utf-8")
    page = out / PAGE
    page.write_text(render(context), encoding="utf-8")
    return page


def render(context: dict[str, Any]) -> str:
    """The page; everything that is not marked as safe is escaped."""
    template = Environment(
        loader=FunctionLoader(_template), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    script, style = (Markup(_template(name)) for name in ("page.js.j2", "page.css.j2"))  # our own files
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return template.get_template("page.html.j2").render(**context, script=script, style=style, script_hash=digest)


def content(kept: Kept, ledger: Ledger) -> dict[str, Any]:
    """Everything that the page shows, and `tables`, all of its tables."""
    stopping = ANYTIME if kept.looks else FIXED
    table = compare(kept.rows, kept.baselines, full=True)
    table = table if kept.comparisons is None else with_decisions(table, kept.comparisons)
    table["floor"] = table["scenario"].map(floors(table["scenario"], kept.manifest["seed"], FLOORED))
    looks = style.looks(kept.rows["estimator"])
    numbers = Numbers(kept, table, collect(kept.rows, stopping), looks)
    counter = itertools.count()
    experiments = [experiment(name, plan, numbers, counter) for name, plan in kept.experiments.items()]
    readings = multiverse.sentences(multiverse.judge(ledger, kept.rows, stopping))
    answer = _answer(numbers, experiments, at_looks.judged(ledger, kept.rows, kept.looks), ledger, readings)
    versions, streams = _versions(kept), _streams(table)
    first = [answer[name] for name in ("where_table", "best_table", "confidence_table", "overview", "claims_table")]
    return {
        "title": f"cooploc: {kept.manifest['study']['name']}",
        "manifest": kept.manifest,
        "answer": answer,
        "experiments": experiments,
        "gaps": [f"{s}, {e}: {n} of the planned trials are missing" for (s, e), n in kept.gaps.items()]
        + [*kept.ignored],
        "unproven": [*certificate_line.remarks(table), *outliers.warnings(table)],
        "failures": failures(kept.rows),
        "notes": notes(kept.rows),
        "methods": methods(bool(kept.looks)),
        "versions": versions,
        "streams": streams,
        "embedded": embedded(kept),
        "tables": [*first, *(one for each in experiments for one in each.tables), versions, streams],
    }


def _answer(
    numbers: Numbers, experiments: list[Experiment], judged: pd.DataFrame, ledger: Ledger, readings: dict[str, str]
) -> dict[str, Any]:
    found = summaries.standings(numbers.table, numbers.results)
    ledgered = claim_tables.claims(judged, ledger.paper)
    return {
        "best": summaries.overall(found),
        "where_table": result_tables.where({one.name: one.found for one in experiments}),
        "best_table": result_tables.best(found),
        "confidence": summaries.confidence(numbers.table),
        "confidence_table": result_tables.confidence(numbers.table),
        "claims": _standing_claims(judged),
        "claims_table": ledgered,
        "claims_parts": claim_tables.by_claim(ledgered, judged, ledger, readings),
        "family": str(family.of(judged)),
        "overview": claim_tables.overview(verdicts.overview(judged), judged, ledger),
        "legend": LEGEND,
    }


def _standing_claims(judged: pd.DataFrame) -> str:
    """The claims as they stand, by verdict; one whose cases differ is named with their counts."""
    base = judged[judged["variant"] == BASE]
    alike: dict[str, list[str]] = {}
    mixed = []
    for claim, part in base.groupby("claim", sort=False):
        counts = part["verdict"].value_counts(sort=False)
        if len(counts) == 1:
            alike.setdefault(str(counts.index[0]), []).append(str(claim))
        else:
            mixed.append(f"{claim} ({', '.join(f'{count} {verdict}' for verdict, count in counts.items())})")
    parts = [f"{verdict}: {', '.join(alike[verdict])}" for verdict in verdicts.VERDICTS if verdict in alike]
    parts += [f"differs by case: {', '.join(mixed)}"] if mixed else []
    return f"Of {counted(base['claim'].nunique(), 'claim')}, as the paper states them, {'; '.join(parts)}."


def _versions(kept: Kept) -> Table:
    manifest = kept.manifest
    imported = {name: at for one in manifest.get("imports", {}).values() for name, at in one.items()}
    used = {**imported, **manifest["versions"], **{key: manifest[key] for key in ("commit", "source", "cpu", "seed")}}
    rows = [{"what": what, "version": value} for what, value in {**used, "recordings": manifest["data"]}.items()]
    columns = words("what"), words("version or hash", "version")
    return Table("versions", "What the bits depend on", columns, rows)


def _streams(table: pd.DataFrame) -> Table:
    columns = words("scenario"), numbers("trials"), words("stream")
    once = table.sort_values("trials", ascending=False, kind="stable").drop_duplicates("scenario").sort_index()
    return Table("streams", "Hashes of the streams: equal ones can be paired", columns, once.to_dict("records"))


def _template(name: str) -> str:
    return (files(__package__) / name).read_text(encoding="utf-8")
