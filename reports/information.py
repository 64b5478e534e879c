"""Values of reports/text/information.md.j2 from the runs of the studies `information` and `sensitivity`, and figures.

Floors take a few minutes.
"""

from pathlib import Path
from typing import Any

import pandas as pd

import cooploc as cl
from cooploc.analysis.formats import change, count_of, interval, join_words, metres, percent, ratio
from cooploc.analysis.plot import style
from cooploc.analysis.plot.studies import BETWEEN, OWN, PARAMETERS, RULES
from cooploc.analysis.report.tables import Table, interval_column, number_column, text_column
from cooploc.api import stored_run


def values(runs: Path, out: Path, data: Path) -> dict[str, Any]:
    """Return the words of the text, and draw both figures."""
    stored = cl.load_run(runs / "information")
    table = cl.information(stored)
    style.save(cl.plot.information(table), out / "information.svg")
    found = []
    for head, (first, *others) in cooperation_sentences(table):
        found += [f"- **{head}.** {first}", *(f"    - {text}" for text in others)]
    return {
        "trials": table["trials"].max(),
        "seed": stored_run(stored).manifest["seed"],
        "sentences": "\n".join(found),
        "table": _table(table).markdown(),
        "sensitivity": _sensitivity(cl.load_run(runs / "sensitivity"), out),
    }


def _sensitivity(stored: Any, out: Path) -> dict[str, Any]:
    table = cl.sensitivity(stored)
    style.save(cl.plot.sensitivity(table), out / "sensitivity.svg")
    found = []
    for name, text in dependence_sentences(table):
        head = PARAMETERS.get(name, name)
        found.append(f"- **{head[0].upper()}{head[1:]}.** {text}")
    return {"trials": table["trials"].max(), "seed": stored_run(stored).manifest["seed"], "sentences": "\n".join(found)}


def _table(table: pd.DataFrame) -> Table:
    columns = (
        text_column("own", form=OWN.__getitem__),
        text_column("between", form=BETWEEN.__getitem__),
        number_column("robots"),
        text_column("fusion, filter", "fusion", "filter", form=lambda *rule: RULES[rule][0]),
        interval_column("RMSE [m]", "rmse", metres),
        number_column("floor [m]", "floor", form=metres),
        interval_column("ANEES", "anees", ratio),
        text_column("consistency"),
        interval_column("against alone", "change", change),
    )
    caption = "RMSE and ANEES with 95 % intervals over trials; against alone: change of RMSE against the same filter."
    return Table("information", caption, columns, table.to_dict("records"))


OWN_WORDS = {
    "none": "no reading of their own",
    "doa": "the direction of arrival",
    "gradient": "the gradient",
    "rssi": "the four raw readings",
}
RULE_WORDS = {
    ("product", "particles"): "the product of beliefs",
    ("intersection", "particles"): "covariance intersection of particle filters",
    ("intersection", "Kalman"): "covariance intersection of Kalman filters",
    ("centralised", "Kalman"): "a Kalman filter of the whole team",
    ("bound", "MAP"): "the bound",
}
FILTERS = {"particles": "with particles", "Kalman": "with a Kalman filter", "MAP": "by the bound"}
NOTHING = 5e-4  # a change whose whole interval is smaller
BETWEEN_WORDS = {"rssi": "RSSI", "range": "ranges"}


def cooperation_sentences(table: pd.DataFrame) -> list[tuple[str, list[str]]]:
    """Return a heading and sentences for each own reading and team of more than one robot in `cl.information`.

    The first sentence says how large errors and floor are alone, each other one what a rule of fusion buys.
    """
    found = []
    for (own, robots), part in table[table["robots"] > 1].groupby(["own", "robots"], sort=False):
        texts = [_errors_alone(part)]
        for (fusion, kind), name in RULE_WORDS.items():
            rows = part[(part["fusion"] == fusion) & (part["filter"] == kind) & part["change"].notna()]
            if len(rows):
                records = rows.to_dict("records")
                over = [row for row in records if row["consistency"] == "over-confident"]
                means = [f"{BETWEEN_WORDS[row['between']]}: ANEES {ratio(row['anees'])}" for row in over]
                but = f", but is over-confident ({join_words(means)})" if over else ""
                texts.append(f"{name[0].upper()}{name[1:]} {join_words(map(effect_of_reading, records))}{but}.")
        found.append((f"{count_of(int(str(robots)), 'robot')} with {OWN_WORDS[str(own)]}", texts))
    return found


