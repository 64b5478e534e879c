"""The search for better parameters of one estimator: what may be tried, what a trial scores, and the race.

Every estimator has a race of its own, with the same budget of trials on the same training streams. A round of it is
one trial of every scenario. The configuration as shipped runs all rounds first; then small batches of others,
proposed by optuna's tree-structured Parzen estimator, enter at one round and go on to two, four and so on, unless
their paired differences to the best so far show that they are worse. One that survives all rounds is chosen where it
is the best, and its paired differences to the shipped configuration show that it is better; so chance alone seldom
moves an estimator. Every trial counts in the budget, also those of configurations that were stopped.

A trial scores one number, smaller is better. `nll`, the mean negative log-likelihood of the true position [nats], is a
proper score: no estimator gains by claiming to be surer than it is. A robot that collapsed onto a wrong place can score
millions and decide any mean; so beyond `CAP` a score s counts as CAP + log(1 + s - CAP), which keeps the order. `rmse`
is the logarithm of the trial's RMSE [log m]: 0.1 is about 10 %, wherever it is measured.

Sources: O. Maron, A. Moore, "The racing algorithm: model selection for lazy learners", AI Review 11, 1997; M. Birattari
et al., "A racing algorithm for configuring metaheuristics", GECCO 2002; J. Bergstra et al., "Algorithms for
hyper-parameter optimization", NIPS 2011; T. Akiba et al., "Optuna", KDD 2019; T. Gneiting, A. Raftery, "Strictly proper
scoring rules", J. American Statistical Association 102, 2007.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.special import stdtrit

from cooploc.estimators import configure, make
from cooploc.estimators.building import ConfiguredEstimator
from cooploc.estimators.errors import BadInput, nearest
from cooploc.estimators.interface import Array
from cooploc.estimators.label_syntax import write_label
from cooploc.estimators.tunable import Tunable, Value, declarations
from cooploc.scenarios.process import PLUGINS, WorkerError, call
from cooploc.scenarios.scenario import ResolvedScenario

CAP = 10.0  # [nats] to know nothing but a 60 m arena scores 8.2
LARGEST = 1e6  # [nats], [m]: what a failed trial counts as
DIGITS = 4  # significant ones of a number that is tried, so that a label says exactly what was run
IMPORT_LIMIT = 600.0  # [s] to import what is not built in
RANDOM = 8  # first configurations, drawn uniformly
AGAIN = 20  # times that a known configuration may be proposed before the space counts as exhausted
BATCH = 4  # configurations that enter together at most, whatever the number of processes
SHARE = 6  # the configuration as shipped uses at most one in so many of the budget's trials
MOST_ROUNDS = 64
LEAST = 3  # differences that can show a configuration to be better or worse than another
SURE = 0.95  # of the one-sided interval that does


# ---- what a trial scores


def trial_scores(rows: pd.DataFrame, objective: str) -> "pd.Series[float]":
    """Return the score of every trial, by its number; a trial that failed has the worst."""
    column, score, after = OBJECTIVES[require_objective(objective)]
    there = rows if column in rows else rows.assign(**{column: np.nan})  # lacking where no trial succeeded
    values = there[column].where(rows["failure"].isna(), np.inf)
    weight = rows["ticks"].fillna(1).to_numpy(float)  # of a trial that failed nothing is known
    known = weight > 0
    trials, of = np.unique(rows["trial"].to_numpy()[known], return_inverse=True)
    total = np.bincount(of, weight[known] * score(values.to_numpy(float)[known]))
    return pd.Series(after(total / np.bincount(of, weight[known])), index=trials)


def require_objective(objective: str) -> str:
    """Return a name of `OBJECTIVES`; refuse another."""
    if objective not in OBJECTIVES:
        raise BadInput(f"there is no objective {objective!r}; {nearest(objective, list(OBJECTIVES))}")
    return objective


def cap_score(nll: Array) -> Array:
    """Return scores [nats] that grow as their logarithm beyond `CAP`; what is not a number is the worst."""
    finite = np.minimum(np.nan_to_num(nll, nan=np.inf), LARGEST)
    return np.asarray(np.where(finite > CAP, CAP + np.log1p(np.maximum(finite - CAP, 0.0)), finite))


# name -> column of `errors`, what a robot's value counts as, what becomes of the trial's mean
OBJECTIVES: dict[str, tuple[str, Callable[[Array], Array], Callable[[Array], Array]]] = {
    "nll": ("nll", cap_score, np.asarray),
    "rmse": (
        "mse",
        lambda mse: np.asarray(np.minimum(np.nan_to_num(mse, nan=np.inf), LARGEST**2)),
        lambda mse: np.asarray(np.log(np.maximum(mse, 1e-12)) / 2),
    ),
}


# ---- what may be tried


@dataclass(frozen=True)
class Space:
    """An estimator as shipped, and the parameters that its class declares, but for those that its label states.

    `mrsl-rssi[K=1]` keeps K=1, whatever is tried of the others.
    """

    shipped: ConfiguredEstimator
    parameters: Mapping[str, Tunable]

    def label(self, values: Mapping[str, Value]) -> str:
        """Return the label of a configuration; that of the shipped one where nothing differs from it."""
        changed = {key: value for key, value in values.items() if value != self.parameters[key].default}
        if not changed:
            return self.shipped.label
        written = dict(self.shipped.parameters)
        for key, value in sorted(changed.items()):
            text = f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)
            written[key] = text.lower() if isinstance(value, bool) else text
        name = self.shipped.label.partition("[")[0]
        return write_label(name, written)


def space_of(label: str, isolate: bool = True) -> Space:
    """Return the space of a label; with `isolate`, what is not built in is imported by a process of its own."""
    one = configure(label)
    if one.builtin or not isolate:
        return Space(one, _parameters_of(label))
    try:
        return Space(one, call(PLUGINS, _parameters_of, label, seconds=IMPORT_LIMIT))
    except WorkerError as e:
        raise BadInput(f"{label!r} cannot be imported or made: {e}") from None


def _parameters_of(label: str) -> dict[str, Tunable]:
    stated = configure(label).parameters
    return {name: one for name, one in declarations(make(label)).items() if name not in stated}


class Sampler:
    """Proposes configurations of one space; the same seed and the same scores give the same proposals.

    It begins with the shipped configuration, whose score is 0, as all others are relative to it.
    """

    def __init__(self, space: Space, seed: int) -> None:
        with warnings.catch_warnings():  # of tqdm, which optuna imports, that a notebook lacks a progress bar
            warnings.simplefilter("ignore")
            import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self.space = space
        self._ranges = {key: _distribution(one) for key, one in space.parameters.items()}
        self._study = optuna.create_study(
            sampler=optuna.samplers.TPESampler(n_startup_trials=RANDOM, seed=seed % 2**32)
        )
        self._asked: dict[str, Any] = {}  # label -> optuna's trial, until its score is known
        self._known: dict[str, float | None] = {space.shipped.label: 0.0}  # label -> its score, once it is known
        values = {key: one.default for key, one in space.parameters.items()}
        if values and all(one._contains(one.to_internal_repr(values[key])) for key, one in self._ranges.items()):
            self._study.add_trial(optuna.create_trial(params=values, distributions=self._ranges, value=0.0))

    def propose(self) -> str | None:
        """Return the label of a configuration that was not proposed before; None where there seems to be no other."""
        for _ in range(AGAIN if self.space.parameters else 0):
            trial = self._study.ask(self._ranges)
            values = trial.params.items()
            label = self.space.label({k: float(f"{v:.{DIGITS}g}") if isinstance(v, float) else v for k, v in values})
            if label not in self._known:
                self._known[label], self._asked[label] = None, trial
                return label
            if (value := self._known[label]) is not None:
                self._study.tell(trial, value)
        return None

    def tell(self, label: str, value: float) -> None:
        """Learn the score of a configuration that was proposed."""
        self._known[label] = value
        self._study.tell(self._asked.pop(label), value)


def _distribution(one: Tunable) -> Any:
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if one.choices:
        return CategoricalDistribution(one.choices)
    if one.whole:
        return IntDistribution(int(one.low), int(one.high), log=one.log)
    return FloatDistribution(one.low, one.high, log=one.log)


# ---- the race


class Item(NamedTuple):
    """One training trial."""

    scenario: str
    trial: int


@dataclass(frozen=True)
class Lane:
    """The training trials that stand for one judged scenario: those of its training scenarios in turn."""

    judged: str
    scenarios: tuple[ResolvedScenario, ...]

    def item(self, number: int) -> Item:
        """Return the trial of a round; recordings that are used up come again."""
        one = self.scenarios[number % len(self.scenarios)]
        trial = number // len(self.scenarios)
        return Item(one.label, trial % one.trials(1) if one.is_recording else trial)


Pair = tuple[str, Item]  # a configuration's label, and a trial
Scorer = Callable[[Iterable[Pair]], Mapping[Pair, float]]  # scores of configurations on trials


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

    def mean(self, lanes: Sequence[Lane], rounds: int) -> float:
        """Return its mean score over these rounds; every scenario counts the same."""
        return float(np.mean([self.scores[lane.item(k)] for k in range(rounds) for lane in lanes]))


class Finish(NamedTuple):
    """The end of a race."""

    space: Space
    lanes: Sequence[Lane]
    entrants: list[Entrant]  # the first is the configuration as shipped
    best: Entrant
    rounds: int
    spent: int

    @property
    def shipped(self) -> str:
        """The label of the estimator as the study has it."""
        return self.space.shipped.label


def full_rounds(budget: int, lanes: int) -> int:
    """Return the rounds that a configuration must survive."""
    return min(MOST_ROUNDS, max(1, budget // (SHARE * lanes)))


def race(space: Space, lanes: Sequence[Lane], budget: int, seed: int, compute: Scorer) -> Finish:
    """Search for a better configuration of one estimator with so many trials; `seed` is the sampler's."""
    full = full_rounds(budget, len(lanes))
    rungs = [*(2**k for k in range(full.bit_length()) if 2**k < full), full]
    sampler, shipped = Sampler(space, seed), Entrant(0, space.shipped.label)
    entrants, best, left = [shipped], shipped, budget
    left -= _run_rounds([shipped], lanes, full, compute)
    shipped.state, shipped.spent, shipped.best = "finished", budget - left, True
    while affordable := min(BATCH, left // (full * len(lanes))):
        labels = [label for label in (sampler.propose() for _ in range(affordable)) if label]
        batch = [Entrant(len(entrants) + i, label) for i, label in enumerate(labels)]
        if not batch:
            break
        entrants += batch
        alive = list(batch)
        for rounds in rungs:
            left -= _run_rounds(alive, lanes, rounds, compute)
            for one in [one for one in alive if is_worse(one, best)]:
                alive.remove(one)
                one.state, one.spent = "stopped", budget - left
        for one in alive:
            one.best = is_worse(shipped, one) and one.mean(lanes, full) < best.mean(lanes, full)
            one.state, one.spent, best = "finished", budget - left, one if one.best else best
        for one in batch:
            sampler.tell(one.label, one.mean(lanes, one.rounds) - shipped.mean(lanes, one.rounds))
    return Finish(space, lanes, entrants, best, full, budget - left)


def _run_rounds(entrants: Sequence[Entrant], lanes: Sequence[Lane], rounds: int, compute: Scorer) -> int:
    """Let entrants run up to so many rounds; return the number of trials that this took."""
    items = dict.fromkeys(lane.item(k) for k in range(rounds) for lane in lanes)
    wanted = [(one.label, item) for one in entrants for item in items if item not in one.scores]
    found = compute(wanted) if wanted else {}
    for one in entrants:
        one.scores |= {item: found[one.label, item] for item in items if item not in one.scores}
        one.rounds = rounds
    return len(wanted)


def is_worse(one: Entrant, other: Entrant) -> bool:
    """Return whether paired differences on the trials that both ran show `one` to be worse: a one-sided t interval."""
    d: Array = np.array([score - other.scores[item] for item, score in one.scores.items() if item in other.scores])
    if len(d) < LEAST or not d.mean() > 0:
        return False
    return bool(d.mean() > stdtrit(len(d) - 1, SURE) * d.std(ddof=1) / np.sqrt(len(d)))
