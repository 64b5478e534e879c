"""A board of runs: a static site with a table for each study, groups of ties instead of ranks, and a page an estimator.

A row is shown only where `cooploc reproduce` has confirmed it on the run as it is now. Nothing that is not built in is
imported while the board is made; its licence and training are what its certificate says.
"""

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.metadata import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.execution.provenance import source_key
from cooploc.analysis.execution.reproduce import PAGE, confirmations, digest
from cooploc.analysis.execution.run_directory import Cell, StoredRun
from cooploc.analysis.formats import count, metres, microseconds, ratio
from cooploc.analysis.metrics.errors import TRAINED
from cooploc.analysis.metrics.ranking import board_letters
from cooploc.analysis.plot import style
from cooploc.analysis.report import html_page
from cooploc.analysis.report.result_tables import HASH, REMARK_FIELDS, may_be_ranked, remark
from cooploc.analysis.report.run_numbers import Numbers, numbers_of
from cooploc.analysis.report.tables import Row, Table, interval_column, number_column, text_column, words
from cooploc.estimators import configure, make
from cooploc.estimators.errors import BadInput, count_of
from cooploc.estimators.label_syntax import shorten_labels
from cooploc.estimators.registry import source_of
from cooploc.scenarios.studies.study import Study, stream_sentence


class BoardStudy(NamedTuple):
    """The runs of one study on the same streams."""

    numbers: Numbers
    folders: list[Path]
    rows: list[Row]  # of the board's table


@style.as_shipped()
def write(runs: Sequence[StoredRun], out: Path) -> Path:
    """Write the site into a directory; return the path of its first page.

    Raises:
        BadInput: a row of a run was not confirmed; says the command that does it.

    """
    studies = [_study(group) for group in _group(runs)]
    labels = sorted({row["estimator"] for one in studies for row in one.rows})
    pages, counter = {label: f"estimators/{html_page.safe_name(label)}.html" for label in labels}, itertools.count(1)
    (out / "estimators").mkdir(parents=True, exist_ok=True)
    shown = [_study_content(one, number, counter) for number, one in enumerate(studies, 1)]
    _write_page(out / PAGE, "Board", {"studies": shown, "wording": html_page.Wording(pages)}, "board.html.j2")
    for label, place in pages.items():
        mine = [_estimator_content(one, label, number) for number, one in enumerate(studies, 1)]
        about = next(_about(one, label) for one, rows in zip(studies, mine, strict=True) if rows["table"].rows)
        content = {"one": about, "studies": [rows for rows in mine if rows["table"].rows]}
        _write_page(out / place, label, content, "board_estimator.html.j2")
    return out / PAGE


def _write_page(path: Path, title: str, content: dict[str, Any], body: str) -> None:
    path.write_text(html_page.render({"title": title, **content}, body), encoding="utf-8")


# ------------------------------------------------------------------------------------------------ runs


def _group(runs: Sequence[StoredRun]) -> list[list[StoredRun]]:
    """Return the runs by study; those of one study on the same streams together, one until decided alone."""
    groups: list[list[StoredRun]] = []
    for run in runs:
        for group in groups:
            if not run.looks and not group[0].looks and _same_streams(group[0].manifest, run.manifest):
                group.append(run)
                break
        else:
            groups.append([run])
    return groups


def _same_streams(a: dict[str, Any], b: dict[str, Any]) -> bool:
    pairs = [{(s, *one) for s, trials in m["streams"].items() for one in trials.items()} for m in (a, b)]
    common = {one[:2] for one in pairs[0]} & {one[:2] for one in pairs[1]}
    alike = {one[:2] for one in pairs[0] & pairs[1]}
    return a["study"]["name"] == b["study"]["name"] and bool(common) and common == alike


def _study(group: list[StoredRun]) -> BoardStudy:
    """Return a study with every (scenario, estimator) of its runs once, and who reproduced it."""
    held, home = dict[Cell, pd.DataFrame](), dict[Cell, StoredRun]()
    times, differ = Counter[Cell](), Counter[Cell]()  # reproductions; runs with other bits
    for run in group:
        confirmed = _count_confirmations(run)
        for (scenario, estimator), rows in run.rows.groupby(["scenario", "estimator"], sort=False):
            cell = str(scenario), str(estimator)
            if cell not in held:
                held[cell], home[cell], times[cell] = rows, run, confirmed[cell]
            elif digest(rows) == digest(held[cell]):
                times[cell] += 1 + confirmed[cell]
            else:
                differ[cell] += 1
    cells = {s: cell for run in reversed(group) for s, cell in run.manifest["cells"].items()}
    rows = pd.concat(list(held.values()), ignore_index=True)
    numbers = numbers_of(group[0]._replace(manifest={**group[0].manifest, "cells": cells}, rows=rows))
    ranked = numbers.table[may_be_ranked(numbers.table)].groupby("scenario", sort=False)["estimator"]
    errors = {str(s): numbers.results.errors(str(s), list(names)) for s, names in ranked}
    letters = board_letters(errors, numbers.results.stopping)
    table: list[Row] = []
    for row in numbers.table.to_dict("records"):
        cell = row["scenario"], row["estimator"]
        known = {"reproduced": times[cell], "differ": differ[cell], **_origin(row, home[cell])}
        shown = {"estimator": _name(cell[1]), "group": letters.get(cell[0], {}).get(cell[1], "")}
        table.append({**row, **known, **shown})
    place = {str(s): i for i, s in enumerate(numbers.table["scenario"].unique())}
    table.sort(key=lambda row: (place[row["scenario"]], row["group"][-1:] or "~", row["group"][:1], row["estimator"]))
    return BoardStudy(numbers, [run.folder for run in group], table)


