"""Changes from one run to another: paired by trial where both ran on the same streams, else unpaired."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import stdtr, stdtrit

from cooploc.analysis.execution.provenance import version_changes
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.formats import Format, change, count, interval, metres, microseconds, ratio
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import summarize
from cooploc.analysis.metrics.consistency import consistency
from cooploc.analysis.metrics.errors import trial_means
from cooploc.analysis.metrics.statistics import Interval
from cooploc.analysis.report.tables import Table, TableColumn, number_column, text_column, words
from cooploc.estimators.label_syntax import shorten_labels

SAME, NOTHING, WORSE = "bit-equal", "no difference shown", ("worse", "fails more", "gone")  # verdicts
REMARKED = "verdict", "pairing", "failed_a", "failed_b"
SETTINGS = ("seed", "data", "source", "commit", "cpu")
MOST = 12  # changes that have a sentence of their own
EXACT = ["mse", "anees", "coverage95"]
COLUMNS = words("changes")  # name -> what it means


def changes(a: StoredRun, b: StoredRun) -> pd.DataFrame:
    """Return one row per (scenario, estimator) of either run, with `COLUMNS`.

    Trials are paired where their number and the hash of their stream are the same. Where no trial of a scenario is,
    the two runs are independent samples, and the interval is that of unpaired ones. Where only some are, only those
    count.
    """
    cell, shown = ["scenario", "estimator"], ["rmse", "anees", "consistency", "bytes", "seconds", "failed"]
    groups = [dict(list(kept.rows.groupby(cell, sort=False))) for kept in (a, b)]
    summaries = [summarize(kept.rows) for kept in (a, b)]
    tables = [one.assign(consistency=consistency(one)).set_index(cell)[shown].to_dict("index") for one in summaries]
    rows = []
    for key in dict.fromkeys((*groups[0], *groups[1])):
        row: dict[str, Any] = dict(zip(cell, key, strict=True))
        for name, summary in zip("ab", tables, strict=True):
            row |= {f"{column}_{name}": v for column, v in summary.get(key, {}).items()}
        there = [group[key] for group in groups if key in group]
        alone = {"pairing": f"only in the {'first' if key in groups[0] else 'second'} run"}
        rows.append({**row, **(_change(*there) if len(there) == 2 else alone)})
    found = pd.DataFrame(rows, columns=list(COLUMNS))
    found["p"] = statistics.holm(found["p"].to_numpy(float))
    found["verdict"] = [_verdict(row) for row in found.to_dict("records")]
    return found


def _verdict(row: Mapping[Any, Any]) -> str:
    if row["pairing"] == "only in the first run":
        return "gone"
    if row["failed_b"] > row["failed_a"]:
        return "fails more"
    if not row["trials"] > 0:
        return ""
    if row["equal"] == row["trials"]:
        return SAME
    return NOTHING if not row["p"] <= 1 - statistics.LEVEL else "worse" if row["change"] > 0 else "better"


def _change(a: pd.DataFrame, b: pd.DataFrame) -> dict[str, Any]:
    """Return the change of one scenario and estimator."""
    before, after = (trials for part in (a, b) for trials in trial_means(part).values())
    found: dict[str, Any] = {"pairing": "unpaired", "trials": min(len(before), len(after)), "equal": 0}
    measure: Callable[[Any, Any], Interval] = unpaired_change
    test: Callable[[Any, Any], float] = unpaired_p
    if set(a["stream"]) & set(b["stream"]):
        both = before.index.intersection(after.index)
        both = both[(before.loc[both, "stream"] == after.loc[both, "stream"]).to_numpy()]
        before, after = before.loc[both], after.loc[both]
        measure, test = statistics.FIXED.change, partial(statistics.FIXED.p_of_change, value=0.0)
        x, y = before[EXACT].to_numpy(float), after[EXACT].to_numpy(float)
        equal = ((x == y) | (np.isnan(x) & np.isnan(y))).all(1).sum()
        found = {"pairing": "paired", "trials": len(both), "equal": int(equal)}
    mse = [part["mse"].to_numpy(float) for part in (before, after)]
    for run, part, squares in zip("ab", (before, after), mse, strict=True):
        rmse = float(np.sqrt(squares.mean())) if len(squares) else np.nan
        found |= {f"anees_{run}": part["anees"].mean(), f"rmse_{run}": rmse}
    change = dict(zip(("change", "change_low", "change_high"), measure(*mse), strict=True))
    return found | change | {"p": np.nan if found["equal"] == found["trials"] else test(*mse)}


def unpaired_change(x: Any, y: Any) -> Interval:
    """Return RMSE ratio minus 1 of two independent samples of mean squared errors.

    Its limits are the square-and-add limits of Zou & Donner (2008) on logarithms.
    """
    (a, a_low, a_high), (b, b_low, b_high) = (
        statistics.FIXED.log_contrast(v[:, None], np.array([0.5])) for v in (x, y)
    )
    low = b - a - np.hypot(b - b_low, a_high - a)
    high = b - a + np.hypot(b_high - b, a - a_low)
    return Interval(*(float(np.expm1(end)) for end in (b - a, low, high)))


def unpaired_p(x: Any, y: Any) -> float:
    """Return the two-sided p against no change: Welch's test of the logarithms, scaled as their interval is."""
    found = unpaired_change(x, y)
    log, end = np.log1p(found.value), np.log1p(found.low if found.value > 0 else found.high)
    freedom = max(min(len(x), len(y)) - 1, 1)
    return float(2 * stdtr(freedom, -abs(log / (log - end)) * stdtrit(freedom, 0.975))) if log else 1.0


