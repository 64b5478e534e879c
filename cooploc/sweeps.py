"""Sweeps from Python: one table of errors over several values of a scenario's parameters."""

from collections.abc import Iterable, Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cooploc.analysis.metrics.errors import errors
from cooploc.estimators.plugins.errors import BadInput
from cooploc.scenarios import family, simulate
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.scenario import split_family


def sweep(
    scenario: str,
    estimators: Any,
    *,
    trials: int = 1,
    seed: int = 0,
    jobs: int = 1,
    data: str | Path | None = None,
    **parameters: Any,
) -> pd.DataFrame:
    """The errors of estimators over a sweep, such as `cl.sweep("packet-drop", ["arl", "ctrn"], drop={0, 0.5, 0.9})`.

    Every parameter of which a set, a list, a range or an array is given takes each of these values; of several, all
    combinations are run. Trials are paired over the sweep, too: they start from the same random numbers.

    Columns: those of `cl.errors`, and one for each swept parameter.

    Args:
        scenario: its label, such as "packet-drop".
        estimators: as for `cl.run`.
        trials: how many.
        seed: random seed.
        jobs: processes, as for `cl.run`.
        data: the directory of a recording.
        parameters: of the scenario, by the names that its label or its table of parameters has.

    Raises:
        BadInput: nothing is swept, a sweep is empty, or a parameter is unknown.

    """
    swept = {name: _values(name, value) for name, value in parameters.items() if _several(value)}
    if not swept:
        raise BadInput("nothing is swept: give several values of a parameter, such as drop={0, 0.5}")
    fixed = {name: value for name, value in parameters.items() if name not in swept}
    tables = []
    for values in product(*swept.values()):
        chosen = dict(zip(swept, values, strict=True))
        label, overrides = _labelled(scenario, {**fixed, **chosen})
        truth, stream = simulate(label, trials=trials, seed=seed, data=data, **overrides)
        table = errors(truth, run(estimators, stream, jobs=jobs))
        tables.append(table.assign(**{name: value for name, value in chosen.items() if name not in table}))
    return pd.concat(tables, ignore_index=True)


def _several(value: Any) -> bool:
    return isinstance(value, set | frozenset | list | range | np.ndarray)


def _values(name: str, given: Iterable[Any]) -> list[Any]:
    values = [value.item() if isinstance(value, np.generic) else value for value in given]
    if not values:
        raise BadInput(f"{name} is empty: there is nothing to sweep")
    return sorted(values) if isinstance(given, set | frozenset) else values


def _labelled(scenario: str, parameters: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The label with the parameter that its family sweeps, as studies write it, and all others as overrides."""
    path, bracket, options = scenario.partition("[")
    name, which = split_family(path)
    words = family(name).sweep
    first = next((key for key in parameters if key in words), None)
    if which or first is None:
        return scenario, {words.get(key, key): value for key, value in parameters.items()}
    others = {words.get(key, key): value for key, value in parameters.items() if key != first}
    return f"{path}/{first}={parameters[first]}{bracket}{options}", others
