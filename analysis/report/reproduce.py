"""A report can be checked: it embeds a sample of its trials, and how to run them again bit by bit. So can a run."""

import hashlib
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cooploc.analysis.execution.provenance import provenance
from cooploc.analysis.execution.run_directory import FOLDERS
from cooploc.analysis.execution.schemas import FORMAT, Newer, PageData, checked
from cooploc.analysis.execution.stored_run import Kept, read
from cooploc.analysis.execution.task import Task, measure
from cooploc.analysis.report.run_diff import other_versions
from cooploc.analysis.report.tables import Table, numbers, words
from cooploc.estimators import configure, make, parse
from cooploc.estimators.errors import BadInput
from cooploc.estimators.registry import is_file
from cooploc.scenarios import resolve
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.sealed import Damaged, seal

PAGE = "index.html"
EACH = 3  # trials that a report embeds of every scenario
VALUES: tuple[str, ...] = ("ticks", "mse", "mean_error", "median_error", "max_error", "final_error")
VALUES += ("anees", "coverage95", "diverged", "pose_nees", "messages", "bytes")


class Again(NamedTuple):
    """One trial of one estimator, run again."""

    scenario: str
    estimator: str
    trial: int
    equal: bool
    before: float  # RMSE [m]
    after: float
    remark: str


def sample(kept: Kept) -> list[dict[str, Any]]:
    """Of every scenario a few trials, drawn by its name: digests of what every estimator did there, and its RMSE."""
    out = []
    for scenario, part in kept.rows.groupby("scenario", sort=False):
        trials = np.unique(part["trial"])
        drawn = np.random.default_rng(list(hashlib.sha256(str(scenario).encode()).digest())).permutation(trials)[:EACH]
        for (estimator, _), rows in part[part["trial"].isin(drawn)].groupby(["estimator", "trial"], sort=False):
            out.append(
                {
                    "scenario": scenario,
                    "estimator": estimator,
                    "trial": int(rows["trial"].iloc[0]),
                    **_fingerprint(rows),
                }
            )
    return out


def load(path: Path) -> dict[str, Any]:
    """What a report embeds, or a run would embed in its report: `manifest` and `sample`.

    Raises:
        BadInput: it is neither a report nor a run of cooploc, or was made by a newer version.

    """
    if (path / FOLDERS[0]).is_dir():
        kept = read(path)
        return {"manifest": kept.manifest, "sample": sample(kept)}
    file = path / PAGE if path.is_dir() else path
    try:
        page = file.read_text(encoding="utf-8") if file.is_file() else None
    except (OSError, UnicodeDecodeError):
        page = None
    if page is None:
        raise BadInput(f"{file} cannot be read: name a run's directory, a report's, or its page")
    found = re.search(r'<script type="application/json" id="manifest">(.*?)</script>', page, re.DOTALL)
    again = "make the report again with cooploc report"
    if not found:
        raise BadInput(f"{file} embeds no manifest: {again}")
    try:
        embedded = checked(found[1], PageData)
    except Newer as e:
        raise BadInput(f"{file} was made by a newer version: it has {e}") from None
    except Damaged as e:
        raise BadInput(f"{file} embeds no manifest that can be read ({e}): {again}") from None
    if not embedded["sample"]:
        raise BadInput(f"{file} embeds no trials: {again}")
    return embedded


def embedded(kept: Kept) -> dict[str, Any]:
    """What a page embeds, which `load` reads: the manifest and a sample of the trials, with a checksum."""
    return seal({"format": FORMAT, "manifest": kept.manifest, "sample": sample(kept)})


def rerun(embedded: dict[str, Any], trials: int, data: Path | None = None, trust: bool = False) -> list[Again]:
    """Run `trials` of the embedded trials again, spread over the scenarios, each with all of its estimators.

    Raises:
        BadInput: none can be run: scenarios or estimators are not known here, recordings are missing, or a Python file
            would run without `trust`.

    """
    drawn = _drawn(embedded["sample"], trials)
    files = _files(drawn)
    if files and not trust:
        raise BadInput(
            f"this would run code that the report names, in {' and '.join(files)}: read it, then repeat with --trust"
        )
    for label in {one["estimator"] for wanted in drawn.values() for one in wanted}:
        make(label)  # an unknown name is bad input, not a failed trial
    out = []
    for (scenario, trial), wanted in drawn.items():
        limit = float(embedded["manifest"]["study"].get("time_limit", 600.0))
        names = tuple(configure(one["estimator"]) for one in wanted)
        seed = int(embedded["manifest"]["seed"])
        task = Task(resolve(scenario, data), range(trial, trial + 1), seed, names, limit)
        parts = {part.piece.estimator: part.frame for part in measure(task)}
        out += [_compared(one, parts[one["estimator"]]) for one in wanted]
    return out


