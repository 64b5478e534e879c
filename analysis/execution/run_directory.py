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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from filelock import FileLock, Timeout
from pydantic import ValidationError

from cooploc.analysis.execution.provenance import add_certificates, source_key
from cooploc.analysis.metrics.errors import NOTE
from cooploc.analysis.metrics.sequential import Decision, looks
from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.label_syntax import parse, shorten_labels
from cooploc.scenarios.scenario import split_family
from cooploc.scenarios.studies.study import Study

FORMAT = 3  # of the JSON files
MANIFEST, DECISIONS, PARTS, RECEIPTS = "manifest.json", "decisions.json", "parts", "receipts"
REPLACED = "replaced"  # parts of estimators whose source was changed since, by a hash of the old one
NEEDED = ("study", "cells", "seed", "data", "scenarios", "streams", "versions", "source", "commit", "cpu")
MUST_MATCH = {  # in a run that goes on, and what the error says where it differs
    "seed": "another seed",
    "data": "other recordings",
    "versions": "other versions of the libraries",
    "source": "another version of cooploc",
    "instructions": "another kind of processor",
}
MUST_AGREE = {  # where both name the same thing
    "files": "results of another version of {}",
    "imports": "results of {} with other versions of what it imports",
    "scenarios": "another scenario {!r}",
}
OF_PLUGINS = ("files", "imports")
TEXT = ("scenario", "estimator", "stream", "senses", "failure", "traceback")  # columns
AT_ONCE = 200  # parts that are joined together
PART_NAME = re.compile(r"(.+--[0-9a-f]{8}--)(\d{5,9})-(\d{5,9})\.parquet")

Cell = tuple[str, str]  # labels of a scenario and an estimator


# Files.


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file that is whole or not there: under a temporary name, flushed to the disk, renamed."""
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


def parse_json(text: str | bytes, where: str) -> dict[str, Any]:
    """Return the JSON object that `write_json` wrote; `where` names it in an error."""
    try:
        content = json.loads(text)
        newer = content["format"] > FORMAT
    except (ValueError, RecursionError, KeyError, TypeError) as e:
        raise BadInput(f"{where} is damaged ({' '.join(str(e).split())}): make it again") from None
    if newer:
        raise BadInput(f"{where} has format {content['format']}, this version reads up to {FORMAT}: update cooploc")
    return dict(content)


def _finite(value: Any) -> Any:
    """Return a value with None for every number that JSON does not have."""
    if isinstance(value, Mapping):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _hash_of(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


# Parts.


class PartKey(NamedTuple):
    """The scenario, the estimator and the trials of a part."""

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


class Receipt(NamedTuple):
    """A part's hash, cost and failures, beside its rows."""

    sha256: str  # of its file
    seconds: float  # of computing, per robot and tick
    failed: int = 0  # trials


