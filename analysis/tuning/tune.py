"""Tune every estimator of a study alike, then run it as published and as tuned on the study's own streams.

The streams that estimators are tuned on never meet those that results are reported of. Simulated ones come from a seed
of their own, a hash of the study's seed that does not lead back to it. A recording has no seed: the study says in
`training` on which other recordings, or other parts of one, it is tuned, and a part that overlaps with what is judged
is refused.

The directory of a tuning holds two run directories, `training` of the search and `fresh` of the comparison; the study
with the tuned configurations; and the tables. The same call goes on with what is there: a search that is repeated gets
the same scores, so that it makes the same proposals and computes nothing twice.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.execution.run import RunProgress, Silent, complete, execute, make_manifest, prepare
from cooploc.analysis.execution.run_directory import PartKey, Receipt, RunDir, read_run, replace_file
from cooploc.analysis.execution.workers import Compute, make_workers
from cooploc.analysis.tuning.search import (
    Item,
    Lane,
    Pair,
    race,
    require_budget,
    require_objective,
    space_of,
    trial_scores,
)
from cooploc.analysis.tuning.tables import gains, history, order
from cooploc.estimators import configure
from cooploc.estimators.errors import BadInput
from cooploc.estimators.registry import parse
from cooploc.scenarios import family, resolve, simulate
from cooploc.scenarios.scenario import ResolvedScenario, split_family
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.studies.study import Block, ResolvedCell, ResolvedStudy, Study

MOST_BUDGET = 1_000_000
STUDY_FILE, RECORD_FILE = "tuned.toml", "tuning.json"
HISTORY_FILE, TABLE_FILE = "history.csv", "published-and-tuned.csv"


@dataclass(frozen=True, eq=False, repr=False)
class Tuned:
    """The result of a tuning, and the directory that holds it."""

    folder: Path
    history: pd.DataFrame  # one row per configuration that was tried, as of `tables.history`
    table: pd.DataFrame  # one row per scenario and estimator, as published and tuned, as of `tables.gains`
    rows: pd.DataFrame  # as `cl.errors`, of the fresh streams
    tuned: dict[str, str]  # the tuned label of every estimator
    record: dict[str, Any]  # budget, seeds, hashes of the streams that tuning used

    @property
    def study(self) -> Path:
        """The study file with the tuned configurations, for `cooploc run`."""
        return self.folder / STUDY_FILE

    def order(self, by: str = "rmse") -> pd.DataFrame:
        """Compare every pair of estimators as published and as tuned, as of `analysis.tuning.tables.order`."""
        return order(self.rows, self.tuned, by)

    def __repr__(self) -> str:
        return f"Tuned({str(self.folder)!r}, {len(self.tuned)} estimators, budget {self.record['budget']})"


def tune(
    study: Study,
    out: Path,
    budget: int,
    objective: str = "nll",
    *,
    data: Path | None = None,
    jobs: int = 1,
    check: bool = True,
    isolate: bool = True,
    progress: RunProgress | None = None,
) -> Tuned:
    """Tune, compare on fresh streams, and keep everything in `out`; what is there already is not computed again.

    Args:
        study: what is to be compared.
        out: the directory.
        budget: training trials that each estimator may use.
        objective: "nll" or "rmse", as of `search`.
        data: the directory of recordings.
        jobs: processes; their number changes no bit.
        check: whether estimators that are not built in are checked before they are compared.
        isolate: False keeps everything in this process, for a debugger.
        progress: called for every part.

    Raises:
        BadInput: something cannot be tuned as it stands; nothing was computed.

    """
    if not 1 <= budget <= MOST_BUDGET:
        raise BadInput(f"budget is {budget}; it must be at least 1 trial, and at most {MOST_BUDGET}")
    require_objective(objective)
    if out.exists() and not (out / "training").is_dir() and (not out.is_dir() or any(out.iterdir())):
        raise BadInput(f"{out} exists and is not the directory of a tuning; name another with --out")
    watcher, seed, directory = progress or Silent(), derived_seed(study.seed, "training"), RunDir(out / "training")
    asked = prepare(study.model_copy(update={"seed": seed}), data, isolate=isolate, say=watcher.say)
    own = lanes(asked.cells, study.training, data)
    competitors = [
        (space_of(one.label, isolate), mine)
        for one in asked.estimators
        if (mine := [own[c.scenario.label] for c in asked.cells if one in c.estimators and c.scenario.label in own])
    ]
    if not competitors:
        raise BadInput(f"study {study.name!r} has no scenario that estimators may be tuned on: see its training")
    for space, mine in competitors:
        require_budget(space, mine, budget)
    with make_workers(jobs, None, isolate, watcher.compiling) as compute, directory.lock():
        (out / RECORD_FILE).unlink(missing_ok=True)
        scenarios = {one.label: one for lane in own.values() for one in lane.scenarios}
        watcher.begin(budget * len(competitors), 0)
        evaluations = Evaluations(asked, scenarios, directory, compute, watcher, objective)
        sampler_seed = derived_seed(study.seed, "sampler")
        finishes = [race(space, mine, budget, sampler_seed, evaluations.compute) for space, mine in competitors]
    tuned = {one.label: one.label for one in asked.estimators} | {one.published: one.best.label for one in finishes}
    _write(out / STUDY_FILE, as_toml(tuned_study(study, tuned, seed, both=False)))
    both = prepare(tuned_study(study, tuned, seed, both=True), data, isolate=isolate)
    rows = execute(both, out / "fresh", jobs=jobs, check=check, isolate=isolate, progress=watcher)
    require_apart(seed, study.seed, evaluations.streams.values(), rows["stream"].dropna())
    record = {
        "study": study.model_dump(mode="json"),
        "budget": budget,
        "objective": objective,
        "optuna": version("optuna"),
        "seed": study.seed,
        "training_seed": seed,
        "spent": {one.published: one.spent for one in finishes},
        "spaces": {
            one.published: {name: each._asdict() for name, each in one.space.parameters.items()} for one in finishes
        },
        "streams": {f"{item.scenario}, trial {item.trial}": digest for item, digest in evaluations.streams.items()},
        "tuned": tuned,
    }
    found = Tuned(out, history(finishes), gains(rows, finishes, objective), rows, tuned, record)
    _write(out / HISTORY_FILE, found.history.to_csv(index=False, lineterminator="\n"))
    _write(out / TABLE_FILE, found.table.to_csv(index=False, lineterminator="\n"))
    _write(out / RECORD_FILE, json.dumps(record, indent=1) + "\n")  # last, as it says that all is there
    return found


def load_tuned(folder: str | Path) -> Tuned:
    """Load what a finished tuning left in its directory.

    Raises:
        BadInput: it is not the directory of a tuning, one that has not finished, or one whose files are damaged.

    """
    where = Path(folder)
    if not (where / RECORD_FILE).is_file():
        raise BadInput(
            f"{folder} holds no finished tuning: name the directory that cooploc tune wrote, or run it again"
        )
    try:
        record = json.loads((where / RECORD_FILE).read_text(encoding="utf-8"))
        tried, table = (pd.read_csv(where / name) for name in (HISTORY_FILE, TABLE_FILE))
        return Tuned(where, tried, table, read_run(where / "fresh").rows, record["tuned"], record)
    except (OSError, ValueError, LookupError, TypeError) as e:
        raise BadInput(f"{folder} is damaged ({e}); the cooploc tune that wrote it writes it again") from None


def _write(file: Path, text: str) -> None:
    replace_file(file, lambda temporary: temporary.write_bytes(text.encode()))


@dataclass
class Evaluations:
    """Scores of configurations on training trials, each computed once and kept in a run directory.

    A part is one configuration on one scenario's trials, as in any run.
    """

    training: ResolvedStudy  # its study has the training seed; its cells are replaced by what is asked for
    scenarios: Mapping[str, ResolvedScenario]
    directory: RunDir
    run: Compute
    watcher: RunProgress
    objective: str
    scores: dict[Pair, float] = field(default_factory=dict)
    streams: dict[Item, str] = field(default_factory=dict)  # hashes of what tuning has seen

    def compute(self, pairs: Iterable[Pair]) -> dict[Pair, float]:
        """Return the scores of these configurations, by their labels, on these trials."""
        pairs = list(pairs)
        upto: dict[str, dict[str, int]] = {}  # of each scenario as many trials of each configuration as it needs
        for label, item in pairs:
            if (label, item) not in self.scores:
                trials = upto.setdefault(item.scenario, {})
                trials[label] = max(trials.get(label, 0), item.trial + 1)
        cells = tuple(
            ResolvedCell("training", self.scenarios[label], trials, tuple(map(configure, trials)), next(iter(trials)))
            for label, trials in upto.items()
        )
        if cells:
            asked = self.training._replace(cells=cells)
            self.directory.open(make_manifest(asked, isolate=True))
            for key, receipt in complete(asked, self.directory, self.run, Silent()):
                self._keep(key, receipt)
        return {pair: self.scores[pair] for pair in pairs}

    def _keep(self, key: PartKey, receipt: Receipt) -> None:
        rows = self.directory.read_rows({(key.scenario, key.estimator): key.trials.stop}, {key: receipt})
        scores = {Item(key.scenario, int(str(n))): float(s) for n, s in trial_scores(rows, self.objective).items()}
        new = sum((key.estimator, item) not in self.scores for item in scores)
        if new:
            self.watcher.advance(f"{key.scenario} · {key.estimator}", new, receipt.failed)
        self.scores |= {(key.estimator, item): score for item, score in scores.items()}
        hashes: pd.Series[Any] = rows.dropna(subset="stream").groupby("trial")["stream"].first()
        self.streams |= {Item(key.scenario, int(str(trial))): str(found) for trial, found in hashes.items()}


# ---- the split of streams


def derived_seed(seed: int, purpose: str) -> int:
    """Return a seed below 2^63 that does not lead back to `seed`, and differs from it."""
    for attempt in range(100):
        text = f"{seed}/{purpose}/{attempt}".encode()
        found = int.from_bytes(hashlib.blake2b(text, digest_size=8, person=b"cooploc tuning").digest(), "little") >> 1
        if found != seed:
            return found
    raise AssertionError("a hash gave the same number a hundred times")


def training(
    label: str,
    trials: int | Sequence[int] = 100,
    *,
    seed: int = 0,
    assumed: Mapping[str, Any] | None = None,
    **overrides: Any,
) -> tuple[Truth, Stream]:
    """Simulate the truth and the stream of a scenario to learn from: models, networks, tables.

    The seed is a hash of `seed`, as in `cl.tune`: it does not lead back, and no study is run under it. What an
    estimator learned belongs into a file beside it that its class names in `artifacts`; while the estimator runs, this
    function is refused, as is every other way to the truth.

    Args:
        label: a simulated scenario, such as "nlos".
        trials: how many, or their numbers.
        seed: of the experiment; the streams of two seeds have nothing in common.
        assumed, overrides: as of `simulate`.

    Raises:
        BadInput: it is a recording, of which other parts would be judged; or as `simulate`.

    """
    if family(split_family(parse(label)[0])[0]).recorded:
        raise BadInput(
            f"{label!r} is a recording, which is the same under every seed: learn from another run, by cl.simulate, "
            "and judge on this one"
        )
    return simulate(label, trials=trials, seed=derived_seed(seed, "training"), assumed=assumed, **overrides)


def lanes(cells: Iterable[ResolvedCell], training: dict[str, tuple[str, ...]], data: Path | None) -> dict[str, Lane]:
    """Return the lane of every judged scenario; one whose `training` is empty has none, and is only judged.

    Raises:
        BadInput: a recording of which the study does not say on which other it is tuned, or one that overlaps with it.

    """
    judged = {cell.scenario.label: cell.scenario for cell in cells}
    if unknown := [label for label in training if label not in judged]:
        raise BadInput(f"training names {unknown[0]!r}, which is not a scenario of the study; leave it out")
    found = {}
    for label, scenario in judged.items():
        if scenario.is_recording and label not in training:
            raise BadInput(
                f"scenario {label!r} is a recording, and tuning on the run that is judged is refused: say in the "
                f'study on which other it is tuned, training = {{ "{label}" = ["..."] }}, or [] for none'
            )
        own = tuple(resolve(one, data) for one in training[label]) if label in training else (scenario,)
        if own:
            found[label] = Lane(label, own)
    reported = [(one.label, stream) for one in judged.values() if one.is_recording for stream in _recordings(one)]
    trained = {one.label: one for lane in found.values() for one in lane.scenarios if one.is_recording and reported}
    for one in trained.values():
        for stream in _recordings(one):
            for label, other in reported:
                if overlap(stream, other):
                    raise BadInput(
                        f"training on {one.label!r} would use readings of {label!r}, which is judged: choose another "
                        "run, or parts of it that do not overlap"
                    )
    return found


def _recordings(scenario: ResolvedScenario) -> list[Stream]:
    """Return its trials, each a stream."""
    return [scenario.simulate([trial], 0)[1] for trial in range(scenario.trials(1))]


def overlap(a: Stream, b: Stream) -> bool:
    """Return whether two streams are parts of one recording that share any time, or hold the same readings.

    A recording that does not say its name counts as the same.
    """
    rssi, others = a.senses.anchor_rssi, b.senses.anchor_rssi
    if set(a.hashes) & set(b.hashes) or (rssi.size and np.array_equal(rssi, others, equal_nan=True)):
        return True
    one, other = (stream.notes.get("recording") for stream in (a, b))
    if one is not None and other is not None and one != other:
        return False
    starts = [float(stream.time[0] - stream.senses.dt[0, 0].max()) for stream in (a, b)]
    ends = [float(stream.time[-1]) for stream in (a, b)]
    return max(starts) < min(ends) - 1e-6


def require_apart(training_seed: int, seed: int, trained: Iterable[str], reported: Iterable[str]) -> None:
    """Refuse results on streams that tuning has seen.

    Raises:
        BadInput: the seeds are equal, or a hash of a stream is in both.

    """
    met = set(trained) & set(reported)
    if training_seed == seed or met:
        raise BadInput(
            f"tuning has seen {len(met)} of the reported streams (training seed {training_seed}, seed {seed}): "
            "choose another seed"
        )


# ---- the study with the tuned configurations


def tuned_study(study: Study, tuned: Mapping[str, str], seed: int, both: bool) -> Study:
    """Return the study with the tuned label of every estimator; `both`: beside its own label."""
    blocks: dict[tuple[str, tuple[str, ...], str], list[str]] = {}
    for cell in study.cells():
        labels = [name for label in cell.estimators for name in ((label, tuned[label]) if both else (tuned[label],))]
        baseline = cell.baseline if both else tuned[cell.baseline]
        blocks.setdefault((cell.experiment, tuple(dict.fromkeys(labels)), baseline), []).append(cell.scenario)
    also = tuple(
        Block(scenarios=tuple(scenarios), estimators=labels, baseline=baseline, experiment=experiment)
        for (experiment, labels, baseline), scenarios in blocks.items()
    )
    name = f"{study.name}-{'published-and-tuned' if both else 'tuned'}"
    emptied: dict[str, Any] = dict.fromkeys(("scenarios", "estimators", "only"), ())
    emptied |= {"baseline": "", "variants": {}, "minutes": None}
    return study.model_copy(update={**emptied, "name": name, "also": also, "tuned_with": seed})


def as_toml(study: Study) -> str:
    """Return the text of a study's file. A JSON string of printable characters is a TOML string of the same meaning."""
    known = study.model_dump()
    text = "# Made by cooploc tune: every estimator as it was tuned, on streams of a seed that no run may have.\n"
    text += "".join(f"{key} = {_toml(known[key])}\n" for key in ("about", "trials", "seed", "time_limit", "tuned_with"))
    for block in study.also:
        lines = {key: _toml(value) for key, value in block.model_dump().items() if value}
        text += "\n[[also]]\n" + "".join(f"{key} = {value}\n" for key, value in lines.items())
    if study.training:
        text += "\n[training]\n" + "".join(f"{_toml(key)} = {_toml(value)}\n" for key, value in study.training.items())
    return text


def _toml(value: object) -> str:
    if isinstance(value, list | tuple):
        return "[\n" + "".join(f"    {_toml(one)},\n" for one in value) + "]" if value else "[]"
    return json.dumps(value, ensure_ascii=False)
