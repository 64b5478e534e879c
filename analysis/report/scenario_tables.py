"""What scenarios are: the parameters that they share, with units, and scenario by scenario those that differ."""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from cooploc.analysis.report.parameter_meanings import MEANINGS
from cooploc.analysis.report.tables import Row, Table, numbers, words

DIFFERS = "differs"
SHOWN = 12  # characters of a stream's hash


def scenario_tables(table: pd.DataFrame, settings: Mapping[str, Mapping[str, Any]]) -> list[Table]:
    """For each kind of scenario, those that have the same parameters: its scenarios, then its parameters.

    Args:
        table: from `compare`.
        settings: the parameters of each scenario, as the manifest has them.

    """
    kinds: dict[tuple[str, ...], list[str]] = {}
    for scenario in dict.fromkeys(table["scenario"]):
        kinds.setdefault(tuple(settings.get(scenario, {})), []).append(str(scenario))
    once = table.sort_values("trials", ascending=False, kind="stable").drop_duplicates("scenario")
    facts = once.set_index("scenario").to_dict("index")
    out = []
    for i, (names, scenarios) in enumerate(kinds.items()):
        given = {scenario: settings.get(scenario, {}) for scenario in scenarios}
        unlike = [name for name in names if len({repr(one[name]) for one in given.values()}) > 1]
        ending = f"-{i + 1}" if len(kinds) > 1 else ""
        out.append(_scenarios(f"scenarios{ending}", given, [n for n in unlike if n != "robots"], facts))
        out += [_parameters(f"parameters{ending}", given, names, unlike)] if names else []
    return out


def _scenarios(name: str, given: Mapping[str, Mapping[str, Any]], unlike: list[str], facts: Any) -> Table:
    columns = (
        words("scenario"),
        numbers("robots"),
        numbers("trials"),
        words("baseline"),
        *(numbers(_with_unit(parameter), parameter) for parameter in unlike),
        words("stream", form=lambda stream: str(stream)[:SHOWN]),
    )
    rows: list[Row] = [
        {
            "scenario": scenario,
            **{key: facts[scenario][key] for key in ("robots", "trials", "baseline", "stream")},
            **{parameter: written(values[parameter]) for parameter in unlike},
        }
        for scenario, values in given.items()
    ]
    about = (
        "Scenarios, with the parameters in which they differ. Results of equal streams can be paired: the hash is over "
        "every reading, link and initial position of the trials."
    )
    return Table(name, about, columns, rows, {"data-scenario": "scenario"})


def _parameters(name: str, given: Mapping[str, Mapping[str, Any]], names: tuple[str, ...], unlike: list[str]) -> Table:
    columns = words("parameter"), words("value"), words("unit"), words("meaning")
    first = next(iter(given.values()))
    rows: list[Row] = []
    for parameter in names:
        unit, meaning = MEANINGS.get(parameter, ("", ""))
        value = DIFFERS if parameter in unlike else written(first[parameter])
        rows.append({"parameter": parameter, "value": value, "unit": unit, "meaning": meaning})
    about = "What these scenarios share; parameters that differ have their values beside each scenario, above."
    return Table(name, about, columns, rows)


def written(value: Any) -> str:
    """A parameter's value in a few words."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return f"{value:g}".replace("inf", "∞")
    if isinstance(value, list | tuple):
        nested = any(isinstance(one, list | tuple) for one in value)
        return ("; " if nested else ", ").join(map(written, value)) or "none"
    return str(value)


def _with_unit(parameter: str) -> str:
    unit = MEANINGS.get(parameter, ("", ""))[0]
    return f"{parameter} [{unit}]" if unit else parameter