def settings(a: StoredRun, b: StoredRun) -> list[str]:
    """Return the differences of the two manifests, one line each."""
    one, other = a.manifest, b.manifest
    lines = [f"{key}: {one[key]} before, {other[key]} after" for key in SETTINGS if one[key] != other[key]]
    lines += [f"{name}: {before} before, {after} after" for name, before, after in version_changes(one, other)]
    worlds = [s for s, p in one["scenarios"].items() if other["scenarios"].get(s, p) != p]
    edited = [name for name, source in one["files"].items() if other["files"].get(name, source) != source]
    return [
        *lines,
        *(f"{s}: its parameters differ" for s in worlds),
        *(f"{name}: its source differs" for name in edited),
    ]


def sentences(found: pd.DataFrame) -> list[str]:
    """Return a summary of the changes."""
    both = found[found["trials"].notna()]
    same = both[(both["pairing"] == "paired") & (both["equal"] == both["trials"]) & (both["trials"] > 0)]
    lines = [f"{len(same)} of {len(both)} (scenario, estimator) are bit-equal in every trial that was compared."]
    known = both[both["change_low"].notna() & ~both.index.isin(same.index)]
    if len(known):
        lines += [f"{count} of them: {verdict}." for verdict, count in known["verdict"].value_counts().items()]
        for row in known.head(MOST).to_dict("records"):
            ends = interval(change)(row["change_low"], row["change_high"])
            of = f"{row['scenario']}, {shorten_labels(row['estimator'])}"
            lines.append(f"{of}: RMSE {change(row['change'])} ({ends}): {row['verdict']}.")
        lines.append("A change is shown where its p, adjusted by Holm over these rows, is at most 0.05.")
    if unpaired := (both["pairing"] == "unpaired").sum():
        lines.append(
            f"Not paired, because the hashes of their streams differ: {unpaired}; their intervals are those of "
            f"independent samples, and wider."
        )
    for row in both[both["consistency_a"] != both["consistency_b"]].to_dict("records"):
        flags = f"{row['consistency_a']} over all trials before, {row['consistency_b']} after"
        lines.append(f"{row['scenario']}, {shorten_labels(row['estimator'])}: {flags}.")
    alone = found.loc[found["trials"].isna(), "pairing"].value_counts(sort=False)
    return lines + [f"{text}: {number} (scenario, estimator)." for text, number in alone.items()]


def table(found: pd.DataFrame) -> Table:
    """Return the changes as a table for people and programs."""
    ends = ("change_low", "change_high")
    columns = (
        text_column("scenario"),
        text_column("estimator", second_line=True),
        *_before_after("RMSE [m]", "rmse", metres),
        number_column("change", of=("same", "change"), form=lambda same, share: "0 %" if same else change(share)),
        number_column("95 %", *ends, of=("same", *ends), second_line=True,
                      form=lambda same, *ends: "" if same else interval(change)(*ends)),
        *_before_after("ANEES", "anees", ratio),
        *_before_after("bytes", "bytes", count, priority=1),
        *_before_after("µs", "seconds", microseconds, priority=2),
        number_column("trials", form=count),
        text_column("", *REMARKED, "equal", of=REMARKED, form=_remark),
    )  # fmt: skip
    rows = found.assign(same=found["equal"] == found["trials"]).to_dict("records")
    return Table("changes", "What changed", columns, rows)


def _before_after(head: str, key: str, form: Format, priority: int = 0) -> tuple[TableColumn, TableColumn]:
    before = number_column(f"{head}\nbefore", f"{key}_a", form=form, priority=priority)
    return before, number_column(f"{head}\nafter", f"{key}_b", form=form, second_line=True, priority=priority)


def _remark(verdict: str, pairing: str, before: float, after: float) -> str:
    failed = f", failed {count(before)} before, {count(after)} after" if before > 0 or after > 0 else ""
    return ", ".join(filter(None, (verdict, pairing * (pairing != "paired")))) + failed
