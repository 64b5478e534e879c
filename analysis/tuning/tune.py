"""Scores of configurations on training trials, each computed once and kept in a run directory.

A part is one configuration on one scenario's trials, as in any run; so an interrupted search goes on, and gives the
same proposals again because it is told the same scores.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, StrictStr

from cooploc.analysis.execution.atomic_file import replace
from cooploc.analysis.execution.execute import Progress, Quiet, completed, execute, manifest_of
from cooploc.analysis.execution.fit import require_fit
from cooploc.analysis.execution.piece import Piece
from cooploc.analysis.execution.pool import Workers
from cooploc.analysis.execution.run_directory import RunDir
from cooploc.analysis.execution.schemas import FORMAT, Count, Digest, Newer, checked
from cooploc.analysis.execution.workers import hired
from cooploc.analysis.tuning.search import (
    OBJECTIVES,
    Competitor,
    Item,
    Resolved,
    TrainingLane,
    demand_apart,
    derived_seed,
    lanes,
    search,
    space_of,
    trial_scores,
)
from cooploc.analysis.tuning.tables import Tuned, gains, history
from cooploc.estimators import configure
from cooploc.estimators.plugins.errors import BadInput, nearest
from cooploc.scenarios.sealed import Damaged, seal
from cooploc.scenarios.studies.study import Block, ResolvedCell, ResolvedStudy, Seed, Study, StudyCell, resolve_study

Pairs = Iterable[tuple[str, Item]]  # a configuration's label, and a trial


@dataclass
class Evaluations:
    """Computes what is asked for and not there yet."""

    training: ResolvedStudy  # its study has the training seed; cells are added as they are asked for
    scenarios: Mapping[str, Resolved]
    directory: RunDir
    workers: Workers
    watcher: Progress
    objective: str
    scores: dict[tuple[str, Item], float] = field(default_factory=dict)
    streams: dict[Item, str] = field(default_factory=dict)  # hashes of what tuning has seen

    def compute(self, pairs: Pairs) -> dict[tuple[str, Item], float]:
        """The scores of these configurations on these trials."""
        pairs = list(pairs)
        if cells := self._cells([pair for pair in pairs if pair not in self.scores]):
            asked = self.training._replace(cells=tuple(cells))
            self.directory.open({**manifest_of(asked), "isolated": True})
            for piece in completed(asked, self.directory, self.workers, False, self.watcher):
                self._keep(piece)
        return {pair: self.scores[pair] for pair in pairs}

    def _cells(self, pairs: Sequence[tuple[str, Item]]) -> list[ResolvedCell]:
        """A cell for every scenario, with as many trials of each configuration as it needs."""
        upto: dict[str, dict[str, int]] = {}
        for label, item in pairs:
            of = upto.setdefault(item.scenario, {})
            of[label] = max(of.get(label, 0), item.trial + 1)
        return [
            ResolvedCell(
                "training", self.scenarios[scenario], trials, tuple(map(configure, trials)), next(iter(trials))
            )
            for scenario, trials in upto.items()
        ]

    def _keep(self, piece: Piece) -> None:
        rows = self.directory.read(piece)
        for trial, score in trial_scores(rows, self.objective).items():
            self.scores[piece.estimator, Item(piece.scenario, int(str(trial)))] = float(score)
        hashes: pd.Series[Any] = rows.dropna(subset="stream").groupby("trial")["stream"].first()
        self.streams |= {Item(piece.scenario, int(str(trial))): str(found) for trial, found in hashes.items()}


# `tuning.json`: what a reader needs to repeat a tuning, with a checksum of itself and of the tables beside it.

RECORD = "tuning.json"


class Record(BaseModel):
    """What was asked, with which seeds, and what was found."""

    model_config = ConfigDict(extra="forbid")

    format: Annotated[int, Field(strict=True, ge=FORMAT)]
    study: Study
    budget: Count
    objective: StrictStr
    optuna: StrictStr
    seed: Seed
    training_seed: Seed
    spent: dict[StrictStr, Count]  # training trials that each estimator used
    spaces: dict[StrictStr, dict[StrictStr, dict[StrictStr, Any]]]  # the parameters of each, with their bounds
    streams: dict[StrictStr, StrictStr]  # hashes of the streams that tuning used
    tuned: dict[StrictStr, StrictStr]  # the tuned label of every label of the study
    tables: dict[StrictStr, Digest]  # of each file that was written beside it; none before the comparison ended


def write_record(folder: Path, found: Mapping[str, Any], tables: Mapping[str, str] | None = None) -> None:
    """Write the tables, by file name, then the record that vouches for them; each file is whole or not there."""
    texts = tables or {}
    for name, text in texts.items():
        _write(folder / name, text)
    digests = {name: _digest(text.encode()) for name, text in texts.items()}
    _write(folder / RECORD, json.dumps(seal({"format": FORMAT, **found, "tables": digests}), indent=1) + "\n")


def read_record(folder: Path, tables: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, str]]:
    """The record, and the tables' texts by file name.

    Raises:
        BadInput: the tuning has not finished, or a file is not what was written.

    """
    for name in (RECORD, *tables):
        if not (folder / name).is_file():
            raise _unfinished_error(folder)
    record = _checked_record(folder / RECORD)
    if not set(tables) <= set(record["tables"]):
        raise _unfinished_error(folder)
    found = {}
    for name in tables:
        content = (folder / name).read_bytes()
        if _digest(content) != record["tables"][name]:
            raise _damage_error(folder / name, f"it is not what {RECORD} vouches for")
        found[name] = content.decode()
    return {key: value for key, value in record.items() if key not in ("format", "tables")}, found


def _checked_record(file: Path) -> dict[str, Any]:
    try:
        return checked(file.read_bytes(), Record)
    except (Damaged, Newer) as e:
        raise _damage_error(file, str(e)) from None


def _damage_error(file: Path, why: str) -> BadInput:
    return BadInput(f"{file} is damaged: {why}; the cooploc tune that wrote it writes it again")


def _unfinished_error(folder: Path) -> BadInput:
    return BadInput(f"{folder} holds no finished tuning: name the directory that cooploc tune wrote, or run it again")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _write(file: Path, text: str) -> None:
    replace(file, lambda temporary: temporary.write_bytes(text.encode()))


# A study with the tuned configurations, as an object and as the TOML file that `cooploc run` accepts.

STUDY_HEAD = """# Made by cooploc tune: every estimator as it was tuned, on streams of a seed that no run may have.
about = {about}
trials = {trials}
seed = {seed}
time_limit = {time_limit}
tuned_with = {tuned_with}
"""


def tuned_study(study: Study, cells: list[StudyCell], tuned: Mapping[str, str], seed: int, both: bool) -> Study:
    """The study with the tuned label of every estimator; `both`: beside its own label."""
    blocks: dict[tuple[str, tuple[str, ...], str], list[str]] = {}
    for cell in cells:
        labels = [name for label in cell.estimators for name in ((label, tuned[label]) if both else (tuned[label],))]
        baseline = cell.baseline if both else tuned[cell.baseline]
        blocks.setdefault((cell.experiment, tuple(dict.fromkeys(labels)), baseline), []).append(cell.scenario)
    also = tuple(
        Block(scenarios=tuple(scenarios), estimators=labels, baseline=baseline, experiment=experiment)
        for (experiment, labels, baseline), scenarios in blocks.items()
    )
    emptied: dict[str, Any] = {
        "scenarios": (),
        "estimators": (),
        "baseline": "",
        "variants": {},
        "only": (),
        "minutes": None,
    }
    name = f"{study.name}-{'published-and-tuned' if both else 'tuned'}"
    return study.model_copy(update={**emptied, "name": name, "also": also, "tuned_with": seed})


def as_toml(study: Study) -> str:
    """The file's text. A JSON string of printable characters is a TOML string of the same meaning."""
    known = study.model_dump()
    text = STUDY_HEAD.format(
        **{key: _text(known[key]) for key in ("about", "trials", "seed", "time_limit", "tuned_with")}
    )
    for block in study.also:
        lines = {key: _text(value) for key, value in block.model_dump().items() if value}
        text += "\n[[also]]\n" + "".join(f"{key} = {value}\n" for key, value in lines.items())
    if study.training:
        text += "\n[training]\n" + "".join(f"{_text(key)} = {_text(value)}\n" for key, value in study.training.items())
    return text


