"""What changed from one run to another: paired by trial where both ran on the same streams, else unpaired."""

from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.execution.provenance import version_changes
from cooploc.analysis.execution.run_directory import StoredRun
from cooploc.analysis.formats import Format, change, count, interval, metres, microseconds, ratio
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.compare import summarize
from cooploc.analysis.metrics.consistency import consistency
from cooploc.analysis.metrics.errors import trial_means
from cooploc.analysis.metrics.statistics import Interval
from cooploc.analysis.report.tables import Table, TableColumn, number_column, text_column

SETTINGS = ("seed", "data", "source", "commit", "cpu")
ENDS, FAILED = ("change_low", "change_high"), ("failed_a", "failed_b")
EXACT = ("mse", "anees", "coverage95")
COLUMNS = {
    "scenario": "the scenario's label",
    "estimator": "the estimator's label",
    "pairing": "paired (by trial), unpaired, or the only run that has it",
    "trials": "trials that are compared; if unpaired, those of the run with fewer",
    "equal": "trials whose errors are bit-equal",
    "rmse_a": "RMSE [m] of those trials in the first run",
    "rmse_b": "and in the second",
    "change": "RMSE of the second over that of the first, minus 1",
    "change_low": "its 95 % interval",
    "change_high": "",
    "anees_a": "ANEES of those trials in the first run",
    "anees_b": "and in the second",
    "consistency_a": "the flag, over all trials of the first run",
    "consistency_b": "and of the second",
    "bytes_a": "bytes per robot and tick",
    "bytes_b": "",
    "seconds_a": "seconds per robot and tick",
    "seconds_b": "",
    "failed_a": "trials that failed",
    "failed_b": "",
}


def changes(a: StoredRun, b: StoredRun) -> pd.DataFrame:
    """One row per (scenario, estimator) of either run, with `COLUMNS`.

    Trials are paired where their number and the hash of their stream are the same. Where no trial of a scenario is,
    the two runs are independent samples, and the interval is that of unpaired ones. Where only some are, only those
    count.
    """
    groups = [dict(list(kept.rows.groupby(["scenario", "estimator"], sort=False))) for kept in (a, b)]
    tables = [_summary(kept) for kept in (a, b)]
    rows = []
    for key in dict.fromkeys((*groups[0], *groups[1])):
        scenario, estimator = key
        mine = [group.get(key) for group in groups]
        both: dict[str, Any] = {"scenario": scenario, "estimator": estimator}
        for name, table in zip("ab", tables, strict=True):
            both |= {f"{column}_{name}": v for column, v in table.get(key, {}).items()}
        if mine[0] is None or mine[1] is None:
            rows.append({**both, "pairing": f"only in the {'second' if mine[0] is None else 'first'} run"})
        else:
            rows.append({**both, **_change(mine[0], mine[1])})
    return pd.DataFrame(rows, columns=list(COLUMNS))


def settings(a: StoredRun, b: StoredRun) -> list[str]:
    """Differences of the two manifests, one line each."""
    one, other = a.manifest, b.manifest
    lines = [f"{key}: {one[key]} before, {other[key]} after" for key in SETTINGS if one[key] != other[key]]
    lines += [f"{name}: {before} before, {after} after" for name, before, after in version_changes(one, other)]
    worlds = [s for s, p in one["scenarios"].items() if other["scenarios"].get(s, p) != p]
    return lines + [f"{scenario}: its parameters differ" for scenario in worlds]


def sentences(found: pd.DataFrame) -> list[str]:
    """A summary of the changes."""
    both = found[found["trials"].notna()]
    paired = both[both["pairing"] == "paired"]
    same = paired[(paired["equal"] == paired["trials"]) & (paired["trials"] > 0)]
    lines = [f"{len(same)} of {len(both)} (scenario, estimator) are bit-equal in every trial that was compared."]
    known = both[both["change_low"].notna() & ~both.index.isin(same.index)]
    up, down = known[known["change_low"] > 0], known[known["change_high"] < 0]
    if len(known):
        lines.append(
            f"Of the {len(known)} others with an interval, RMSE grew in {len(up)}, fell in {len(down)}, and did not "
            f"change significantly in {len(known) - len(up) - len(down)}; the intervals are 95 % and not adjusted: "
            f"about {0.05 * len(known):.1f} would exclude 0 by chance alone."
        )
    unpaired = both[both["pairing"] == "unpaired"]
    if len(unpaired):
        lines.append(
            f"Not paired, because the hashes of their streams differ: {len(unpaired)}; their intervals are those of "
            f"independent samples, and wider."
        )
    flags = both[both["consistency_a"] != both["consistency_b"]]
    lines += [
        f"{row['scenario']}, {row['estimator']}: {row['consistency_a']} over all trials before, {row['consistency_b']} "
        "after."
        for row in flags.to_dict("records")
    ]
    alone = found[found["trials"].isna()]
    lines += [f"{where}: {len(part)} (scenario, estimator)." for where, part in alone.groupby("pairing", sort=False)]
    return lines


