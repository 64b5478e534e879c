"""What tuning makes small: one number for a trial, of the rows of `errors`.

`nll`, mean negative log-likelihood of the true position [nats]: a proper score, so that no estimator gains by claiming
to be surer than it is (Gneiting & Raftery, J. American Statistical Association 102, 2007). A robot that collapsed onto
a wrong place can score millions and decide any mean; so beyond `CAP` a score s counts as CAP + log(1 + s - CAP), which
keeps the order. `rmse`, the logarithm of the trial's RMSE [log m]: 0.1 is about 10 %, wherever it is measured.
"""

import hashlib
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import pandas as pd
from scipy import stats

from cooploc.estimators import configure, make
from cooploc.estimators.interface import Array
from cooploc.estimators.plugins.build import ConfiguredEstimator
from cooploc.estimators.plugins.errors import BadInput, nearest
from cooploc.estimators.plugins.labels import parse
from cooploc.estimators.plugins.tunable import Tunable, Value, declared
from cooploc.scenarios import family, resolve, resolve_isolated, simulate
from cooploc.scenarios.processes.outcome import WorkerError
from cooploc.scenarios.processes.workers import call, end
from cooploc.scenarios.remote import RemoteScenario
from cooploc.scenarios.scenario import ResolvedScenario, split_family
from cooploc.scenarios.stream import Stream, Truth
from cooploc.scenarios.studies.study import ResolvedCell

CAP = 10.0  # [nats] to know nothing but a 60 m arena scores 8.2
LARGEST = 1e6  # [nats], [m]: what a failed trial counts as


def trial_scores(rows: pd.DataFrame, objective: str) -> "pd.Series[float]":
    """The score of every trial, by its number; a trial that failed has the worst.

    Raises:
        BadInput: there is no such objective.

    """
    if objective not in OBJECTIVES:
        raise BadInput(f"there is no objective {objective!r}; {nearest(objective, list(OBJECTIVES))}")
    column, score, after = OBJECTIVES[objective]
    there = rows if column in rows else rows.assign(**{column: np.nan})  # lacking where no trial succeeded
    values = there[column].where(rows["failure"].isna(), np.inf)
    weight = rows["ticks"].fillna(1).to_numpy(float)  # of a trial that failed nothing is known
    known = weight > 0
    trials, of = np.unique(rows["trial"].to_numpy()[known], return_inverse=True)
    total = np.bincount(of, weight[known] * score(values.to_numpy(float)[known]))
    return pd.Series(after(total / np.bincount(of, weight[known])), index=trials)


def cap_score(nll: Array) -> Array:
    """Scores [nats] that grow as their logarithm beyond `CAP`; what is not a number is the worst."""
    finite = np.minimum(np.nan_to_num(nll, nan=np.inf), LARGEST)
    return np.asarray(np.where(finite > CAP, CAP + np.log1p(np.maximum(finite - CAP, 0.0)), finite))


def _bounded_squares(mse: Array) -> Array:
    return np.asarray(np.minimum(np.nan_to_num(mse, nan=np.inf), LARGEST**2))


def _same(score: Array) -> Array:
    return score


def _log_root(mse: Array) -> Array:
    return np.asarray(np.log(np.maximum(mse, 1e-12)) / 2)


# name -> column of `errors`, what a robot's value counts as, what becomes of the trial's mean
OBJECTIVES: dict[str, tuple[str, Callable[[Array], Array], Callable[[Array], Array]]] = {
    "nll": ("nll", cap_score, _same),
    "rmse": ("mse", _bounded_squares, _log_root),
}
UNITS = {"nll": "nats", "rmse": "log m"}


# What is tuned of a configured estimator: the parameters that its class declares, but for those that its label states.
#
# `mrsl-rssi[K=1]` keeps K=1, whatever is tried of the others. Values have four significant digits, so that a label says
# exactly what was run.

DIGITS = 4  # significant ones of a number that is tried
# [s] to import what is not built in


