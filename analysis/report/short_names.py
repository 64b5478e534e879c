"""Short labels for long configured estimators, on the page alone: files keep the labels in full.

A configuration that the study names ("raw" for "anchor_reading=rssi") is written with that name, `ekf-local[raw]`. Of
others that are longer than `LONGEST`, the one that is its method's best is `mrsl-rssi[best]`, and the rest get numbers,
`mrsl-rssi[#2]`. The page's list of estimators is the legend.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from cooploc.estimators.listing import standing

LONGEST = 24  # characters that fit into a column


@dataclass(frozen=True)
class ShortNames:
    """Labels in full and, of those that have one, their short label."""

    known: Mapping[str, str]  # label -> short label

    def of(self, label: str) -> str:
        """The short label, or the label itself."""
        return self.known.get(label, label)

    def within(self, text: str) -> str:
        """A text with every label that has a short one replaced by it."""
        return self._pattern.sub(lambda found: self.known[found[0]], text) if self.known else text

    @cached_property
    def _pattern(self) -> re.Pattern[str]:
        return re.compile("|".join(map(re.escape, sorted(self.known, key=len, reverse=True))))


def short_names(labels: Iterable[str], variants: Mapping[str, str]) -> ShortNames:
    """The short labels of estimators, each used once; `variants`: the study's name of a configuration -> parameters."""
    labels = list(dict.fromkeys(labels))
    named = {_sorted(parameters): name for name, parameters in variants.items()}
    known: dict[str, str] = {}
    taken = set(labels)
    count: dict[str, int] = {}
    for label in labels:
        method, bracket, inside = label.partition("[")
        if not bracket:
            continue
        count[method] = count.get(method, 0) + 1
        name = named.get(_sorted(inside.removesuffix("]")), "")
        if not name and len(label) <= LONGEST:
            continue
        best = "best" * (standing(label) == "at its best")
        short = f"{method}[{name or best or f'#{count[method]}'}]"
        if len(short) < len(label) and short not in taken:
            known[label] = short
            taken.add(short)
    return ShortNames(known)


def _sorted(parameters: str) -> tuple[str, ...]:
    """Parameters in an order that does not depend on how they were written."""
    return tuple(sorted(part.strip() for part in parameters.split(",")))
