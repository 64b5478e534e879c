"""The directory of a run: `manifest.json`, and one part per (scenario, estimator, range of trials).

Every file is written under a temporary name, flushed to the disk and renamed, so whatever is there is whole. A part is
bit-identical whenever it is computed; its receipt holds its hash, how many of its trials failed, and the time that was
measured, which is not bit-identical. `decisions.json` holds what a run until decided has decided.
"""

import hashlib
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from filelock import FileLock, Timeout
from pydantic import ValidationError

from cooploc.analysis.execution.certificates import with_certificates
from cooploc.analysis.metrics.errors import NOTE
from cooploc.analysis.metrics.sequential import Decision, looks
from cooploc.estimators.errors import BadInput
from cooploc.scenarios.studies.study import Study

FORMAT = 3  # of the JSON files: 2 had checksums in them, 1 less in the receipts; all are read
MANIFEST, DECISIONS, PARTS, RECEIPTS = "manifest.json", "decisions.json", "parts", "receipts"
NEEDED = ("study", "cells", "seed", "data", "scenarios", "streams", "versions", "source", "commit", "cpu")
MUST_MATCH = {  # in a run that goes on, and what the error says where it differs
    "seed": "another seed",
    "data": "other recordings",
    "versions": "other versions of the libraries",
    "source": "another version of cooploc",
    "instructions": "another kind of processor",
}
LISTED = 8  # runs below a directory that is none, at most
TEXT = ("scenario", "estimator", "stream", "senses", "failure", "traceback")  # columns
AT_ONCE = 200  # parts that are joined together
PART_NAME = re.compile(r"(.+--[0-9a-f]{8}--)(\d{5,9})-(\d{5,9})\.parquet")


# Files.


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file that is whole or not there: under a temporary name, flushed to the disk, renamed.

    Raises:
        OSError: it cannot be done; with the file's name, which not every library gives.

    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as e:
        raise OSError(e.errno, e.strerror or str(e), str(path)) from e
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Replace a JSON file; it states its format, and nan is written as null."""
    text = json.dumps(_finite({"format": FORMAT, **content}), indent=1) + "\n"
    replace_file(path, lambda file: file.write_text(text, encoding="utf-8"))


def read_json(path: Path) -> dict[str, Any]:
    """Return the content of a file that `write_json` wrote, in this version or an earlier one.

    Raises:
        BadInput: it is not what was written, or a newer version wrote it.

    """
    return parse_json(path.read_bytes(), str(path))


def parse_json(text: str | bytes, where: str) -> dict[str, Any]:
    """Return the JSON object of a text; `where` names it in an error.

    Raises:
        BadInput: as `read_json`.

    """
    try:
        content = json.loads(text)
        found = content["format"]
        newer = found > FORMAT
    except (ValueError, RecursionError, KeyError, TypeError) as e:
        raise BadInput(f"{where} is damaged ({' '.join(str(e).split())}): make it again") from None
    if newer:
        raise BadInput(f"{where} has format {found}, this version reads up to {FORMAT}: update cooploc")
    return dict(content)


def _finite(value: Any) -> Any:
    """Return a value with None for every number that JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


# Parts.


class PartKey(NamedTuple):
    """Which trials of which scenario and estimator a part holds."""

    scenario: str
    estimator: str
    trials: range

    @property
    def name(self) -> str:
        """The name of its file: readable, the same on every system, and unique by a digest of the labels."""
        return f"{self.stem}{self.trials.start:05d}-{self.trials.stop:05d}"

    @property
    def stem(self) -> str:
        """The name without the trials."""
        labels = "--".join(re.sub(r"[^A-Za-z0-9.=]+", "-", label).strip("-") for label in self[:2])
        digest = hashlib.sha256("\0".join(self[:2]).encode()).hexdigest()[:8]
        return f"{labels[:150]}--{digest}--"


class FoundParts(NamedTuple):
    """What a directory holds of one scenario and estimator."""

    intact: list[PartKey]  # which together hold each trial at most once
    damaged: list[PartKey]  # whose files are not what was written