def _text(value: object) -> str:
    if isinstance(value, list | tuple):
        return "[\n" + "".join(f"    {_text(one)},\n" for one in value) + "]" if value else "[]"
    return json.dumps(value, ensure_ascii=False)


# Tune every estimator of a study alike, then run it as published and as tuned on the study's own streams.

MOST_BUDGET = 1_000_000
FILE = "tuned.toml"


class Tuning(NamedTuple):
    """What a tuning found."""

    study: Study  # with the tuned configurations
    history: pd.DataFrame  # as `tables.history`
    gains: pd.DataFrame  # as `tables.gains`
    rows: pd.DataFrame  # of the run on fresh streams, of both configurations
    tuned: dict[str, str]  # the tuned label of every label of the study
    record: dict[str, Any]  # seeds, budget, streams


class Options(NamedTuple):
    """How it runs; nothing of it changes a bit."""

    data: Path | None = None
    jobs: int = 1
    check: bool = True
    isolate: bool = True


def tune(
    study: Study,
    out: Path,
    budget: int,
    objective: str = "nll",
    options: Options = Options(),  # noqa: B008 (frozen)
    progress: Progress | None = None,
) -> Tuning:
    """Tune, compare on fresh streams, and keep everything in `out`; what is there already is not computed again.

    Args:
        study: what is to be compared.
        out: the directory; `training` in it is the run directory of the search, `fresh` that of the comparison.
        budget: training trials that each estimator may use.
        objective: "nll" or "rmse", as of `objective`.
        options: where it runs.
        progress: called for every part.

    Raises:
        BadInput: something cannot be tuned as it stands; nothing was computed.

    """
    _demand(budget, objective)
    watcher = progress or Quiet()
    found = _search_all(study, out, budget, objective, options, watcher)
    labels = {one.label: one.label for one in found.asked.estimators} | {one.published: one.best for one in found.tuned}
    record = {**_record_of(study, budget, objective, found), "tuned": labels}
    chosen, both = (tuned_study(study, study.cells(), labels, found.seed, both=both) for both in (False, True))
    write_record(out, record)
    replace(out / FILE, lambda file: file.write_text(as_toml(chosen), encoding="utf-8"))
    rows = _fresh(both, out / "fresh", options, watcher)
    demand_apart(found.seed, study.seed, found.streams.values(), rows["stream"].dropna())
    return Tuning(chosen, history(found.tuned), gains(rows, found.tuned, objective), rows, labels, record)


