"""Texts of a report's page: each estimator's introduction, the methods, and how to cite."""

from collections.abc import Iterable
from dataclasses import fields
from typing import Any

import pandas as pd

from cooploc.analysis.formats import count_of
from cooploc.analysis.metrics.compare import FAR
from cooploc.analysis.metrics.consistency import OVER_CONFIDENT
from cooploc.analysis.metrics.errors import SENSES
from cooploc.analysis.report.run_numbers import FLOORED, Numbers, trial_counts
from cooploc.analysis.report.tables import fill_template, read_toml, words
from cooploc.estimators import configure, make
from cooploc.estimators.errors import BadInput
from cooploc.estimators.listing import setting_kind
from cooploc.estimators.registry import parse, shorten_labels, source_of


def anchors_of(estimators: Iterable[Any]) -> dict[str, str]:
    """Return the anchor of each estimator's introduction."""
    return {str(label): f"estimator-{i}" for i, label in enumerate(estimators, 1)}


def introduce_estimators(rows: pd.DataFrame) -> list[dict[str, Any]]:
    """Return an introduction of each method, in the order in which they ran; no code that is not built in runs."""
    methods: dict[str, list[dict[str, str]]] = {}
    for label, anchor in anchors_of(rows["estimator"].unique()).items():
        method, _, given = label.partition("[")
        given = given.removesuffix("]").replace(",", ", ")
        one = {"label": label, "anchor": anchor, "given": given, "standing": setting_kind(label)}
        methods.setdefault(method, []).append(one)
    return [_introduce(name, ones, rows) for name, ones in methods.items()]


def _introduce(name: str, configurations: list[dict[str, str]], rows: pd.DataFrame) -> dict[str, Any]:
    rows = rows[rows["estimator"].isin([one["label"] for one in configurations])]
    senses = " or ".join(rows[SENSES].dropna().unique()) if SENSES in rows else ""
    out = {"configurations": configurations, "senses": senses, "knows": _known_readings(rows)}
    out["name"] = shown = shorten_labels(name)
    try:
        made = make(name) if configure(name).builtin else None
    except BadInput:  # it is no longer known
        made = None
    if made is None:
        about = f"Not built in{f': {parse(name)[0]}' * (shown != name)}."
        return {**out, "about": about, "source": "", "defaults": {}}
    values = {one.name: getattr(made, one.name) for one in fields(made) if one.init and one.name != "uses"}
    texts = {key: f"{v:g}".replace("inf", "∞") if isinstance(v, float) else str(v) for key, v in values.items()}
    about = (type(made).__doc__ or "").strip().partition("\n")[0]
    return {**out, "about": about, "source": source_of(type(made)), "defaults": texts}


def _known_readings(rows: pd.DataFrame) -> str:
    """Return which readings reach a robot that runs it."""
    if "offline" in rows and rows["offline"].eq(True).any():
        return "every reading of every robot, of later ticks too: a bound that no robot could run"
    if rows["bound"].eq(True).any():
        return "every reading of every robot: a bound on all others in a simulated world"
    if rows["centralised"].eq(True).any():
        return "every reading of every robot, on one computer"
    return f"its own readings, and {'what teammates send' if rows['messages'].gt(0).any() else 'nothing of teammates'}"


def methods(until_decided: bool) -> dict[str, str]:
    """Return terms and what they mean, in a run of a fixed number of trials or in one until decided."""
    known = read_toml("page/methods.toml")
    terms = {term: text.format(far=FAR, floored=FLOORED) for term, text in known["terms"].items()}
    return {**terms, **known["until_decided"], "Decided": words("captions")["stopped"]} if until_decided else terms


def bibtex(version: str, commit: str | None) -> str:
    """Return a BibTeX entry for cooploc in the version that ran."""
    return fill_template("cooploc.bib.j2", version=version, commit=commit)


def paragraph(numbers: Numbers) -> str:
    """Return the methods of a run, in sentences that a paper can use."""
    table, manifest = numbers.table, numbers.kept.manifest
    text = fill_template(
        "paragraph.txt.j2",
        estimators=count_of(table["estimator"].nunique(), "estimator"),
        scenarios=count_of(table["scenario"].nunique(), "scenario"),
        baselines=" or ".join(dict.fromkeys(table["baseline"])),
        comparisons=count_of(int(table["p"].notna().sum()), "comparison"),
        trials=trial_counts(table),
        manifest=manifest,
        centralised=table["centralised"].any(),
        until_decided=bool(numbers.kept.looks),
        over_confident=f"{OVER_CONFIDENT:g}",
    )
    return text.replace("\n", " ").strip()
