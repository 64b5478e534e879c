"""How each kind of claim becomes a number, its interval and a verdict; `claims.verdicts` has the rules."""

from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy import stats

from cooploc.analysis.claims.ledger import Claim
from cooploc.analysis.claims.trial_table import Missing, Results
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.statistics import Interval
from cooploc.estimators.interface import Array

ALPHA = (1 - statistics.LEVEL) / 2  # one-sided, as an end of the interval
Zones = tuple[tuple[str, float, float], ...]  # verdict, above this, and at most this
BETTER: Zones = (("supported", 0.0, np.inf), ("contradicted", -np.inf, 0.0))


class Case(NamedTuple):
    """One question that a claim comes down to."""

    of: str
    than: tuple[str, ...]
    scenarios: tuple[str, ...]
    definition: str = ""


class Finding(NamedTuple):
    """A case's number and verdict."""

    interval: Interval
    trials: int
    verdict: str
    needed: float
    scenario: str = ""  # of several, the one that the number is of
    than: str = ""


def cases(claim: Claim) -> list[Case]:
    """The questions that a claim comes down to, each on its own."""
    one_by_one: list[tuple[str, ...]] = [(name,) for name in claim.than] or [()]
    later = [(claim.scenarios[0], label) for label in claim.scenarios[1:]]
    each = [(label,) for label in claim.scenarios]
    whole = [claim.scenarios]
    ways: dict[str, tuple[Sequence[tuple[str, ...]], Sequence[tuple[str, ...]], tuple[str, ...]]] = {
        "improvement": (each, one_by_one, claim.definitions),
        "trend": (later, one_by_one, claim.definitions),
        "all": (whole, [claim.than], ("",)),
        "same": (whole, one_by_one, ("",)),
        "growth": (whole, one_by_one, ("",)),
        "interaction": (later, one_by_one, ("",)),
        "level": (each, one_by_one, ("",)),
        "slope": (whole, one_by_one, ("",)),
        "cost": (each, one_by_one, ("",)),
    }
    where, than, definitions = ways[claim.kind]
    return [Case(of, other, s, d) for s, of, other, d in product(where, claim.of, than, definitions)]


def _improvement(case: Case, claim: Claim, results: Results) -> Finding:
    (scenario,), (than,) = case.scenarios, case.than
    return _gain(results.mse((scenario, than), (scenario, case.of)), case, claim)


def _trend(case: Case, claim: Claim, results: Results) -> Finding:
    first, later = case.scenarios
    return _gain(results.mse((first, case.of), (later, case.of)), case, claim)


def _gain(pairs: Array, case: Case, claim: Claim) -> Finding:
    gain = statistics.improvement(*pairs.T)
    ratio = case.definition == "ratio"
    found = _decide(gain, len(pairs), _sized(claim, ratio))
    return found._replace(interval=statistics.as_ratio(gain)) if ratio else found


def _all(case: Case, claim: Claim, results: Results) -> Finding:
    cells = list(product(case.scenarios, case.than))
    pairs = [results.mse((scenario, than), (scenario, case.of)) for scenario, than in cells]
    worse = [_beyond(p[:, 0], p[:, 1], 1.0) for p in pairs]
    return _several(pairs, cells, BETTER, worse)


def _same(case: Case, claim: Claim, results: Results) -> Finding:
    first, *later = case.scenarios
    if not later:
        raise Missing(f"only {first} was run; it needs another scenario to be compared with")
    cells = [(scenario, "") for scenario in later]
    pairs = [results.mse((first, case.of), (scenario, case.of)) for scenario in later]
    top = (1 + claim.margin) ** 2
    outside = [min(_beyond(p[:, 0], p[:, 1], top), _beyond(p[:, 1], p[:, 0], top)) for p in pairs]
    within = (-claim.margin, claim.margin / (1 + claim.margin))  # as error reductions
    zones = ("supported", *within), ("contradicted", -np.inf, within[0]), ("contradicted", within[1], np.inf)
    return _several(pairs, cells, zones, outside)


def _several(pairs: list[Array], cells: list[tuple[str, str]], zones: Zones, refuting: list[float]) -> Finding:
    """Supported where every case is; contradicted where one is, after Holm over all of them."""
    found = [_decide(statistics.improvement(*p.T), len(p), zones) for p in pairs]
    _, low, high = zones[0]
    room = [min(f.interval.low - low, high - f.interval.high) for f in found]
    adjusted = statistics.holm(np.array(refuting))
    refuted = bool((adjusted < ALPHA).any())
    worst = int(np.nanargmin(adjusted)) if refuted else int(np.argmin(np.nan_to_num(room, nan=-np.inf)))
    if all(f.verdict == "supported" for f in found):
        verdict, needed = "supported", np.nan
    elif refuted:
        verdict, needed = "contradicted", np.nan
    else:
        verdict, needed = "undecided", _needed_of_several(found, zones)
    where, than = cells[worst]
    return found[worst]._replace(verdict=verdict, needed=needed, scenario=where, than=than)