def _files(drawn: dict[tuple[str, int], list[dict[str, Any]]]) -> list[str]:
    """The Python files that scenarios and estimators name."""
    scenarios = [split_family(parse(scenario)[0])[0] for scenario, _ in drawn]
    estimators = [parse(one["estimator"])[0] for wanted in drawn.values() for one in wanted]
    return list(dict.fromkeys(name.rpartition(":")[0] for name in (*scenarios, *estimators) if is_file(name)))


def differences(embedded: dict[str, Any]) -> list[str]:
    """What differs between this machine and the one where the report was made."""
    then, here = embedded["manifest"], provenance()
    unlike = [f"{name} {before} there, {now} here" for name, before, now in other_versions(then, here)]
    unlike += [f"{what} differs" for what in ("source", "cpu") if then.get(what) != here[what]]
    used = then.get("instructions", {})  # which earlier versions did not note
    return unlike + [
        f"{name} uses other instructions" for name, now in here["instructions"].items() if used.get(name, now) != now
    ]


def table(found: list[Again]) -> Table:
    """One row per trial and estimator."""
    columns = (
        words("scenario"),
        words("estimator", under=True),
        numbers("trial"),
        numbers("RMSE then [m]", "before", form=_exact),
        numbers("now [m]", "after", form=_exact, under=True),
        words("", "equal", "remark", of=("remark",)),
    )
    return Table("reproduced", "Trials that were run again", columns, [one._asdict() for one in found])


def _drawn(embedded: list[dict[str, Any]], trials: int) -> dict[tuple[str, int], list[dict[str, Any]]]:
    """So many (scenario, trial), from every scenario one before a second from any."""
    groups: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for one in embedded:
        groups.setdefault((one["scenario"], one["trial"]), []).append(one)
    turn: dict[str, int] = {}
    ordered = []
    for key in groups:
        turn[key[0]] = turn.get(key[0], 0) + 1
        ordered.append((turn[key[0]], hashlib.sha256(repr(key).encode()).digest(), key))
    return {key: groups[key] for _, _, key in sorted(ordered)[:trials]}


def _compared(one: dict[str, Any], frame: pd.DataFrame) -> Again:
    now = _fingerprint(frame)
    before, after = (float("nan") if it["rmse"] is None else float(it["rmse"]) for it in (one, now))
    equal = one["digest"] == now["digest"] and one["stream"] == now["stream"] and one["failure"] == now["failure"]
    if equal:
        remark = "bit-equal" if not one["failure"] else "failed in the same way"
    elif one["failure"] != now["failure"]:
        remark = f"failure then: {one['failure'] or 'none'}; now: {now['failure'] or 'none'}"
    elif one["stream"] != now["stream"]:
        remark = f"another stream; RMSE differs by {after - before:+.3g} m"
    else:
        remark = (
            f"same stream; RMSE differs by {after - before:+.3g} m" if after != before else "differs, RMSE does not"
        )
    return Again(one["scenario"], one["estimator"], one["trial"], equal, before, after, remark)


def _fingerprint(rows: pd.DataFrame) -> dict[str, Any]:
    """Of one trial of one estimator: a digest of every number that a clock did not measure, and the RMSE."""
    rows = rows.sort_values("robot", kind="stable")
    bits = hashlib.sha256()
    for column in VALUES:
        bits.update(rows[column].to_numpy(float).astype("<f8").tobytes())
    failure = rows["failure"].iloc[0] if "failure" in rows else None
    mse = rows["mse"].to_numpy(float)
    weight = rows["ticks"].to_numpy(float)
    rmse = float(np.sqrt((mse * weight).sum() / weight.sum())) if weight.sum() > 0 else None
    return {
        "stream": str(rows["stream"].iloc[0]),
        "digest": bits.hexdigest(),
        "rmse": rmse if rmse is not None and np.isfinite(rmse) else None,
        "failure": None if failure is None or failure != failure else str(failure),
    }


def _exact(metres: float) -> str:
    """With so many digits that a difference shows."""
    return "" if metres != metres else f"{metres:.9g}"
