"""How a case of each kind of claim is judged: functions from a case to its `Finding`; `kinds.KINDS` lists them.

A change is relative, b/a - 1: negative where the error, or the time, is smaller. Trials of two scenarios are paired by
their number: pairs are independent of each other whether or not the two of a pair are correlated (scenarios of one seed
share some of their random numbers), so this is right in either case.
"""

from functools import partial
from itertools import product

import numpy as np
from scipy import stats

from cooploc.analysis.claims import zones
from cooploc.analysis.claims.claim import Case, Claim, as_change, claimed
from cooploc.analysis.claims.trial_table import Key, Missing, TrialTable
from cooploc.analysis.claims.zones import Finding, Zones, decide
from cooploc.analysis.metrics import statistics
from cooploc.analysis.metrics.consistency import LEAST_COVERAGE, OVER_CONFIDENT
from cooploc.analysis.metrics.statistics import Interval


def change(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """By how much the RMSE of `of` differs from that of `than` in a scenario (Fieller).

    Of a size below 0: supported below size + margin; direction only between size and 0; contradicted above 0. Of a size
    above 0 the mirror image. Without a size: supported below 0; contradicted above.
    """
    (scenario,), (than,) = case.scenarios, case.than
    return _pair(table, (scenario, than), (scenario, case.of), _zones(case, claim))


def trend(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """By how much the RMSE of `of` changes from the first scenario to each later one; zones as of a change."""
    first, later = case.scenarios
    return _pair(table, (first, case.of), (later, case.of), _zones(case, claim))


def _pair(table: TrialTable, before: Key, after: Key, zones: Zones) -> Finding:
    """The change of RMSE from one (scenario, estimator) to another."""
    a, b = table.mse(before, after).T
    return decide(table.stopping.change(a, b), len(a), zones, partial(table.stopping.p_of_change, a, b))


def every(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """`of` is better than every `than` in every scenario. The number is the weakest case.

    Supported where every change is below 0, an intersection-union test that needs no adjustment (Berger 1982);
    contradicted where one of them is above 0 after Holm over all of them.
    """
    labels = list(product(case.scenarios, case.than))
    pairs = [table.mse((scenario, than), (scenario, case.of)) for scenario, than in labels]
    p = [table.stopping.p_above(a, b, 1.0) for a, b in (p.T for p in pairs)]
    return zones.decide_all(pairs, labels, zones.FALLS, p, table.stopping)


def same(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """From the first scenario to every later one the RMSE changes by less than a factor 1 + margin.

    Supported where all intervals lie within; contradicted where one lies outside after Holm. Each is compared with the
    first and not with the one before, for small steps may add up. The number is the largest change.
    """
    first, *later = case.scenarios
    if not later:
        raise Missing(f"only {first} was run; it needs another scenario to be compared with")
    pairs = [table.mse((first, case.of), (scenario, case.of)) for scenario in later]
    top, low, high = (1 + claim.margin) ** 2, -claim.margin / (1 + claim.margin), claim.margin
    within = ("supported", low, high), ("contradicted", -np.inf, low), ("contradicted", high, np.inf)
    above = table.stopping.p_above
    outside = [min(above(a, b, top), above(b, a, top)) for a, b in (p.T for p in pairs)]
    return zones.decide_all(pairs, [(scenario, "") for scenario in later], within, outside, table.stopping)


def growth(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """By how much the RMSE grows per unit of what is swept, from the slope of its logarithm (jackknife).

    Flat where the change over the whole sweep lies within a factor 1 + margin (two one-sided tests, Schuirmann 1987),
    whether or not it differs from nothing; else supported above 0, contradicted below 0.
    """
    if len(case.scenarios) < 3:
        raise Missing(f"growth needs three scenarios, the run has {', '.join(case.scenarios)}")
    x = np.array([table.swept(scenario) for scenario in case.scenarios])
    values = table.mse(*((scenario, case.of) for scenario in case.scenarios))
    away = x - x.mean()
    slope = table.stopping.log_contrast(values, away / (away**2).sum() / 2)
    limit = float(np.log1p(claim.margin) / np.ptp(x))
    return _decide_log(slope, len(values), zones.or_flat(zones.GROWS, limit), table)


def interaction(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """The error of `of` grows by a larger factor than that of `than`, from the first scenario to each later one.

    Jackknife on the ratio of ratios, minus 1: supported above 0; contradicted below 0.
    """
    (first, later), (than,) = case.scenarios, case.than
    values = table.mse((later, case.of), (first, case.of), (later, than), (first, than))
    more = table.stopping.log_contrast(values, np.array([1, -1, -1, 1]) / 2)
    return _decide_log(more, len(values), zones.GROWS, table)


def level(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """RMSE [m]: supported up to size; contradicted above."""
    (scenario,) = case.scenarios
    values = table.mse((scenario, case.of))[:, 0]
    rmse = Interval(*(float(np.sqrt(end)) for end in table.stopping.mean_of_positive(values)))
    return _decide_positive(rmse, len(values), zones.at_most(claim.size or 0.0), table)


def time(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """Seconds per robot and tick, the mean over parts of the run: supported up to size; contradicted above."""
    (scenario,) = case.scenarios
    seconds = table.seconds((scenario, case.of))[:, 0]
    mean = table.stopping.mean_of_positive(seconds)
    found = _decide_positive(mean, len(seconds), zones.at_most(claim.size or 0.0), table)
    return found._replace(needed=found.needed * table.trials((scenario, case.of)) / len(seconds))


def consistency(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """The covariance is not too small: ANEES is at most 1.5, and the 95 % ellipse holds the truth as often as then.

    Supported where both intervals lie within; contradicted where one lies outside after Holm over the two. The number
    is the ANEES; where a few collapsed trials make its interval useless, coverage may decide.
    """
    (scenario,) = case.scenarios
    values, inside = table.anees((scenario, case.of)), table.coverage((scenario, case.of))
    if not len(values):
        raise Missing(f"{case.of} has no covariance in {scenario}")
    test, mean = table.stopping.p_of_mean, table.stopping.mean_of_positive(values)
    anees = _decide_positive(mean, len(values), zones.at_most(OVER_CONFIDENT), table)
    covered = table.stopping.mean(inside)
    share = decide(covered, len(inside), zones.at_least(LEAST_COVERAGE), partial(test, covered, len(inside)))
    return zones.both(anees, share)


def slope(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """Exponent of seconds per robot and tick over the number of robots, least squares over the scenarios.

    Supported up to size + margin; contradicted above. Trials are sizes of the team here.
    """
    seconds = [table.seconds((scenario, case.of))[:, 0] for scenario in case.scenarios]
    x = np.log([table.robots(scenario) for scenario in case.scenarios])
    if len(set(x)) < statistics.LEAST_TRIALS:
        raise Missing(f"a slope needs teams of five sizes, the run has {len(set(x))}")
    fit = stats.linregress(x, np.log([s.mean() for s in seconds]))
    half = float(stats.t.ppf(1 - zones.ALPHA, len(x) - 2) * fit.stderr)
    interval = Interval(float(fit.slope), float(fit.slope) - half, float(fit.slope) + half)

    def test(value: float) -> float:
        return float(2 * stats.t.sf(abs(fit.slope - value) / fit.stderr, len(x) - 2)) if fit.stderr > 0 else 0.0

    found = decide(interval, len(x), zones.at_most((claim.size or 0.0) + claim.margin), test)
    return found._replace(needed=np.nan)  # more trials add no sizes


def cost(case: Case, claim: Claim, table: TrialTable) -> Finding:
    """By how much the time of `of` differs from that of `than`; zones as of a change.

    Here a trial is not the unit but a part of the run, the trials whose time was taken together.
    """
    (scenario,), (than,) = case.scenarios, case.than
    logs = np.log(table.seconds((scenario, case.of), (scenario, than)))
    interval = table.stopping.mean(logs[:, 0] - logs[:, 1])
    test = partial(table.stopping.p_of_mean, interval, len(logs))
    found = decide(_relative(interval), len(logs), _zones(case, claim), lambda value: test(float(np.log1p(value))))
    return found._replace(needed=found.needed * table.trials((scenario, case.of)) / len(logs))


def _decide_log(logs: Interval, n: int, zones: Zones, table: TrialTable) -> Finding:
    """The verdict on a difference of logarithms, which is then written as a relative change."""
    found = decide(logs, n, zones, partial(table.stopping.p_of_mean, logs, n))
    return found._replace(interval=_relative(found.interval))


def _decide_positive(interval: Interval, n: int, zones: Zones, table: TrialTable) -> Finding:
    """The verdict on a positive number whose interval is symmetric in its logarithm."""
    logs = Interval(*np.log(interval))
    return decide(interval, n, zones, lambda value: table.stopping.p_of_mean(logs, n, float(np.log(value))))


def _relative(logs: Interval) -> Interval:
    """From a difference of logarithms to a relative change."""
    return Interval(*(float(np.expm1(end)) for end in logs))


def _zones(case: Case, claim: Claim) -> Zones:
    if claim.size is None:
        return zones.FALLS
    least = claim.size - float(np.copysign(claim.margin, claim.size))
    return zones.of_size(claimed(claim, case.definition), as_change(least) if case.definition == "ratio" else least)