@dataclass(frozen=True)
class Space:
    """An estimator as published, and what may be tried instead."""

    published: ConfiguredEstimator
    parameters: Mapping[str, Tunable]

    def label(self, values: Mapping[str, Value]) -> str:
        """The label of a configuration; that of the published one where nothing differs from it."""
        changed = {key: value for key, value in values.items() if value != self.parameters[key].default}
        if not changed:
            return self.published.label
        written = {**self.published.parameters, **{key: _value_text(value) for key, value in sorted(changed.items())}}
        return f"{self.published.name}[{','.join(f'{key}={value}' for key, value in written.items())}]"


def space_of(label: str, isolate: bool = True) -> Space:
    """The space of a label; with `isolate`, what is not built in is imported by a process of its own.

    Raises:
        BadInput: it cannot be made.

    """
    one = configure(label)
    if one.builtin or not isolate:
        return Space(one, _declared_parameters(label))
    try:
        return Space(one, call(one.name, _declared_parameters, label, seconds=IMPORT_LIMIT))
    except WorkerError as e:
        raise BadInput(f"{label!r} cannot be imported or made: {e}") from None


def round_digits(value: float) -> float:
    """A number with the digits that a label shows."""
    return float(f"{value:.{DIGITS}g}")


def _declared_parameters(label: str) -> dict[str, Tunable]:
    stated = configure(label).parameters
    return {name: one for name, one in declared(make(label)).items() if name not in stated}


def _value_text(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)


# Which configuration to try next: optuna's tree-structured Parzen estimator, asked and told.
#
# Source: J. Bergstra et al., "Algorithms for hyper-parameter optimization", NIPS 2011; T. Akiba et al., "Optuna: a
# next-generation hyperparameter optimization framework", KDD 2019.

RANDOM = 8  # first configurations, drawn uniformly
AGAIN = 20  # times that a known configuration may be proposed before the space counts as exhausted


class Sampler:
    """Proposes configurations of one space; the same seed and the same answers give the same proposals."""

    def __init__(self, space: Space, seed: int) -> None:
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self.space = space
        self._study = optuna.create_study(
            sampler=optuna.samplers.TPESampler(n_startup_trials=RANDOM, seed=seed % 2**32)
        )
        self._asked: dict[str, Any] = {}  # label -> optuna's trial, until it is told
        self._known: dict[str, float | None] = {}  # label -> its value, once it is known

    def propose(self) -> str | None:
        """The label of a configuration that was not proposed before; None where there seems to be no other."""
        if not self.space.parameters:
            return None
        for _ in range(AGAIN):
            trial = self._study.ask()
            label = self.space.label({key: _suggest(trial, key, one) for key, one in self.space.parameters.items()})
            if label not in self._known:
                self._known[label], self._asked[label] = None, trial
                return label
            if (value := self._known[label]) is not None:
                self._study.tell(trial, value)
        return None

    def tell(self, label: str, value: float) -> None:
        """How a configuration fared; smaller is better."""
        self._known[label] = value
        if label in self._asked:
            self._study.tell(self._asked.pop(label), value)

    def know(self, label: str, values: Mapping[str, Value]) -> None:
        """A configuration whose value is 0, to begin with."""
        import optuna

        self._known[label] = 0.0
        spaces = {key: _distribution(one) for key, one in self.space.parameters.items()}
        if spaces and all(spaces[key]._contains(spaces[key].to_internal_repr(values[key])) for key in spaces):
            self._study.add_trial(optuna.create_trial(params=dict(values), distributions=spaces, value=0.0))


def _distribution(one: Tunable) -> Any:
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if one.choices:
        return CategoricalDistribution(one.choices)
    if one.whole:
        return IntDistribution(int(one.low), int(one.high), log=one.log)
    return FloatDistribution(one.low, one.high, log=one.log)


def _suggest(trial: Any, key: str, one: Tunable) -> Value:
    if one.choices:
        value: Value = trial.suggest_categorical(key, one.choices)
        return value
    if one.whole:
        return int(trial.suggest_int(key, int(one.low), int(one.high), log=one.log))
    return round_digits(trial.suggest_float(key, one.low, one.high, log=one.log))


