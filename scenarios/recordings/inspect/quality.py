"""Positions that leap, repeat or lie outside; gaps, late beginnings, lines that were dropped."""

import numpy as np

from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.scenarios.recordings.inspect.corrected import truth_of, with_truth
from cooploc.scenarios.recordings.inspect.finding import Change, Finding, Looked
from cooploc.scenarios.recordings.inspect.travelled import integrated
from cooploc.scenarios.recordings.team_log import Series, TeamLog

LEAP = 0.3  # [m] a shorter one is noise of the tracking
FAST = 10.0  # times the 90th percentile of speed, from which a step is a leap
STALE_TIME = 0.5  # [s]
STALE_LENGTH = 0.1  # [m] driven meanwhile, by odometry
STALE_PLACE = 0.5  # [m] the same where the heading goes on: one that turns on the spot drives less
GAP = 10.0  # median intervals, and a second
ENDS = 0.1  # share of the recording that a series may lack at an end


def look_at_jumps(log: TeamLog) -> Looked:
    """Positions that no earlier or later one of the same robot can be reached from."""
    findings = []
    for i, robot in enumerate(log.robots):
        truth = truth_of(log, i)
        leaps = np.empty(0, int) if truth is None else _leaps(truth)
        if truth is None or not len(leaps):
            continue
        first = truth.time[leaps[0]] - truth.time[0]
        fact = f"{len(leaps)} positions leap away and back; the first {first:.1f} s after the start"
        fastest = _usual_speed(truth)
        change = Change("truth", (), f"max_speed = {max(2 * fastest, 0.5):.2g}")
        findings.append(Finding("jump", robot, truth.source, fact, "sure", change))
        kept = np.setdiff1d(np.arange(len(truth.time)), leaps)
        log = with_truth(log, i, time=truth.time[kept], values=truth.values[kept])
    return Looked(tuple(findings), log)


def look_at_stale(log: TeamLog) -> Looked:
    """Positions that are repeated exactly while odometry says that the robot drives."""
    findings = []
    for i, robot in enumerate(log.robots):
        truth = truth_of(log, i)
        if truth is None:
            continue
        runs = _stale_runs(truth, *_driven(log, i))
        if runs:
            longest = max(end - start for start, end in runs)
            fact = f"the position repeats exactly while the robot drives: {len(runs)} times, for up to {longest:.1f} s"
            change = Change("truth", ("x", "y"), "leave the repeated positions empty in the file")
            findings.append(Finding("stale", robot, truth.source, fact, "sure", change))
            repeats = np.any([(truth.time > start) & (truth.time <= end) for start, end in runs], axis=0)
            log = with_truth(log, i, time=truth.time[~repeats], values=truth.values[~repeats])
    return Looked(tuple(findings), log)


def look_at_arena(log: TeamLog, arena: Array | None) -> Looked:
    """Positions outside the arena (2, 2) [m], or, where that is not stated, far outside of all fixed things."""
    findings, margin, name = [], 0.0, "the arena"
    if arena is None:
        places = np.concatenate([log.anchors.positions, log.landmarks.positions])
        places = places[np.isfinite(places).all(axis=1)]
        if len(places) < 3:
            return Looked((), log)
        arena, name = np.array([places.min(axis=0), places.max(axis=0)]), "all anchors and landmarks"
        margin = float(np.ptp(places, axis=0).max())
    for i, robot in enumerate(log.robots):
        truth = truth_of(log, i)
        if truth is None:
            continue
        beyond = np.maximum(arena[0] - truth.values[:, :2], truth.values[:, :2] - arena[1]).max(axis=1)
        share = float((beyond > margin + 0.05 * np.ptp(arena, axis=0).max()).mean())
        if share > 0.01:
            fact = f"{share:.0%} of the positions are outside {name}, by up to {beyond.max():.3g} m"
            change = Change("", ("arena",), "arena = its corners, or the unit of x and y in [truth]")
            findings.append(Finding("outside", robot, truth.source, fact, "sure" if not margin else "likely", change))
    return Looked(tuple(findings), log)


def look_at_gaps(log: TeamLog) -> Looked:
    """Gaps of odometry and truth, and series that lack a tenth of the recording at an end."""
    findings = []
    series = [("odometry", i, s) for i, s in enumerate(log.odometry)]
    series += [("truth", i, s) for i, s in enumerate(log.truth) if s is not None]
    stamps = [s.time for _, _, s in series if len(s.time) > 1]
    for table, i, s in series:
        findings += _short(log, table, i, s, stamps)
        if len(s.time) < 10:
            continue
        intervals = np.diff(s.time)
        usual = float(np.median(intervals))
        long = intervals > max(GAP * usual, 1.0)
        if long.any():
            fact = f"{int(long.sum())} gaps, the longest {intervals.max():.3g} s; the usual interval is {usual:.3g} s"
            findings.append(Finding("gap", log.robots[i], s.source, fact, "sure", Change(table, (), _GAPS)))
    return Looked(tuple(findings), log)