class RunDir:
    """A directory of results that can be continued."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def manifest(self) -> dict[str, Any]:
        """The manifest; empty where nothing was run into the directory yet."""
        file = self.path / MANIFEST
        if not file.is_file():
            _refuse_foreign(self.path)
            return {}
        content = parse_json(file.read_bytes(), str(file))
        missing = [f"it has no {key!r}" for key in NEEDED if key not in content]
        try:
            Study(**content.get("study", {}))
        except (ValidationError, TypeError):
            missing.append("its study cannot be read")
        if missing:
            raise BadInput(f"{file} is damaged ({missing[0]}): name another directory by --out, in Python out=")
        return {"files": {}, "imports": {}, "certificates": {}, "instructions": {}, **content}

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Keep other runs from writing here; the lock ends with its process, however that ends."""
        _refuse_foreign(self.path)  # before anything is written there
        self.path.mkdir(parents=True, exist_ok=True)
        try:
            with FileLock(self.path / ".lock", timeout=0):
                yield
        except Timeout:
            raise BadInput(
                f"another run is writing to {self.path}: wait for it, or name another by --out, in Python out="
            ) from None

    def open(self, manifest: dict[str, Any], say: Callable[[str], None] = lambda line: None) -> None:
        """Begin a run, or continue that of the same settings; parts of estimators that were changed are set aside."""
        for folder in (".", PARTS, RECEIPTS):
            for left in (self.path / folder).glob(".*.tmp"):  # of a process that was killed
                left.unlink()
        if found := self.manifest:
            old = {name: _forget_plugin(found, name) for name in _changed_plugins(found, manifest)}
            manifest = _continue_manifest(self.path, found, manifest)  # which may refuse
            for name, (version, stems) in old.items():
                place = self.path / REPLACED / version[:8]
                both = "to compare both versions, give each a directory of its own (--out, in Python out=)"
                say(f"{name} was changed: its results are computed again, those of before went to {place}; {both}")
                self._set_aside(stems, place)
        self.write_manifest(manifest)
        for folder in (PARTS, RECEIPTS):
            (self.path / folder).mkdir(exist_ok=True)

    def _set_aside(self, stems: Iterable[str], place: Path) -> None:
        """Move parts, and the decisions that rest on them."""
        place.mkdir(parents=True, exist_ok=True)
        for stem in stems:
            for folder in (PARTS, RECEIPTS):  # parts first: a part counts
                for file in (self.path / folder).glob(f"{stem}*"):
                    file.replace(place / file.name)
        with suppress(FileNotFoundError):
            (self.path / DECISIONS).replace(place / DECISIONS)

    def write_manifest(self, manifest: dict[str, Any]) -> None:
        """Replace the manifest."""
        write_json(self.path / MANIFEST, {**manifest, "format": FORMAT})

    def write(self, key: PartKey, frame: pd.DataFrame, seconds: float) -> Receipt:
        """Keep one part; it counts as done once it is there, and its receipt is there before it."""
        failed = int(frame.loc[frame["failure"].notna(), "trial"].nunique())
        receipts = []

        def write(file: Path) -> None:
            frame.to_parquet(file, index=False)
            receipts.append(Receipt(_hash_of(file), seconds, failed))
            text = json.dumps(receipts[0]._asdict())
            replace_file(self._place(key, RECEIPTS), lambda temporary: temporary.write_text(text, encoding="utf-8"))

        replace_file(self._place(key, PARTS), write)
        return receipts[0]

    def find(self, wanted: Mapping[Cell, int]) -> tuple[dict[PartKey, Receipt], list[PartKey]]:
        """Return the parts with trials below a number of each cell, each trial once, and those that are damaged."""
        there: dict[str, list[range]] = {}
        for name in sorted(file.name for file in (self.path / PARTS).glob("*.parquet")):
            if match := PART_NAME.fullmatch(name):
                there.setdefault(match[1], []).append(range(int(match[2]), int(match[3])))
        intact, damaged = dict[PartKey, Receipt](), list[PartKey]()
        for cell, count in wanted.items():
            reached = 0
            for trials in there.get(PartKey(*cell, range(0)).stem, ()):
                if reached <= trials.start < count:
                    key = PartKey(*cell, trials)
                    if receipt := self._receipt(key):
                        intact[key], reached = receipt, trials.stop
                    else:
                        damaged.append(key)
        return intact, damaged

    def read_rows(self, wanted: Mapping[Cell, int], intact: Mapping[PartKey, Receipt]) -> pd.DataFrame:
        """Return the rows of intact parts, with their seconds, in the order of what is wanted."""
        place = {cell: i for i, cell in enumerate(wanted)}
        keys = sorted((key for key in intact if key[:2] in place), key=lambda k: (place[k[:2]], k.trials.start))
        return _join(self._table(key, intact[key].seconds, wanted[key[:2]]) for key in keys)

    def _table(self, key: PartKey, seconds: float, below: int) -> pa.Table:
        with pq.ParquetFile(self._place(key, PARTS)) as file:
            part = file.read(use_threads=False)  # small: threads take longer to start
        for i, name in enumerate(part.column_names):
            kind = part[name].type
            if name in TEXT and not pa.types.is_null(kind):  # each text once, though it stands in a thousand rows
                part = part.set_column(i, name, part[name].dictionary_encode())
            elif name.startswith(NOTE) and pa.types.is_boolean(kind):  # in other parts it may be a number
                part = part.set_column(i, name, part[name].cast(pa.float64()))
        part = part.append_column("seconds", pa.repeat(seconds, len(part)))
        return part if key.trials.stop <= below else part.filter(pc.field("trial") < below)

    def _receipt(self, key: PartKey) -> Receipt | None:
        """Return the receipt of a part; None where the part is not what was written."""
        try:
            receipt = Receipt(**json.loads(self._place(key, RECEIPTS).read_bytes()))
            return receipt if _hash_of(self._place(key, PARTS)) == receipt.sha256 else None
        except (OSError, ValueError, TypeError):
            return None

    def _place(self, key: PartKey, folder: str) -> Path:
        """Return the file of a part, or that of its receipt."""
        return self.path / folder / f"{key.name}{'.parquet' if folder == PARTS else '.json'}"