# A race between configurations of one estimator: all on the same streams, round by round; hopeless ones stop early.
#
# A round is one training trial of every scenario. The configuration as published runs all rounds first; then small
# batches of others enter at one round and go on to two, four and so on, unless their paired differences to the best so
# far show that they are worse. One that survives all rounds is chosen where it is the best, and its paired
# differences to
# the configuration as published show that it is better; so chance alone seldom moves an estimator. Every trial counts
# in
# the budget, also those of configurations that were stopped; what is left at the end, too little for all rounds of one
# more, stays unused.
#
# Source: O. Maron, A. Moore, "The racing algorithm: model selection for lazy learners", AI Review 11, 1997; M.
# Birattari
# et al., "A racing algorithm for configuring metaheuristics", GECCO 2002.

BATCH = 4  # configurations that enter together at most, whatever the number of processes
SHARE = 6  # the configuration as published uses at most one in so many of the budget's trials
MOST_ROUNDS = 64
LEAST = 3  # differences that can show a configuration to be better or worse than another
SURE = 0.95  # of the one-sided interval that does


class Item(NamedTuple):
    """One training trial."""

    scenario: str
    trial: int


class Lane(Protocol):
    """The training trials that stand for one scenario."""

    def item(self, number: int) -> Item:
        """The trial of a round; recordings that are used up come again."""
        ...


Wanted = Mapping[str, Sequence[Item]]  # by a configuration's label
Scores = Mapping[tuple[str, Item], float]
Race = Generator[Wanted, Scores, "Finish"]


@dataclass
class Entrant:
    """A configuration and how it fared."""

    number: int
    label: str
    rounds: int = 0
    state: str = "running"  # then "finished", or "stopped" before all rounds
    spent: int = 0  # trials of the budget that were used when it ended
    best: bool = False  # whether it was the best of all until then
    scores: dict[Item, float] = field(default_factory=dict)

    def missing(self, lanes: Sequence[Lane], rounds: int) -> list[Item]:
        """The trials of these rounds that it has not run."""
        items = [lane.item(k) for k in range(rounds) for lane in lanes]
        return [item for item in dict.fromkeys(items) if item not in self.scores]

    def mean(self, lanes: Sequence[Lane], rounds: int) -> float:
        """Its mean score over these rounds; every scenario counts the same."""
        return float(np.mean([self.scores[lane.item(k)] for k in range(rounds) for lane in lanes]))


class Finish(NamedTuple):
    """How a race ended."""

    entrants: list[Entrant]  # the first is the configuration as published
    best: Entrant
    rounds: int
    spent: int