class _Found(NamedTuple):
    """What the search found."""

    asked: ResolvedStudy
    tuned: list[Tuned]
    seed: int  # of the training streams
    streams: dict[Item, str]  # hashes of what it saw


def _search_all(study: Study, out: Path, budget: int, objective: str, options: Options, watcher: Progress) -> _Found:
    """The races of all estimators, whose evaluations are kept in `out`."""
    hands = hired(options.jobs, None, options.isolate, watcher.say, keep=True)
    with hands as workers, _open_training(out) as directory:
        asked = resolve_study(study, options.data, options.isolate)
        seed = derived_seed(study.seed, "training")
        own = lanes(asked.cells, study.training, options.data, options.isolate)
        training = asked._replace(study=study.model_copy(update={"seed": seed}), cells=())
        require_fit(asked._replace(study=training.study), options.isolate)
        scenarios = {one.label: one for lane in own.values() for one in lane.scenarios}
        counted = _Counted(watcher, budget * len(asked.estimators))
        evaluations = Evaluations(training, scenarios, directory, workers, counted, objective)
        competitors = _competitors(asked, own, options.isolate)
        finishes = search(competitors, budget, derived_seed(study.seed, "sampler"), evaluations.compute)
    tuned = [Tuned(one, finish) for one, finish in zip(competitors, finishes, strict=True)]
    return _Found(asked, tuned, seed, evaluations.streams)


def _fresh(both: Study, out: Path, how: Options, watcher: Progress) -> pd.DataFrame:
    return execute(both, out, data=how.data, jobs=how.jobs, check=how.check, isolate=how.isolate, progress=watcher)


def _demand(budget: int, objective: str) -> None:
    if not 1 <= budget <= MOST_BUDGET:
        raise BadInput(f"budget is {budget}; it must be at least 1 trial, and at most {MOST_BUDGET}")
    if objective not in OBJECTIVES:
        raise BadInput(f"there is no objective {objective!r}; {nearest(objective, list(OBJECTIVES))}")


@contextmanager
def _open_training(out: Path) -> Iterator[RunDir]:
    """The run directory of the search, locked."""
    if out.exists() and not (out / "training").is_dir() and (not out.is_dir() or any(out.iterdir())):
        raise BadInput(f"{out} exists and is not the directory of a tuning; name another with --out")
    directory = RunDir(out / "training")
    with directory.locked():
        yield directory


def _competitors(asked: ResolvedStudy, own: dict[str, TrainingLane], isolate: bool) -> list[Competitor]:
    """The estimators that are on some scenario that can be trained on, in the study's order."""
    found = []
    for one in asked.estimators:
        labels = [cell.scenario.label for cell in asked.cells if one in cell.estimators]
        mine = [own[label] for label in labels if label in own]
        if mine:
            found.append(Competitor(space_of(one.label, isolate), mine))
    if not found:
        raise BadInput(f"study {asked.study.name!r} has no scenario that estimators may be tuned on: see its training")
    return found


def _record_of(study: Study, budget: int, objective: str, found: _Found) -> dict[str, Any]:
    """What a reader needs to repeat it, and to see that no reported stream was used."""
    return {
        "study": study.model_dump(mode="json"),
        "budget": budget,
        "objective": objective,
        "optuna": version("optuna"),
        "seed": study.seed,
        "training_seed": found.seed,
        "spent": {one.published: one.finish.spent for one in found.tuned},
        "spaces": {one.published: _space(one) for one in found.tuned},
        "streams": {f"{item.scenario}, trial {item.trial}": hashed for item, hashed in found.streams.items()},
    }


def _space(one: Tuned) -> dict[str, Any]:
    return {name: each._asdict() for name, each in one.competitor.space.parameters.items()}


class _Counted:
    """Passes on progress as one count for all steps of a search."""

    def __init__(self, watcher: Progress, total: int) -> None:
        self._watcher, self._total, self._done, self._begun = watcher, total, 0, False
        self.say, self.compiling = watcher.say, watcher.compiling

    def begin(self, trials: int, found: int) -> None:
        """The whole budget, once."""
        if not self._begun:
            self._watcher.begin(self._total, 0)
        self._begun = True

    def advance(self, what: str, trials: int, failed: int, share: float) -> None:
        """A part is done."""
        self._done += trials
        self._watcher.advance(what, trials, failed, min(1.0, self._done / self._total))