class RunDir:
    """A directory of results that can be continued."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._seconds: dict[PartKey, float] = {}  # measured, of the parts whose hash was compared
        self._listing: dict[str, list[range]] | None = None  # of each stem the trials that have files

    @property
    def manifest(self) -> dict[str, Any]:
        """What the directory says it holds; empty where nothing was run into it yet.

        Raises:
            BadInput: the directory holds something else, a damaged manifest, or a newer format.

        """
        file = self.path / MANIFEST
        if not file.is_file():
            _refuse_foreign(self.path)
            return {}
        content = read_json(file)
        missing = [f"it has no {key!r}" for key in NEEDED if key not in content]
        try:
            Study(**content.get("study", {}))
        except (ValidationError, TypeError):
            missing.append("its study cannot be read")
        if missing:
            raise BadInput(f"{file} is damaged ({missing[0]}): name another directory with --out")
        return {"files": {}, "imports": {}, "certificates": {}, "instructions": {}, **content}

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs from writing here; the lock ends with its process, however that ends.

        Raises:
            BadInput: another process is writing here.

        """
        _refuse_foreign(self.path)  # before anything is written there
        self.path.mkdir(parents=True, exist_ok=True)
        lock = FileLock(self.path / ".lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise BadInput(f"another run is writing to {self.path}: wait for it, or name another with --out") from None
        try:
            yield
        finally:
            lock.release()

    def open(self, manifest: dict[str, Any]) -> None:
        """Begin or continue a run.

        Raises:
            BadInput: the directory holds a run of other settings.

        """
        for folder in (".", PARTS, RECEIPTS):
            for left in (self.path / folder).glob(".*.tmp"):  # of a process that was killed
                left.unlink()
        found = self.manifest
        self.write_manifest(_continue_manifest(self.path, found, manifest) if found else manifest)
        for folder in (PARTS, RECEIPTS):
            (self.path / folder).mkdir(parents=True, exist_ok=True)
        self._listing = None

    def write_manifest(self, manifest: dict[str, Any]) -> None:
        """Replace the manifest."""
        write_json(self.path / MANIFEST, {**manifest, "format": FORMAT})

    def write(self, key: PartKey, frame: pd.DataFrame, seconds: float) -> None:
        """Keep one part; it counts as done once it is there, and its receipt is there before it.

        Raises:
            OSError: it cannot be written: a full disk, no permission; names the file.

        """
        failed = int(frame.loc[frame["failure"].notna(), "trial"].nunique())

        def write(file: Path) -> None:
            frame.to_parquet(file, index=False)
            receipt = json.dumps({"sha256": _hash_of(file), "seconds": seconds, "failed": failed})
            replace_file(self._receipt_path(key), lambda temporary: temporary.write_text(receipt, encoding="utf-8"))

        replace_file(self._part_path(key), write)
        self._seconds[key] = seconds
        self._listing = None

    def parts(self, scenario: str, estimator: str, count: int) -> FoundParts:
        """Find the parts with trials below `count`; each is read once, to compare it with its hash."""
        found = FoundParts([], [])
        reached = 0
        for trials in self.trials_on_disk(scenario, estimator):
            if reached <= trials.start < count:
                key = PartKey(scenario, estimator, trials)
                if self.is_intact(key):
                    found.intact.append(key)
                    reached = trials.stop
                else:
                    found.damaged.append(key)
        return found

    def trials_on_disk(self, scenario: str, estimator: str) -> list[range]:
        """Return the trials whose parts are there, intact or not, by the names of their files."""
        if self._listing is None:
            self._listing = {}
            for name in sorted(file.name for file in (self.path / PARTS).glob("*.parquet")):
                if match := PART_NAME.fullmatch(name):
                    self._listing.setdefault(match[1], []).append(range(int(match[2]), int(match[3])))
        return self._listing.get(PartKey(scenario, estimator, range(0)).stem, [])

    def forget(self) -> None:
        """Look at the files again, which may have changed."""
        self._listing = None
        self._seconds = {key: seconds for key, seconds in self._seconds.items() if self._part_path(key).is_file()}

    def is_intact(self, key: PartKey) -> bool:
        """Return whether a part is what was written."""
        if key in self._seconds:
            return True
        try:
            receipt = self._receipt(key)
            if _hash_of(self._part_path(key)) != receipt["sha256"]:
                return False
            self._seconds[key] = float(receipt["seconds"])
        except (OSError, ValueError, KeyError, TypeError):
            return False
        return True

    def rows(self, parts: Iterable[tuple[PartKey, int]]) -> pd.DataFrame:
        """Return the rows of intact parts one after the other, with their seconds; of each the trials below a number.

        Raises:
            BadInput: parts do not have the same columns.

        """
        return _join(self._table(key, below) for key, below in parts)

    def read(self, key: PartKey) -> pd.DataFrame:
        """Return the rows of one intact part."""
        return self.rows([(key, key.trials.stop)])

    def failures(self, key: PartKey) -> list[str]:
        """Return why trials of an intact part failed, each reason once."""
        if self._receipt(key).get("failed") == 0:
            return []
        return sorted(set(pd.read_parquet(self._part_path(key), columns=["failure"])["failure"].dropna()))

    def _table(self, key: PartKey, below: int) -> pa.Table:
        with pq.ParquetFile(self._part_path(key)) as file:
            part = file.read(use_threads=False)  # small: threads take longer to start
        if "centralised" not in part.column_names:  # of an earlier version
            part = part.append_column("centralised", part["bound"])
        for i, name in enumerate(part.column_names):
            kind = part[name].type
            if name in TEXT and not pa.types.is_null(kind):  # each text once, though it stands in a thousand rows
                part = part.set_column(i, name, part[name].dictionary_encode())
            elif name.startswith(NOTE) and pa.types.is_boolean(kind):  # in other parts it may be a number
                part = part.set_column(i, name, part[name].cast(pa.float64()))
        if "seconds" in part.column_names:
            part = part.drop_columns(["seconds"])
        part = part.append_column("seconds", pa.repeat(self._seconds[key], len(part)))
        return part if key.trials.stop <= below else part.filter(pc.field("trial") < below)

    def _receipt(self, key: PartKey) -> dict[str, Any]:
        receipt: dict[str, Any] = json.loads(self._receipt_path(key).read_bytes())
        return receipt

    def _part_path(self, key: PartKey) -> Path:
        return self.path / PARTS / f"{key.name}.parquet"

    def _receipt_path(self, key: PartKey) -> Path:
        return self.path / RECEIPTS / f"{key.name}.json"


def _hash_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _join(parts: Iterable[pa.Table]) -> pd.DataFrame:
    """Return the rows of parts one after the other; nan where one has not the columns of another.

    They stay pyarrow's until they are all there: frames of twelve thousand parts take minutes, and twice the memory.
    """
    joined, remaining = [], iter(parts)
    try:
        while some := list(islice(remaining, AT_ONCE)):  # a part's description takes more memory than its rows
            joined.append(_concatenate(some).combine_chunks())
        table = _concatenate(joined).unify_dictionaries()
    except pa.ArrowException as e:
        reason = " ".join(str(e).split())[:200]
        raise BadInput(
            f"parts do not fit together ({reason}): remove those of one estimator, and run it again"
        ) from None
    del joined, some
    frame: pd.DataFrame = table.to_pandas(self_destruct=True, split_blocks=True)
    return frame.astype({name: "str" for name, kind in frame.dtypes.items() if kind == "category"})


def _concatenate(parts: list[pa.Table]) -> pa.Table:
    return pa.concat_tables(parts, promote_options="permissive").replace_schema_metadata()


def _refuse_foreign(folder: Path) -> None:
    """Refuse what neither holds a run nor was about to.

    Raises:
        BadInput: it is something else.

    """
    if (folder / MANIFEST).is_file():
        return
    if folder.is_dir():
        begun = {".lock", PARTS, RECEIPTS}  # all that is there before the first manifest
        ours = all(file.name in begun or file.name.startswith(f".{MANIFEST}.") for file in folder.iterdir())
    else:
        ours = not (folder.exists() or folder.is_symlink())
    if not ours:
        runs = sorted(str(path.parent) for path in folder.glob(f"*/{MANIFEST}")) if folder.is_dir() else []
        there = f"; there are {', '.join(runs[:LISTED])}{', ...' * (len(runs) > LISTED)}" if runs else ""
        raise BadInput(f"{folder} exists and is not a run directory{there or '; name another with --out'}")


def _continue_manifest(folder: Path, found: dict[str, Any], asked: dict[str, Any]) -> dict[str, Any]:
    """Return the manifest of a run that goes on with what is asked now.

    Raises:
        BadInput: it has other settings.

    """
    asked = _finite(asked)  # as it was written
    for key, said in MUST_MATCH.items():
        if found.get(key) != asked[key]:
            raise BadInput(f"{folder} holds a run with {said}; name another directory with --out")
    for path, hashed in asked["files"].items():
        if found["files"].get(path, hashed) != hashed:
            raise BadInput(f"{folder} holds results of another version of {path}; name another with --out")
    for path, versions in asked["imports"].items():
        before = found["imports"].get(path, versions)
        if before != versions:
            changed = ", ".join(sorted({name for name, _ in before.items() ^ versions.items()}))
            raise BadInput(
                f"{folder} holds results of {path} with other versions of {changed}; name another with --out"
            )
    for label, parameters in asked["scenarios"].items():
        if found["scenarios"].get(label, parameters) != parameters:
            raise BadInput(f"{folder} holds another scenario {label!r}; name another directory with --out")
    return {
        **asked,
        **{key: {**found[key], **asked[key]} for key in ("scenarios", "files", "imports")},
        "cells": _merge_cells(found["cells"], asked["cells"]),
        "certificates": found["certificates"],
        "streams": found["streams"],
        "isolated": asked["isolated"] and found.get("isolated", True),
    }


def _merge_cells(found: dict[str, Any], asked: dict[str, Any]) -> dict[str, Any]:
    """Return what was asked of each scenario before, with what is asked now."""
    merged = dict(found)
    for scenario, cell in asked.items():
        before = found.get(scenario, {}).get("estimators", {})
        trials = {name: max(count, before.get(name, 0)) for name, count in cell["estimators"].items()}
        merged[scenario] = {**cell, "estimators": {**before, **trials}}
    return merged


# A run as it is on disk, of all studies and options that were run into it.


class StoredRun(NamedTuple):
    """A run as it is on disk."""

    folder: Path
    manifest: dict[str, Any]
    rows: pd.DataFrame  # as `errors`, with `failure`, `traceback` and `certificate`; in the manifest's order
    gaps: dict[tuple[str, str], int]  # (scenario, estimator) -> trials that were asked for and are missing
    decisions: dict[str, Any] | None = None  # of a run until decided, as `read_decisions`

    @property
    def baselines(self) -> dict[str, str]:
        """What each scenario's estimators are compared with."""
        return {scenario: cell["baseline"] for scenario, cell in self.manifest["cells"].items()}

    @property
    def comparisons(self) -> pd.DataFrame | None:
        """Of a run until decided, what was decided of each comparison: the fields of `Decision`."""
        return comparisons(self.decisions)

    @property
    def looks(self) -> list[int]:
        """The looks of a run until decided, in trials; none where the number of trials was fixed."""
        return looks_taken(self.decisions)

    @property
    def experiments(self) -> dict[str, dict[str, list[str]]]:
        """Of each experiment its scenarios, and of each scenario the estimators that have rows, in the study's order.

        A scenario that several experiments share is in each of them, with the estimators that it has there.
        """
        pairs = self.rows.drop_duplicates(["scenario", "estimator"])
        there = {str(s): list(part["estimator"]) for s, part in pairs.groupby("scenario", sort=False)}
        planned: dict[str, dict[str, list[str]]] = {}
        for cell in Study(**self.manifest["study"]).expand_blocks():
            planned.setdefault(cell.experiment, {}).setdefault(cell.scenario, []).extend(cell.estimators)
        for scenario, cell in self.manifest["cells"].items():  # what was run for another study, or with --estimators
            known = {name for plan in planned.values() for name in plan.get(scenario, ())}
            more = [name for name in there.get(scenario, ()) if name not in known]
            planned.setdefault(cell["experiment"], {}).setdefault(scenario, []).extend(more)
        some = {
            name: {s: [e for e in there.get(s, ()) if e in mine] for s, mine in plan.items()}
            for name, plan in planned.items()
        }
        found = {name: {s: mine for s, mine in plan.items() if mine} for name, plan in some.items()}
        return {name: plan for name, plan in found.items() if plan}


def read_run(folder: Path) -> StoredRun:
    """Return the rows of a run directory; a part that does not match its hash counts as missing.

    Raises:
        BadInput: the directory is not one of a run, or holds no rows.

    """
    directory = RunDir(folder)
    manifest = directory.manifest
    if not manifest:
        raise BadInput(f"{folder} holds no run: name the directory that cooploc run wrote")
    parts: list[tuple[PartKey, int]] = []
    gaps: dict[tuple[str, str], int] = {}
    for scenario, cell in manifest["cells"].items():
        for estimator, asked in cell["estimators"].items():
            there = directory.parts(scenario, estimator, asked).intact
            missing = asked - sum(min(key.trials.stop, asked) - key.trials.start for key in there)
            gaps |= {(scenario, estimator): missing} if missing else {}
            parts += [(key, asked) for key in there]
    if not parts:
        raise BadInput(f"{folder} holds no results yet: continue it with cooploc run --out {folder}")
    rows = with_certificates(directory.rows(parts), manifest["certificates"])
    return StoredRun(folder, manifest, rows, gaps, read_decisions(folder))


# The decisions of a run until decided.


def read_decisions(folder: Path) -> dict[str, Any] | None:
    """Return what a run until decided found at its last look; None where the run was not one.

    Keys: `most`, the trials at which it ends; `look`, the last one; `going`, the (scenario, estimator) that go on;
    `comparison` and `claim`, a record for each.

    Raises:
        BadInput: the file is not what was written.

    """
    file = folder / DECISIONS
    if not file.is_file():
        return None
    content = read_json(file)
    if missing := {"most", "look", "going", "comparison"} - set(content):
        raise BadInput(f"{file} is damaged (it has no {min(missing)!r}): the command that began the run makes it again")
    return {"claim": [], **content, "going": [tuple(cell) for cell in content["going"]]}


def comparisons(decisions: Mapping[str, Any] | None) -> pd.DataFrame | None:
    """Return one row per comparison: the fields of `Decision`; None where there are no decisions."""
    if decisions is None:
        return None
    return pd.DataFrame(decisions["comparison"], columns=list(Decision._fields))


def looks_taken(decisions: Mapping[str, Any] | None) -> list[int]:
    """Return the looks of a run until decided, in trials; none of another."""
    return [n for n in looks(decisions["most"]) if n <= decisions["look"]] if decisions else []
