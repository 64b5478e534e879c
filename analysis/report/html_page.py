"""A run's report: one HTML page that needs no network, and beside it its tables and its trials as files."""

import base64
import hashlib
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from cooploc.analysis.claims.ledger import Ledger
from cooploc.analysis.execution.stored_run import Kept
from cooploc.analysis.report import colours, latex, run_files, svg, trial_files
from cooploc.analysis.report.html_table import html
from cooploc.analysis.report.page_content import content, numbers_of
from cooploc.analysis.report.reproduce import PAGE
from cooploc.analysis.report.tables import Table

SCRIPTS = "tables.js.j2", "filters.js.j2", "trials.js.j2", "copy.js.j2"
STYLES = "page.css.j2", "tables.css.j2", "parts.css.j2", "print.css.j2"


def write(kept: Kept, ledger: Ledger, out: Path) -> Path:
    """Write the page, its tables and its trials into a directory; returns the page's path.

    Raises:
        BadInput: estimators of one scenario ran on different streams.
        OSError: a file cannot be written.

    """
    numbers = numbers_of(kept)
    context = content(numbers, ledger)
    _write_tables(context.pop("tables"), context["title"], out)
    trials = trial_files.rmse_by_trial(numbers.table, numbers.results)
    trial_files.write(trials, out)
    folders = [*run_files.own_files(out, "tables", trial_files.FOLDER), *run_files.run_files(kept.folder, out)]
    page = out / PAGE
    page.write_text(render({**context, "trials": trial_files.compact(trials), "folders": folders}), encoding="utf-8")
    return page


def render(context: dict[str, Any]) -> str:
    """The page; everything that is not marked as safe is escaped."""
    environment = Environment(
        loader=FunctionLoader(_template), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.globals["html"] = html
    environment.policies["json.dumps_kwargs"] = {"sort_keys": True, "separators": (",", ":")}
    script, style = (Markup("".join(map(_template, names))) for names in (SCRIPTS, STYLES))  # our own files
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    body, shared = map(Markup, svg.shared_styles(environment.get_template("body.html.j2").render(**context)))
    day, night = map(Markup, colours.variables(body + shared))
    css = {"style": style, "shared": shared, "day": day, "night": night}
    page = environment.get_template("page.html.j2")  # its parts are escaped by their templates
    return page.render(**context, **css, body=body, script=script, script_hash=digest)


def _write_tables(tables: list[Table], title: str, out: Path) -> None:
    (out / "tables").mkdir(parents=True, exist_ok=True)
    for one in tables:
        for ending, written in (("tex", one.latex()), ("md", one.markdown()), ("csv", one.csv())):
            (out / "tables" / f"{one.name}.{ending}").write_text(written, encoding="utf-8")
    names = [one.name for one in tables]
    (out / "tables" / "all.tex").write_text(latex.document(names, title), encoding="utf-8")


def _template(name: str) -> str:
    return (files(__package__) / "page" / name).read_text(encoding="utf-8")