def _join(parts: Iterable[pa.Table]) -> pd.DataFrame:
    """Return the rows of parts one after the other; nan where one has not the columns of another.

    They stay pyarrow's until they are all there: frames of twelve thousand parts take minutes, and twice the memory.
    """
    remaining, concatenate = iter(parts), partial(pa.concat_tables, promote_options="permissive")
    some_at_once = iter(lambda: list(islice(remaining, AT_ONCE)), [])  # descriptions take more memory than rows
    try:
        joined = [concatenate(some).replace_schema_metadata().combine_chunks() for some in some_at_once]
        table = concatenate(joined).unify_dictionaries()
    except pa.ArrowException as e:
        reason = " ".join(str(e).split())[:200]
        raise BadInput(f"parts do not fit together ({reason}): remove those of one estimator, and run it again") from e
    frame: pd.DataFrame = table.to_pandas(split_blocks=True)
    return frame.astype({name: "str" for name, kind in frame.dtypes.items() if kind == "category"})


def _refuse_foreign(folder: Path) -> None:
    """Refuse a place that neither holds a run nor was about to."""
    if (folder / MANIFEST).is_file() or not (folder.exists() or folder.is_symlink()):
        return
    begun = {".lock", PARTS, RECEIPTS}  # all that is there before the first manifest
    there = list(folder.iterdir()) if folder.is_dir() else [folder]
    if all(file.name in begun or file.name.startswith(f".{MANIFEST}.") for file in there):
        return
    raise BadInput(f"{folder} exists and is not a run directory; name another directory")


def _changed_plugins(found: dict[str, Any], asked: dict[str, Any]) -> list[str]:
    """Return the sources of estimators that are not as they were, unless worlds come from the same file."""
    worlds = {source_key(split_family(parse(label)[0])[0]) for label in asked["cells"]}
    ours = {source_key(parse(label)[0]) for cell in asked["cells"].values() for label in cell["estimators"]} - worlds
    changed = []
    for name in sorted(ours & {*asked["files"]}):
        now = [asked[key][name] for key in OF_PLUGINS]
        if [found[key].get(name, one) for key, one in zip(OF_PLUGINS, now, strict=True)] != now:
            changed.append(name)
    return changed


def _forget_plugin(found: dict[str, Any], name: str) -> tuple[str, list[str]]:
    """Remove a plug-in's estimators and version from a manifest; return a hash of it, and the stems of their parts."""
    stems, version = [], json.dumps([found[key].pop(name, None) for key in OF_PLUGINS], sort_keys=True)
    for scenario, cell in found["cells"].items():
        for label in [one for one in cell["estimators"] if source_key(parse(one)[0]) == name]:
            stems.append(PartKey(scenario, label, range(0)).stem)
            del cell["estimators"][label]
            found["certificates"].pop(label, None)
    return hashlib.sha256(version.encode()).hexdigest(), stems