def _name(label: str) -> str:
    """Return an estimator's label as a board shows it: of one in a file, without the file's folders."""
    asked = configure(label).name
    return shorten_labels(label.replace(asked, asked.rpartition("/")[2], 1))


def _count_confirmations(run: StoredRun) -> Counter[Cell]:
    """Return how often each (scenario, estimator) of a run was confirmed; never 0."""
    found: Counter[Cell] = Counter()
    for record in confirmations(run.folder):
        found.update({(scenario, estimator) for scenario, estimator, _ in record["cells"]})
    for scenario, estimator in run.rows[["scenario", "estimator"]].drop_duplicates().itertuples(index=False):
        if (scenario, estimator) not in found:
            files = " --trust" if run.manifest["files"] else ""
            again = f"cooploc reproduce {run.folder} --trials {run.rows['scenario'].nunique()}{files}"
            raise BadInput(f"{run.folder}: nobody has reproduced {estimator} in {scenario} as the run is now; {again}")
    return found


def _origin(row: Row, run: StoredRun) -> dict[str, str]:
    """Return who made an estimator, and from what, in words; no code that is not built in runs."""
    label, manifest = row["estimator"], run.manifest
    asked, tuned_with = configure(label), manifest["study"].get("tuned_with")
    out = {"tuned": f"on seed {tuned_with}" if tuned_with is not None and label != asked.name else "no"}
    out["trained"] = row["certificate"].partition(TRAINED)[2] or "no"
    if asked.builtin:
        out |= {"source": source_of(type(make(label))), "hash": manifest["source"][:HASH]}
        return {**out, "licence": str(metadata("cooploc")["License-Expression"])}
    stated = manifest["certificates"].get(label, {})
    files = manifest["files"].get(source_key(asked.name), "")
    out |= {"source": stated.get("cites", ""), "hash": files[:HASH]}
    return {**out, "licence": stated.get("licence") or "not stated"}


# ------------------------------------------------------------------------------------------------ pages


def _confirmation_text(times: int, differ: int) -> str:
    return f"by {count_of(times, 'run')}" + f", {count_of(differ, 'run')} with other bits" * (differ > 0)


COLUMNS = (
    text_column("estimator"),
    text_column("scenario"),
    text_column("group"),
    interval_column("RMSE [m]", "rmse", metres),
    text_column("consistency"),
    text_column("remark", of=[{"consistency": "none"}.get(key, key) for key in REMARK_FIELDS], form=remark),
    number_column("ANEES", "anees", form=ratio, collapsed=True),
    number_column("bytes", form=count),
    number_column("µs", "seconds", form=microseconds),
    text_column("tuned"),
    text_column("trained"),
    text_column("source", collapsed=True),
    text_column("licence"),
    text_column("hash"),
    text_column("reproduced", of=("reproduced", "differ"), form=_confirmation_text),
)


def _table(one: BoardStudy, name: str, rows: list[Row], caption: str = "", without: tuple[str, ...] = ()) -> Table:
    columns = tuple(column for column in COLUMNS if column.head not in without)
    return Table(name, caption, columns, [{**row, "none": ""} for row in rows])


def _heading(one: BoardStudy) -> dict[str, Any]:
    manifest = one.numbers.kept.manifest
    study = manifest["study"]
    seed = "" if study.get("streams") else f", seed {manifest['seed']}"
    return {
        "name": f"{study['name']}{seed}",
        "about": study.get("about", ""),
        "sentence": stream_sentence(Study(**study), manifest["streams"]),
    }


def _study_content(one: BoardStudy, number: int, counter: Iterator[int]) -> dict[str, Any]:
    """Return a study as the first page shows it."""
    numbers = one.numbers._replace(table=one.numbers.table.assign(floor=np.nan))
    table = replace(
        _table(one, f"study-{number}", one.rows, words("captions")["board"]), marks={"data-consistency": "consistency"}
    )
    return {**_heading(one), "table": table, "figure": html_page.first_figure(numbers, counter)}


def _estimator_content(one: BoardStudy, label: str, number: int) -> dict[str, Any]:
    """Return the rows of an estimator in a study, as its page shows them."""
    rows = [row for row in one.rows if row["estimator"] == label]
    return {**_heading(one), "table": _table(one, f"study-{number}", rows, without=("estimator", "source"))}


def _about(one: BoardStudy, label: str) -> dict[str, Any]:
    """Return what is known of an estimator of a study."""
    rows = one.numbers.kept.rows
    about = html_page.introduce_estimators(rows[rows["estimator"].map(_name) == label].assign(estimator=label))[0]
    return {**about, "source": next(row["source"] for row in one.rows if row["estimator"] == label)}
