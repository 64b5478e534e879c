"""Reproduce trials of a run or of a report, which embeds a sample of them, and compare them bit by bit."""

import hashlib
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.execution.provenance import fingerprint, plugins, provenance, version_changes
from cooploc.analysis.execution.run_directory import (
    FORMAT,
    MANIFEST,
    PARTS,
    RECEIPTS,
    StoredRun,
    parse_json,
    read_run,
    write_json,
)
from cooploc.analysis.execution.workers import Task, compute_task
from cooploc.estimators import configure, make
from cooploc.estimators.errors import BadInput
from cooploc.estimators.label_syntax import parse
from cooploc.estimators.plugin_files import is_file
from cooploc.scenarios import resolve
from cooploc.scenarios.scenario import split_family

PAGE = "index.html"
EACH, MANY = 3, 20  # trials that a report embeds of every scenario; of more scenarios it embeds one trial each
VALUES: tuple[str, ...] = ("ticks", "mse", "mean_error", "median_error", "max_error", "final_error")
VALUES += ("anees", "coverage95", "diverged", "pose_nees", "messages", "bytes")


def sample(run: StoredRun) -> list[dict[str, Any]]:
    """Return digests and RMSE of every estimator in a few trials of each scenario, drawn by the scenario's name."""
    out, each = [], EACH if run.rows["scenario"].nunique() <= MANY else 1
    for scenario, part in run.rows.groupby("scenario", sort=False):
        trials = np.unique(part["trial"])
        drawn = np.random.default_rng(list(hashlib.sha256(str(scenario).encode()).digest())).permutation(trials)[:each]
        for (estimator, trial), rows in part[part["trial"].isin(drawn)].groupby(["estimator", "trial"], sort=False):
            out.append({"scenario": scenario, "estimator": estimator, "trial": int(str(trial)), **_fingerprint(rows)})
    return out


def load(path: Path) -> dict[str, Any]:
    """Return what a report embeds, or a run would embed in its report: `manifest` and `sample`."""
    if (path / PARTS).is_dir():
        return embed(read_run(path))
    file = path / PAGE if path.is_dir() else path
    try:
        page = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise BadInput(f"{file} cannot be read: name a run's directory, a report's, or its page") from None
    found = re.search(r'<script type="application/json" id="manifest">(.*?)</script>', page, re.DOTALL)
    content = parse_json(found[1], f"what {file} embeds") if found else {}
    if not content.get("sample"):
        what = "trials" if found else "manifest"
        raise BadInput(f"{file} embeds no {what}: make the report again with cooploc report")
    return content


def embed(run: StoredRun) -> dict[str, Any]:
    """Return what a page embeds, which `load` reads: the manifest and a sample of the trials."""
    return {"format": FORMAT, "manifest": run.manifest, "sample": sample(run)}


def rerun(embedded: dict[str, Any], trials: int, data: Path | None = None, trust: bool = False) -> pd.DataFrame:
    """Run `trials` of the embedded trials again, spread over the scenarios, each with all of its estimators.

    Columns: scenario, estimator, trial, `equal`, RMSE [m] `before` and `after`, `remark`.
    """
    drawn = _draw(embedded["sample"], trials)
    named = [parse(one["estimator"])[0] for wanted in drawn.values() for one in wanted]
    named += [split_family(parse(scenario)[0])[0] for scenario, _ in drawn]
    files = list(dict.fromkeys(name.rpartition(":")[0] for name in named if is_file(name)))
    if files and not trust:
        raise BadInput(
            f"this would run code that the report names, in {' and '.join(files)}: read it, then repeat with --trust, "
            "in Python trust=True"
        )
    for label in {one["estimator"] for wanted in drawn.values() for one in wanted}:
        make(label)  # an unknown name is bad input, not a failed trial
    run = embedded["manifest"]
    limit, seed, isolate = float(run["study"].get("time_limit", 600.0)), int(run["seed"]), run.get("isolated", True)
    out = []
    for (scenario, trial), wanted in drawn.items():
        names = tuple(configure(one["estimator"]) for one in wanted)
        task = Task(resolve(scenario, data), range(trial, trial + 1), seed, names, limit, isolate=isolate)
        parts = {part.key.estimator: part.frame for part in compute_task(task)}
        out += [_compare_trial(one, parts[one["estimator"]]) for one in wanted]
    return pd.DataFrame(out)


# ---- confirmations, which lie in a run's directory and hold as long as nothing in it changes

CONFIRMED = "confirmed.json"