def _errors_alone(part: pd.DataFrame) -> str:
    """Return the errors and the floor without teammates, and how far the floor falls with them."""
    alone = part[part["between"] == "none"]
    errors = [f"{metres(row['rmse'])} m {FILTERS[row['filter']]}" for row in alone.to_dict("records")]
    text = f"Alone they err by {join_words(errors)}." if errors else "None of them was run alone."
    floor = alone["floor"].min()
    together = part[part["between"] != "none"].groupby("between", sort=False)["floor"].min().dropna()
    falls = [f"{change(low / floor - 1)} by {BETWEEN_WORDS[str(name)]}" for name, low in together.items()]
    if floor != floor or not falls:
        return text
    return f"{text} The floor, {metres(floor)} m alone, changes by {join_words(falls)}."


def effect_of_reading(row: dict[Any, Any]) -> str:
    """Return what a reading changes in the error, against the same filter alone, by its interval."""
    size, low, high = float(row["change"]), float(row["change_low"]), float(row["change_high"])
    by, ends = BETWEEN_WORDS[row["between"]], interval(change)(low, high)
    if max(abs(low), abs(high)) < NOTHING:
        return f"leaves the error as it is by {by}"
    if low != low:
        return f"changes the error by {change(size)} by {by} (no interval)"
    if row["decisive_trial"] == row["decisive_trial"]:
        return f"cannot be compared by {by} (trial {row['decisive_trial']:.0f} decides)"
    if low <= 0 <= high:
        return f"makes no difference that {count_of(int(row['trials']), 'trial')} show by {by} ({ends})"
    verb = "takes {} off the error" if size < 0 else "adds {} to the error"
    return f"{verb.format(percent(abs(size)))} by {by} ({ends})"


def dependence_sentences(table: pd.DataFrame, baseline: str = "arl") -> list[tuple[str, str]]:
    """Return two sentences for each parameter of `cl.sensitivity`: who depends on it most, who beats the baseline."""
    groups = table.groupby("parameter", sort=False)
    return [(str(name), f"{_extremes(part)} {_against_baseline(part, baseline)}") for name, part in groups]


def _extremes(part: pd.DataFrame) -> str:
    """Return whose largest error is the largest multiple of the smallest one, and whose is the smallest multiple."""
    error = part.groupby("estimator", sort=False)["rmse"]
    factor = (error.max() / error.min()).dropna()
    if len(factor) < 2:
        return "Fewer than two estimators were run."
    texts = []
    for name in (factor.idxmax(), factor.idxmin()):
        rows = part[(part["estimator"] == name) & part["rmse"].notna()].sort_values("rmse").to_dict("records")
        ends = [interval(metres)(row["rmse_low"], row["rmse_high"]) for row in (rows[0], rows[-1])]
        at = [
            f" ({both})" * bool(both) + f" at {row['value']:g}"
            for both, row in zip(ends, (rows[0], rows[-1]), strict=True)
        ]
        texts.append(f"{metres(rows[0]['rmse'])} m{at[0]} and {metres(rows[-1]['rmse'])} m{at[1]}")
    return f"{factor.idxmax()} depends on it most, with {texts[0]}; {factor.idxmin()} least, with {texts[1]}."


def _against_baseline(part: pd.DataFrame, baseline: str) -> str:
    """Return at how many values each estimator beats the baseline, and loses to it, by the paired interval."""
    texts = []
    for name, mine in part[part["estimator"] != baseline].groupby("estimator", sort=False):
        better, worse = (mine["change_high"] < 0).sum(), (mine["change_low"] > 0).sum()
        texts.append(
            f"{name} beats {baseline} at {better} and loses to it at {worse} of {count_of(len(mine), 'value')}"
        )
    return f"By paired intervals, {'; '.join(texts)}." if texts else f"Only {baseline} was run."