def table(found: pd.DataFrame) -> Table:
    """The changes for people and programs."""
    columns = (
        text_column("scenario"),
        text_column("estimator", second_line=True),
        *_before_after("RMSE [m]", "rmse", metres),
        number_column("change", of=("same", "change"), form=lambda same, share: "0 %" if same else change(share)),
        number_column(
            "95 %",
            *ENDS,
            of=("same", *ENDS),
            form=lambda same, *ends: "" if same else interval(change)(*ends),
            second_line=True,
        ),
        *_before_after("ANEES", "anees", ratio),
        *_before_after("bytes", "bytes", count, priority=1),
        *_before_after("µs", "seconds", microseconds, priority=2),
        number_column("trials", form=count),
        text_column("", "pairing", "equal", "failed_a", "failed_b", of=("same", "pairing", *FAILED), form=_remark),
    )
    rows = found.assign(same=found["equal"] == found["trials"]).to_dict("records")
    return Table("changes", "What changed", columns, rows)


def _before_after(head: str, key: str, form: Format, priority: int = 0) -> tuple[TableColumn, TableColumn]:
    before = number_column(f"{head}\nbefore", f"{key}_a", form=form, priority=priority)
    return before, number_column(f"{head}\nafter", f"{key}_b", form=form, second_line=True, priority=priority)


def _remark(same: bool, pairing: str, before: float, after: float) -> str:
    failed = f", failed {count(before)} before, {count(after)} after" if before > 0 or after > 0 else ""
    return ("bit-equal" if same else pairing) + failed


def _summary(kept: StoredRun) -> dict[Any, dict[str, Any]]:
    """What is shown of each (scenario, estimator) beside the errors."""
    table = summarize(kept.rows)
    table["consistency"] = consistency(table)
    wanted = ["rmse", "anees", "consistency", "bytes", "seconds", "failed"]
    return {(row["scenario"], row["estimator"]): {k: row[k] for k in wanted} for row in table.to_dict("records")}


def _change(a: pd.DataFrame, b: pd.DataFrame) -> dict[str, Any]:
    before, after = (trials for part in (a, b) for trials in trial_means(part).values())
    both = before.add_suffix("_a").join(after.add_suffix("_b"), how="inner")
    pairs = both[both["stream_a"] == both["stream_b"]]
    streams = [set(part["stream"]) for part in (a, b)]
    if streams[0] & streams[1]:
        x, y = pairs["mse_a"].to_numpy(float), pairs["mse_b"].to_numpy(float)
        change = statistics.change(x, y)
        equal = np.logical_and.reduce([_same(pairs[f"{name}_a"], pairs[f"{name}_b"]) for name in EXACT])
        counts = {"pairing": "paired", "trials": len(pairs), "equal": int(equal.sum())}
        means = pairs[["anees_a", "anees_b"]].mean().to_dict()
    else:
        x, y = before["mse"].to_numpy(float), after["mse"].to_numpy(float)
        change = _unpaired(x, y)
        counts = {"pairing": "unpaired", "trials": min(len(x), len(y)), "equal": 0}
        means = {"anees_a": before["anees"].mean(), "anees_b": after["anees"].mean()}
    values = dict(zip(("change", "change_low", "change_high"), change, strict=True))
    return {**counts, **means, "rmse_a": _root(x), "rmse_b": _root(y), **values}


def _unpaired(x: Any, y: Any) -> Interval:
    """RMSE ratio minus 1 of two independent samples: the square-and-add limits of Zou & Donner (2008) on logarithms."""
    (a, a_low, a_high), (b, b_low, b_high) = (statistics.log_contrast(v[:, None], np.array([0.5])) for v in (x, y))
    low = b - a - np.hypot(b - b_low, a_high - a)
    high = b - a + np.hypot(b_high - b, a - a_low)
    return Interval(*(float(np.expm1(end)) for end in (b - a, low, high)))


def _same(a: "pd.Series[Any]", b: "pd.Series[Any]") -> Any:
    x, y = a.to_numpy(float), b.to_numpy(float)
    return (x == y) | (np.isnan(x) & np.isnan(y))


def _root(mse: Any) -> float:
    return float(np.sqrt(mse.mean())) if len(mse) else float("nan")