def full_rounds(budget: int, lanes: int) -> int:
    """The rounds that a configuration must survive; 0 where the budget does not suffice for one."""
    return 0 if budget < lanes else min(MOST_ROUNDS, max(1, budget // (SHARE * lanes)))


def race(lanes: Sequence[Lane], budget: int, sampler: Sampler) -> Race:
    """Yields the trials that are wanted, is sent their scores, returns the finish."""
    full = full_rounds(budget, len(lanes))
    published = Entrant(0, sampler.space.published.label)
    entrants, best, left = [published], published, budget
    left -= yield from _run([published], lanes, full)
    _end(published, "finished", budget - left, True)
    values = {key: one.default for key, one in sampler.space.parameters.items()}
    sampler.know(published.label, values)
    while batch := _next_entrants(sampler, len(entrants), left // (full * len(lanes))):
        entrants += batch
        alive = list(batch)
        for rounds in _rungs(full):
            left -= yield from _run(alive, lanes, rounds)
            for one in [one for one in alive if shown_worse(one, best)]:
                alive.remove(one)
                _end(one, "stopped", budget - left, False)
        for one in alive:
            better = shown_worse(published, one) and one.mean(lanes, full) < best.mean(lanes, full)
            best = one if better else best
            _end(one, "finished", budget - left, better)
        for one in batch:
            sampler.tell(one.label, one.mean(lanes, one.rounds) - published.mean(lanes, one.rounds))
    return Finish(entrants, best, full, budget - left)


def shown_worse(one: Entrant, other: Entrant) -> bool:
    """Whether paired differences on the trials that both ran show `one` to be worse: a one-sided t interval above 0."""
    d: Array = np.array([score - other.scores[item] for item, score in one.scores.items() if item in other.scores])
    if len(d) < LEAST or not d.mean() > 0:
        return False
    return bool(d.mean() > stats.t.ppf(SURE, len(d) - 1) * d.std(ddof=1) / np.sqrt(len(d)))


def _run(entrants: Sequence[Entrant], lanes: Sequence[Lane], rounds: int) -> Generator[Wanted, Scores, int]:
    """Let them run up to so many rounds; returns the trials that this took."""
    wanted = {one.label: one.missing(lanes, rounds) for one in entrants}
    found = (yield wanted) if any(wanted.values()) else {}
    for one in entrants:
        one.scores |= {item: found[one.label, item] for item in wanted[one.label]}
        one.rounds = rounds
    return sum(map(len, wanted.values()))


def _rungs(full: int) -> list[int]:
    """1, 2, 4 and so on, and all rounds."""
    return [*(2**k for k in range(full.bit_length()) if 2**k < full), full]


def _next_entrants(sampler: Sampler, known: int, affordable: int) -> list[Entrant]:
    """The next configurations, of which all may have to run all rounds."""
    labels = (sampler.propose() for _ in range(min(BATCH, affordable)))
    return [Entrant(known + i, label) for i, label in enumerate(label for label in labels if label)]


def _end(one: Entrant, state: str, spent: int, best: bool) -> None:
    one.state, one.spent, one.best = state, spent, best


# The streams that estimators are tuned on, which never meet those that results are reported of.
#
# Simulated streams come from a seed of their own, a hash of the study's seed that does not lead back to it. A recording
# has no seed: the study says in `training` on which other recordings, or other parts of one, it is tuned, and a part
# that
# overlaps with what is judged is refused.

Resolved = ResolvedScenario | RemoteScenario
IMPORT_LIMIT = 600.0  # [s] to read a recording that is not built in


def derived_seed(seed: int, purpose: str) -> int:
    """A seed below 2^63 that does not lead back to `seed`, and differs from it."""
    for attempt in range(100):
        text = f"{seed}/{purpose}/{attempt}".encode()
        found = int.from_bytes(hashlib.blake2b(text, digest_size=8, person=b"cooploc tuning").digest(), "little") >> 1
        if found != seed:
            return found
    raise AssertionError("a hash gave the same number a hundred times")


@dataclass(frozen=True)
class TrainingLane:
    """The training trials that stand for one judged scenario: its scenarios in turn."""

    judged: str
    scenarios: tuple[Resolved, ...]

    def item(self, number: int) -> Item:
        """The trial of a round; recordings that are used up come again."""
        one = self.scenarios[number % len(self.scenarios)]
        trial = number // len(self.scenarios)
        return Item(one.label, trial % one.trials(1) if one.recorded else trial)


def lanes(
    cells: Iterable[ResolvedCell], training: dict[str, tuple[str, ...]], data: Path | None, isolate: bool
) -> dict[str, TrainingLane]:
    """The lane of every judged scenario; a scenario whose `training` is empty has none, and is only judged.

    Raises:
        BadInput: a recording of which the study does not say on which other it is tuned, or one that overlaps with it.

    """
    cells = list(cells)
    judged = {cell.scenario.label: cell.scenario for cell in cells}
    if unknown := [label for label in training if label not in judged]:
        raise BadInput(f"training names {unknown[0]!r}, which is not a scenario of the study; leave it out")
    read = resolve_isolated if isolate else resolve
    found = {}
    for label, scenario in judged.items():
        if scenario.recorded and label not in training:
            raise BadInput(
                f"scenario {label!r} is a recording, and tuning on the run that is judged is refused: say in the "
                f'study on which other it is tuned, training = {{ "{label}" = ["..."] }}, or [] for none'
            )
        own = tuple(read(one, data) for one in training[label]) if label in training else (scenario,)
        if own:
            found[label] = TrainingLane(label, own)
    _demand_other_recordings(list(judged.values()), [one for lane in found.values() for one in lane.scenarios])
    return found


def _demand_other_recordings(judged: Sequence[Resolved], trained: Sequence[Resolved]) -> None:
    """Refuse to train on any part of a recording that is judged.

    Raises:
        BadInput: two overlap; says which.

    """
    reported = [(one.label, stream) for one in judged if one.recorded for stream in _recordings(one)]
    if not reported:
        return
    for one in {one.label: one for one in trained if one.recorded}.values():
        for stream in _recordings(one):
            for label, other in reported:
                if overlap(stream, other):
                    raise BadInput(
                        f"training on {one.label!r} would use readings of {label!r}, which is judged: choose another "
                        "run, or parts of it that do not overlap"
                    )


def _recordings(scenario: Resolved) -> list[Stream]:
    """Its trials, each a stream; what is not built in is read by a process of its own."""
    trials = range(scenario.trials(1))
    if isinstance(scenario, ResolvedScenario):
        return [scenario.simulate([trial], 0)[1] for trial in trials]
    owner = f"simulate {scenario.name}"
    found = [call(owner, scenario.simulate, [trial], 0, seconds=IMPORT_LIMIT)[1] for trial in trials]
    end(owner)
    return found


def overlap(a: Stream, b: Stream) -> bool:
    """Whether two streams are parts of one recording that share any time, or hold the same readings.

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


def demand_apart(training_seed: int, seed: int, trained: Iterable[str], reported: Iterable[str]) -> None:
    """Refuse results of which tuning saw a stream.

    Raises:
        BadInput: the seeds are equal, or a hash of a stream is in both.

    """
    met = set(trained) & set(reported)
    if training_seed == seed or met:
        raise BadInput(
            f"tuning has seen {len(met)} of the reported streams (training seed {training_seed}, seed {seed}): "
            "choose another seed"
        )


# Streams with their truth, to learn from: of seeds that no result is reported of.


def training(
    label: str,
    trials: int | Sequence[int] = 100,
    *,
    seed: int = 0,
    assumed: Mapping[str, Any] | None = None,
    **overrides: Any,
) -> tuple[Truth, Stream]:
    """The truth and the stream of a scenario, to learn from: models, networks, tables.

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


# The races of all estimators, side by side: each has the same budget, the same streams and the same sampler's seed.

Compute = Callable[[Iterable[tuple[str, Item]]], Mapping[tuple[str, Item], float]]


class Competitor(NamedTuple):
    """An estimator of a study, and the scenarios that it is tuned on."""

    space: Space
    lanes: Sequence[Lane]


def search(competitors: Sequence[Competitor], budget: int, seed: int, compute: Compute) -> list[Finish]:
    """The finish of every competitor's race, in order.

    Raises:
        BadInput: the budget does not suffice for one trial of every scenario.

    """
    for one in competitors:
        if not full_rounds(budget, len(one.lanes)):
            raise BadInput(
                f"the budget is {budget} trials, and {one.space.published.label!r} is tuned on {len(one.lanes)} "
                f"scenarios: give at least --budget {len(one.lanes)}"
            )
    races = {i: race(one.lanes, budget, Sampler(one.space, seed)) for i, one in enumerate(competitors)}
    finished: dict[int, Finish] = {}
    wanted: dict[int, Wanted] = {}
    for i, begun in races.items():
        _advance(i, begun, None, wanted, finished)
    while wanted:
        scores = compute([(label, item) for asked in wanted.values() for label in asked for item in asked[label]])
        for i in list(wanted):
            _advance(i, races[i], scores, wanted, finished)
    return [finished[i] for i in range(len(competitors))]


def _advance(
    i: int,
    one: Race,
    scores: Mapping[tuple[str, Item], float] | None,
    wanted: dict[int, Wanted],
    finished: dict[int, Finish],
) -> None:
    """Take one race to the next trials that it wants, or to its finish."""
    try:
        wanted[i] = next(one) if scores is None else one.send(scores)
    except StopIteration as end:
        wanted.pop(i, None)
        finished[i] = end.value