def look_at_dropped(log: TeamLog) -> Looked:
    """What the reader could not read, such as a last line that was cut off."""
    change = Change("", (), "nothing: it is left out")
    return Looked(tuple(Finding("dropped", "", "", warning, "sure", change) for warning in log.warnings), log)


_GAPS = "max_gap in [sample] is the longest gap that is bridged"


def _short(log: TeamLog, table: str, i: int, s: Series, stamps: list[Array]) -> list[Finding]:
    """A series that begins late or ends early, against the middle of all series."""
    start, end = (float(np.median([t[k] for t in stamps])) for k in (0, -1))
    if end <= start or not len(s.time):
        return []
    late, early = s.time[0] - start, end - s.time[-1]
    if max(late, early) < max(ENDS * (end - start), 1.0) or late > end - start or early > end - start:
        return []
    words = f"begins {late:.3g} s late" if late > early else f"ends {early:.3g} s early"
    change = Change(table, (), "nothing: what is missing is not known")
    return [Finding("span", log.robots[i], s.source, f"it {words} in {end - start:.3g} s", "sure", change)]


def _usual_speed(truth: Series) -> float:
    return float(np.quantile(_speeds(truth), 0.9))


def _speeds(truth: Series) -> Array:
    apart = np.hypot(*np.diff(truth.values[:, :2], axis=0).T)
    return np.asarray(apart / np.maximum(np.diff(truth.time), 1e-3))


def _leaps(truth: Series) -> Array:
    """Rows that are far from both neighbours' level: from a step away to the step back, at most a second later."""
    apart = np.hypot(*np.diff(truth.values[:, :2], axis=0).T)
    steps = np.flatnonzero((apart > LEAP) & (_speeds(truth) > FAST * max(_usual_speed(truth), 0.05)))
    rows = [np.arange(a + 1, b + 1) for a, b in _pairs(steps, truth.time)]
    return np.unique(np.concatenate([np.empty(0, int), *rows]))


def _pairs(steps: Indices, time: Array) -> list[tuple[int, int]]:
    """A leap away and the leap back that follows it."""
    found, k = [], 0
    longest = max(1.0, 3 * float(np.median(np.diff(time))))  # [s] away
    while k < len(steps):
        back = k + 1 < len(steps) and time[steps[k + 1]] - time[steps[k]] <= longest
        found.append((int(steps[k]), int(steps[k + 1]) if back else int(steps[k]) + 1))
        k += 2 if back else 1
    return found


def _driven(log: TeamLog, i: int) -> tuple[Array, Array]:
    """Stamps and length driven so far by odometry [m]."""
    wheels = integrated(log.odometry[i], log.odometry_kind)
    if not np.isfinite(wheels.place).any():
        apart = np.abs(np.diff(wheels.length, prepend=wheels.length[:1]))
    else:
        apart = np.hypot(*np.diff(wheels.place, axis=0, prepend=wheels.place[:1]).T)
    return wheels.time, np.cumsum(np.nan_to_num(apart))


def _stale_runs(truth: Series, time: Array, length: Array) -> list[tuple[float, float]]:
    """Intervals in which pose or place is the same to the last digit and odometry drives on."""
    if len(time) < 2:
        return []
    change = np.diff(truth.values, axis=0)
    same_place = (change[:, :2] == 0).all(axis=1)
    same_pose = same_place & ((change[:, 2] == 0) | np.isnan(change[:, 2]))
    runs = _driving(truth.time, same_pose, time, length, STALE_LENGTH)
    return runs or _driving(truth.time, same_place, time, length, STALE_PLACE)


def _driving(stamps: Array, same: Mask, time: Array, length: Array, least: float) -> list[tuple[float, float]]:
    """Runs of `same` (m - 1,) that last, and in which at least that much is driven."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
    runs = [(float(stamps[a]), float(stamps[b])) for a, b in edges.reshape(-1, 2)]
    driven = np.interp([end for _, end in runs], time, length) - np.interp([start for start, _ in runs], time, length)
    return [run for run, far in zip(runs, driven, strict=True) if run[1] - run[0] >= STALE_TIME and far >= least]