def _continue_manifest(folder: Path, found: dict[str, Any], asked: dict[str, Any]) -> dict[str, Any]:
    """Return the manifest of a run that goes on with what is asked now."""
    asked = _finite(asked)  # as it was written
    unlike = [f"a run with {said}" for key, said in MUST_MATCH.items() if found.get(key) != asked[key]]
    for key, said in MUST_AGREE.items():
        unlike += [said.format(name) for name, one in asked[key].items() if found[key].get(name, one) != one]
    if unlike:
        raise BadInput(f"{folder} holds {unlike[0]}; name another directory by --out, in Python out=")
    cells = dict(found["cells"])
    for scenario, cell in asked["cells"].items():
        before = cells.get(scenario, {}).get("estimators", {})
        trials = {name: max(count, before.get(name, 0)) for name, count in cell["estimators"].items()}
        baseline = cells.get(scenario, cell)["baseline"]  # pages keep what they compare with
        cells[scenario] = {**cell, "baseline": baseline, "estimators": {**before, **trials}}
    return {
        **asked,
        **{key: {**found[key], **asked[key]} for key in MUST_AGREE},
        "cells": cells,
        "certificates": found["certificates"],
        "streams": found["streams"],
        "isolated": asked["isolated"] and found.get("isolated", True),
    }


# A run as it is on disk, of all studies and options that were run into it.


class StoredRun(NamedTuple):
    """A run as it is on disk."""

    folder: Path
    manifest: dict[str, Any]
    rows: pd.DataFrame  # as `errors`, with `failure`, `traceback` and `certificate`; in the manifest's order
    gaps: dict[Cell, int]  # trials that were asked for and are missing
    decisions: dict[str, Any] | None = None  # of a run until decided, as `read_decisions`
    damaged: tuple[PartKey, ...] = ()  # whose files are not what was written

    @property
    def baselines(self) -> dict[str, str]:
        """The baseline of each scenario."""
        return {scenario: cell["baseline"] for scenario, cell in self.manifest["cells"].items()}

    @property
    def comparisons(self) -> pd.DataFrame | None:
        """A row for each comparison of a run until decided, with the fields of `Decision`; None of another run."""
        if self.decisions is None:
            return None
        return pd.DataFrame(self.decisions["comparison"], columns=list(Decision._fields))

    @property
    def looks(self) -> list[int]:
        """The looks of a run until decided, in trials; none where the number of trials was fixed."""
        return [n for n in looks(self.decisions["most"]) if n <= self.decisions["look"]] if self.decisions else []

    @property
    def experiments(self) -> dict[str, dict[str, list[str]]]:
        """Every experiment's scenarios with the estimators that have rows, in the study's order.

        A scenario that several experiments share is in each of them, with the estimators that it has there.
        """
        there = {
            str(s): list(names) for s, names in self.rows.groupby("scenario", sort=False)["estimator"].unique().items()
        }
        planned: dict[str, dict[str, list[str]]] = {}
        for cell in Study(**self.manifest["study"]).expand_blocks():
            planned.setdefault(cell.experiment, {}).setdefault(cell.scenario, []).extend(cell.estimators)
        for scenario, cell in self.manifest["cells"].items():  # what was run for another study, or with --estimators
            known = {name for plan in planned.values() for name in plan.get(scenario, ())}
            more = [name for name in there.get(scenario, ()) if name not in known]
            planned.setdefault(cell["experiment"], {}).setdefault(scenario, []).extend(more)
        for plan in planned.values():
            plan |= {s: [name for name in there.get(s, ()) if name in names] for s, names in plan.items()}
        found = {name: {s: names for s, names in plan.items() if names} for name, plan in planned.items()}
        return {name: plan for name, plan in found.items() if plan}


