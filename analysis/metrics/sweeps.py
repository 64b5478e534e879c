"""Sweeps: the numbers in which labels of scenarios or estimators differ alone, "nlos[eta=2]", "nlos[eta=3]"."""

import re
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")


class SweepPoint(NamedTuple):
    """A value in a label that other labels may replace by another."""

    family: str  # the label without the parameter
    parameter: str  # empty: none
    value: float  # nan: none


def add_sweep(table: pd.DataFrame, column: str = "scenario") -> pd.DataFrame:
    """Return the table with `family`, `parameter` and `value` of the labels in a column, as of `sweeps`."""
    found = sweeps(table[column])
    rows = [found[label] for label in table[column]]
    return table.assign(**dict(zip(SweepPoint._fields, map(list, zip(*rows, strict=True)), strict=True)))


def sweeps(labels: Iterable[str]) -> dict[str, SweepPoint]:
    """Return what each label sweeps: the number in which the most labels differ alone, of equally many the first.

    A label that differs from all others in more than a number has no parameter, and is its own family.
    """
    points = {label: sweep_points(label) for label in dict.fromkeys(labels)}
    alike = Counter(one[:2] for found in points.values() for one in found)
    out = {}
    for label, found in points.items():
        one = max(found, key=lambda point: alike[point[:2]], default=None)
        out[label] = one if one is not None and alike[one[:2]] > 1 else SweepPoint(label, "", np.nan)
    return out


def sweep_points(label: str) -> list[SweepPoint]:
    """Return the numbers of a label, that of "family/n=3" before those in brackets; none of any other text."""
    bracketed = re.fullmatch(r"([^\[\]]+)\[([^\[\]]*)\]", label)
    path, options = (bracketed[1], [one.strip() for one in bracketed[2].split(",")]) if bracketed else (label, [])
    before, slash, last = path.rpartition("/")
    found = [(before, options, last)] if slash else []
    found += [(path, options[:k] + options[k + 1 :], one) for k, one in enumerate(options)]
    points = []
    for name, rest, one in found:
        parameter, _, value = one.partition("=")
        if NUMBER.fullmatch(value):
            points.append(SweepPoint(f"{name}[{','.join(rest)}]" if rest else name, parameter, float(value)))
    return points