def _needed_of_several(found: list[Finding], zones: Zones) -> float:
    """Until one case is decided against the claim, or all are for it."""
    _, low, high = zones[0]
    outside = [f for f in found if not low < f.interval.value <= high]
    needed = np.array([f.needed if f.verdict == "undecided" else f.trials for f in outside or found], float)
    if not outside:
        return float(needed.max())
    return float(np.nanmin(needed)) if np.isfinite(needed).any() else np.nan


def _growth(case: Case, claim: Claim, results: Results) -> Finding:
    if len(case.scenarios) < 3:
        raise Missing(f"growth needs three scenarios, the run has {', '.join(case.scenarios)}")
    x = np.array([results.swept(scenario) for scenario in case.scenarios])
    values = results.mse(*((scenario, case.of) for scenario in case.scenarios))
    away = x - x.mean()
    slope = statistics.log_contrast(values, away / (away**2).sum() / 2)
    return _decide(slope, len(values), BETTER)._replace(interval=_shares(slope))


def _interaction(case: Case, claim: Claim, results: Results) -> Finding:
    (first, later), (than,) = case.scenarios, case.than
    cells = ((later, case.of), (first, case.of), (later, than), (first, than))
    values = results.mse(*cells)
    more = statistics.log_contrast(values, np.array([1, -1, -1, 1]) / 2)
    return _decide(more, len(values), BETTER)._replace(interval=_shares(more))


def _level(case: Case, claim: Claim, results: Results) -> Finding:
    (scenario,) = case.scenarios
    values = results.mse((scenario, case.of))[:, 0]
    rmse = Interval(*(float(np.sqrt(end)) for end in statistics.mean_of_positive(values)))
    return _decide(rmse, len(values), _at_most(claim.size or 0.0))


def _slope(case: Case, claim: Claim, results: Results) -> Finding:
    seconds = [results.parts((scenario, case.of))[:, 0] for scenario in case.scenarios]
    x = np.log([results.robots(scenario) for scenario in case.scenarios])
    if len(set(x)) < statistics.LEAST_TRIALS:
        raise Missing(f"a slope needs teams of five sizes, the run has {len(set(x))}")
    fit = stats.linregress(x, np.log([s.mean() for s in seconds]))
    half = float(stats.t.ppf(1 - ALPHA, len(x) - 2) * fit.stderr)
    interval = Interval(float(fit.slope), float(fit.slope) - half, float(fit.slope) + half)
    found = _decide(interval, len(x), _at_most((claim.size or 0.0) + claim.margin))
    return found._replace(needed=np.nan)  # more trials add no sizes


def _cost(case: Case, claim: Claim, results: Results) -> Finding:
    (scenario,), (than,) = case.scenarios, case.than
    logs = np.log(results.parts((scenario, case.of), (scenario, than)))
    saved = Interval(*(float(-np.expm1(-end)) for end in statistics.mean(logs[:, 1] - logs[:, 0])))
    found = _decide(saved, len(logs), _sized(claim, ratio=False))
    return found._replace(needed=found.needed * results.trials((scenario, case.of)) / len(logs))


FINDERS: dict[str, Callable[[Case, Claim, Results], Finding]] = {
    "improvement": _improvement,
    "trend": _trend,
    "all": _all,
    "same": _same,
    "growth": _growth,
    "interaction": _interaction,
    "level": _level,
    "slope": _slope,
    "cost": _cost,
}


def _shares(logs: Interval) -> Interval:
    """From a difference of logarithms to the share by which one is larger."""
    return Interval(*(float(np.expm1(end)) for end in logs))


def _sized(claim: Claim, ratio: bool) -> Zones:
    """The zones of an error reduction; a size that is a ratio a/b - 1 is one of 1 - b/a too."""
    if claim.size is None:
        return BETTER
    least, size = claim.size - claim.margin, claim.size
    if ratio:
        least, size = 1 - 1 / (1 + least), 1 - 1 / (1 + size)
    return ("supported", least, np.inf), ("direction only", 0.0, size), ("contradicted", -np.inf, 0.0)


def _at_most(limit: float) -> Zones:
    return ("supported", -np.inf, limit), ("contradicted", limit, np.inf)


def _decide(interval: Interval, n: int, zones: Zones) -> Finding:
    for verdict, low, high in zones:
        if interval.low > low and interval.high <= high:
            return Finding(interval, n, verdict, np.nan)
    edges = [(low, high) for _, low, high in zones if low < interval.value <= high]
    needed = [
        statistics.trials_to_exclude(interval, n, min(interval.value - low, high - interval.value))
        for low, high in edges
    ]
    return Finding(interval, n, "undecided", min((v for v in needed if np.isfinite(v)), default=np.nan))


def _beyond(a: Array, b: Array, factor: float) -> float:
    """One-sided p of a t test that mean b is at least `factor` times mean a."""
    d = b - factor * a
    if len(d) < statistics.LEAST_TRIALS:
        return np.nan
    if np.ptp(d) <= 1e-12 * np.abs(a).max():
        return float(d[0] < 0)
    return float(stats.t.sf(d.mean() / d.std(ddof=1) * np.sqrt(len(d)), len(d) - 1))
