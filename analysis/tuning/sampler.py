"""Which configuration to try next: optuna's tree-structured Parzen estimator, asked and told.

Source: J. Bergstra et al., "Algorithms for hyper-parameter optimization", NIPS 2011; T. Akiba et al., "Optuna: a
next-generation hyperparameter optimization framework", KDD 2019.
"""

from collections.abc import Mapping
from typing import Any

from cooploc.analysis.tuning.space import Space, rounded
from cooploc.estimators.plugins.tunable import Tunable, Value

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
            label = self.space.label({key: _suggested(trial, key, one) for key, one in self.space.parameters.items()})
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


def _suggested(trial: Any, key: str, one: Tunable) -> Value:
    if one.choices:
        value: Value = trial.suggest_categorical(key, one.choices)
        return value
    if one.whole:
        return int(trial.suggest_int(key, int(one.low), int(one.high), log=one.log))
    return rounded(trial.suggest_float(key, one.low, one.high, log=one.log))
