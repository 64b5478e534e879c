"""What the specifications in which a claim holds have in common, in one sentence."""

from typing import NamedTuple

import pandas as pd

# besides the dimensions of the readings, in what specifications differ
WORDS = {"scenario": "in {}", "of": "of {}", "than": "against {}", "definition": "read as a {}"}
MOST = 2  # conditions that a sentence names
LEAST = 0.1  # share of the other specifications that a condition must exclude to be worth naming


class Condition(NamedTuple):
    """Choices that all of some specifications have, and not all others."""

    name: str
    choices: tuple[str, ...]
    without: tuple[str, ...] = ()  # the choices that others have

    def met(self, part: pd.DataFrame) -> "pd.Series[bool]":
        """Where it is met; one that makes no difference to a specification does not exclude it."""
        return part[self.name].isin((*self.choices, ""))

    def __str__(self) -> str:
        few = bool(self.without) and len(self.without) < len(self.choices)
        *most, last = self.without if few else self.choices
        listed = "any but " * few + (f"{', '.join(most)} or {last}" if most else last)
        return WORDS.get(self.name, f"with {self.name} = {{}}").format(listed)


def sentence(part: pd.DataFrame, dimensions: list[str]) -> str:
    """In how many specifications a claim holds, and which choices these have in common, or all others.

    Args:
        part: specifications of one claim, from `multiverse.judge`.
        dimensions: the columns of choices to be named.

    """
    holds = part["verdict"] == "supported"
    n, k = len(part), int(holds.sum())
    if k == n:
        return f"holds in all {n} specifications" if n > 1 else "holds in the only specification that was run"
    if k == 0:
        direction, open_ = (int((part["verdict"] == name).sum()) for name in ("direction only", "undecided"))
        if open_ == n:
            return f"left open in all {n} specifications"
        return f"holds in 0 of {n} specifications" + f"; its direction alone in {direction}" * (direction > 0)
    counted = f"holds in {k} of {n} specifications"
    if 2 * k > n:
        return counted + _said("the others are", part, ~holds, dimensions)
    return counted + _said("all of them" if k > 1 else "the one", part, holds, dimensions)


def conditions(part: pd.DataFrame, chosen: "pd.Series[bool]", names: list[str]) -> list[Condition]:
    """Few conditions that all chosen specifications meet and that exclude as many others as possible, best first."""
    found: list[Condition] = []
    others = part[~chosen]
    for _ in range(MOST):
        each = [_shared(part, chosen, name) for name in names]
        excluded = {one: int((~one.met(others)).sum()) for one in each if "" not in one.choices}
        best = max(excluded, key=lambda one: excluded[one], default=None)
        if best is None or not excluded[best] > LEAST * len(others):
            break
        found.append(best)
        others = others[best.met(others)]
    return found


def _shared(part: pd.DataFrame, chosen: "pd.Series[bool]", name: str) -> Condition:
    choices = tuple(dict.fromkeys(part.loc[chosen, name]))
    return Condition(name, choices, tuple(x for x in dict.fromkeys(part[name]) if x and x not in choices))


def _said(who: str, part: pd.DataFrame, chosen: "pd.Series[bool]", dimensions: list[str]) -> str:
    """The conditions of the chosen specifications, and how many meet them without being chosen."""
    found = conditions(part, chosen, [*dimensions, *WORDS])
    if not found:
        return _most_often(part, [*dimensions, *WORDS])
    met = pd.concat([one.met(part) for one in found], axis=1).all(axis=1)
    more = f" ({int(chosen.sum())} of {int(met.sum())} such)" if met.sum() > chosen.sum() else ""
    return f": {who} {' and '.join(map(str, found))}{more}"


def _most_often(part: pd.DataFrame, names: list[str]) -> str:
    """The choice with which a claim holds most often, where no choice is needed for it."""
    holds = (part["verdict"] == "supported").astype(float)
    rates = {(name, x): holds[part[name] == x] for name in names for x in part[name].unique() if x}
    (name, choice), best = max(rates.items(), key=lambda each: each[1].mean())
    if best.mean() < holds.mean() + LEAST:
        return ", whatever is chosen"
    return f"; most often {Condition(name, (choice,))} ({best.sum():.0f} of {len(best)})"