def confirm(folder: Path, found: pd.DataFrame) -> None:
    """Record that trials of a run came out bit-equal, once for every machine and choice of trials."""
    cells = found[["scenario", "estimator", "trial"]].sort_values(["scenario", "estimator", "trial"]).values.tolist()
    where = {key: value for key, value in provenance().items() if key != "commit"}
    record = {"cells": cells, **where}
    records = [one for one in confirmations(folder) if one != record]
    write_json(folder / CONFIRMED, {"run": _state(folder), "confirmed": [*records, record]})


def confirmations(folder: Path) -> list[dict[str, Any]]:
    """Return what `confirm` recorded of the run as it is now: `cells`, its (scenario, estimator, trial), and where."""
    file = folder / CONFIRMED
    content: dict[str, Any] = parse_json(file.read_bytes(), str(file)) if file.is_file() else {}
    return list(content["confirmed"]) if content.get("run") == _state(folder) else []


def _state(folder: Path) -> str:
    """Return a hash over a run's manifest and its receipts, which have the hashes of its parts."""
    manifest = hashlib.sha256((folder / MANIFEST).read_bytes()).hexdigest()
    return hashlib.sha256((manifest + fingerprint(folder / RECEIPTS)).encode()).hexdigest()


def digest(rows: pd.DataFrame) -> str:
    """Return a hash of every number of some rows that a clock did not measure."""
    rows, bits = rows.sort_values(["trial", "robot"], kind="stable"), hashlib.sha256()
    for column in VALUES:
        bits.update(rows[column].to_numpy(float).astype("<f8").tobytes())
    return bits.hexdigest()


def differences(embedded: dict[str, Any], labels: Iterable[str] = ()) -> list[str]:
    """Return what differs here from where the report was made: these estimators, libraries, cooploc, the processor."""
    then, here = embedded["manifest"], provenance()
    files, imports = plugins(map(configure, labels))
    known, imported = (then.get(what, {}) for what in ("files", "imports"))
    unlike = [f"{name} is another version" for name, now in files.items() if known.get(name, now) != now]
    for name, now in imports.items():
        before = imported.get(name, now)
        changed = [one for one in now if before.get(one) != now[one]]
        unlike += [f"{name} uses {one} {before.get(one)} there, {now[one]} here" for one in changed]
    unlike += [f"{name} {before} there, {now} here" for name, before, now in version_changes(then, here)]
    unlike += [f"{what} differs" for what in ("source", "cpu") if then.get(what) != here[what]]
    used = then.get("instructions", {})  # which earlier versions did not note
    return unlike + [
        f"{name} uses other instructions" for name, now in here["instructions"].items() if used.get(name, now) != now
    ]


def _draw(embedded: list[dict[str, Any]], trials: int) -> dict[tuple[str, int], list[dict[str, Any]]]:
    """Return so many (scenario, trial), from every scenario one before a second from any."""
    groups: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for one in embedded:
        groups.setdefault((one["scenario"], one["trial"]), []).append(one)
    turn = Counter[str]()

    def order(key: tuple[str, int]) -> tuple[int, bytes]:
        turn[key[0]] += 1
        return turn[key[0]], hashlib.sha256(repr(key).encode()).digest()

    return {key: groups[key] for key in sorted(groups, key=order)[:trials]}


def _compare_trial(one: dict[str, Any], frame: pd.DataFrame) -> dict[str, Any]:
    now = _fingerprint(frame)
    before, after = (float("nan") if it["rmse"] is None else float(it["rmse"]) for it in (one, now))
    equal = one["digest"] == now["digest"] and one["stream"] == now["stream"] and one["failure"] == now["failure"]
    if equal:
        remark = "failed in the same way" if one["failure"] else "bit-equal"
    elif one["failure"] != now["failure"]:
        remark = f"failure then: {one['failure'] or 'none'}; now: {now['failure'] or 'none'}"
    else:
        stream = "same" if one["stream"] == now["stream"] else "another"
        remark = f"{stream} stream; RMSE differs by {after - before:+.3g} m"
    named = {key: one[key] for key in ("scenario", "estimator", "trial")}
    return {**named, "equal": equal, "before": before, "after": after, "remark": remark}


def _fingerprint(rows: pd.DataFrame) -> dict[str, Any]:
    """Return a digest of every number of a trial that a clock did not measure, and its RMSE."""
    failure, mse, weight = rows["failure"].iloc[0], rows["mse"].to_numpy(float), rows["ticks"].to_numpy(float)
    rmse = float(np.sqrt((mse * weight).sum() / weight.sum())) if weight.sum() > 0 else None
    return {
        "stream": str(rows["stream"].iloc[0]),
        "digest": digest(rows),
        "rmse": rmse if rmse is not None and np.isfinite(rmse) else None,
        "failure": None if failure is None or failure != failure else str(failure),
    }