def read_run(run: str | PathLike[str], empty: bool = False) -> StoredRun:
    """Return the rows of a run directory; a part that does not match its hash counts as missing."""
    if not isinstance(run, str | PathLike):
        raise BadInput(f"a run is given by its directory, or as results of cl.run_study, not as {type(run).__name__}")
    folder = Path(run)
    directory = RunDir(folder)
    manifest = directory.manifest
    if not manifest:
        raise BadInput(f"{folder} holds no run: name the directory that cooploc run wrote")
    wanted = {(s, e): count for s, cell in manifest["cells"].items() for e, count in cell["estimators"].items()}
    intact, damaged = directory.find(wanted)
    if not (intact or empty):
        raise BadInput(f"{folder} holds no results yet: continue it with cooploc run --out {folder}")
    gaps = dict(wanted)
    for key in intact:
        gaps[key[:2]] -= min(key.trials.stop, wanted[key[:2]]) - key.trials.start
    rows = pd.DataFrame(columns=["scenario", "estimator", "trial", "failure", "traceback"])
    if intact:
        rows = add_certificates(directory.read_rows(wanted, intact), manifest["certificates"])
    gaps = {cell: missing for cell, missing in gaps.items() if missing}
    return StoredRun(folder, manifest, rows, gaps, read_decisions(folder), tuple(damaged))


def select(
    run: StoredRun, estimators: Sequence[str] = (), scenarios: Sequence[str] = (), baseline: str = ""
) -> StoredRun:
    """Return the part of a run with these estimators and scenarios alone, compared with `baseline`; all where empty.

    A name of which the run has no scenario, but some with parameters, selects these. A scenario whose baseline is not
    among its estimators has the first of them as its baseline.

    Raises:
        BadInput: the run has no estimator or scenario of a name, or was decided against another baseline.

    """
    cells = run.manifest["cells"]
    there = dict.fromkeys(name for cell in cells.values() for name in cell["estimators"])
    names = {shown: name for name in there for shown in (name, shorten_labels(name))}
    asked = [*estimators, *filter(None, [baseline])]
    families = {label: split_family(label.partition("[")[0])[0] for label in cells}
    families = {label: name for label, name in families.items() if name not in cells}
    for what, wanted, known in (("estimator", asked, names), ("scenario", scenarios, [*cells, *families.values()])):
        for one in wanted:
            if one not in known:
                near = nearest(one, list(dict.fromkeys(map(shorten_labels, known))))
                raise BadInput(f"this run has no {what} {one!r}; {near}")
    only = {names[one] for one in asked} if estimators else set(there)
    chosen = {}
    for scenario, cell in cells.items():
        mine = {name: count for name, count in cell["estimators"].items() if name in only}
        first = next((one for one in (names.get(baseline), cell["baseline"], *mine) if one in mine), "")
        if mine and (not scenarios or {scenario, families.get(scenario)} & {*scenarios}):
            chosen[scenario] = {**cell, "baseline": first, "estimators": mine}
    moved = any(cell["baseline"] != cells[scenario]["baseline"] for scenario, cell in chosen.items())
    if moved and run.decisions is not None:
        raise BadInput("this run was decided against its own baseline: keep that, or run it without --until-decided")

    kept = {(scenario, name) for scenario, cell in chosen.items() for name in cell["estimators"]}
    rows = run.rows[[cell in kept for cell in zip(run.rows["scenario"], run.rows["estimator"], strict=True)]]
    gaps = {cell: missing for cell, missing in run.gaps.items() if cell in kept}
    return run._replace(manifest={**run.manifest, "cells": chosen}, rows=rows, gaps=gaps)


def read_decisions(folder: Path) -> dict[str, Any] | None:
    """Return what a run until decided found at its last look; None where the run was not one.

    Keys: `most`, the trials at which it ends; `look`, the last one; `going`, the (scenario, estimator) that go on;
    `comparison` and `claim`, a record for each.
    """
    file = folder / DECISIONS
    if not file.is_file():
        return None
    content = parse_json(file.read_bytes(), str(file))
    return {"claim": [], **content, "going": [tuple(cell) for cell in content["going"]]}
