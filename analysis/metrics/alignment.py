"""Stamps and frames: trajectories matched with the true ones and aligned to them, and what is odd about them.

Poses and stamps are matched and aligned as evo does (M. Grupp, github.com/MichaelGrupp/evo): the nearest stamp counts,
up to a largest difference.
"""

from collections.abc import Mapping
from contextlib import suppress
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from cooploc.analysis.metrics.trajectory_bags import TRUTH
from cooploc.analysis.metrics.trajectory_files import Team, Trajectory, read_team
from cooploc.estimators.errors import BadInput, nearest, shorten
from cooploc.estimators.interface import Array, Indices, Mask
from cooploc.estimators.models import wrap

ALIGNMENTS = "none", "origin", "se2", "team"
ADVICE = {"none": "if it is in another frame, --align {}", "": "write it in the frame of the stream"}  # by alignment
AXES = "world", "body"
GAP = 10  # times the usual step between poses
STANDING = 0.05  # [m] a robot whose path is no larger does not move
MIRRORED = 0.3  # a path fits so much better once it is mirrored: its frame is
SHIFTS = np.linspace(-2.0, 2.0, 81)  # [s] by which the stamps of a path may be off
SHIFTED = 0.5  # a path fits so much better at other times, or in another size: its clock, or its scale, is off
ELSEWHERE = 0.2  # it fits so much better in another frame, or at far other times
FASTEST, SLOWEST = 30.0, 0.001  # [m/s] mean speeds of robots that move; others are of other units
TURNED = 0.25  # [rad] by which headings may differ from whole quarters of a turn, in which they are stated
HELD, JUMP = 0.1, 3  # [m] that a robot moves while its true pose is held, and the usual steps by which that jumps then
EQUAL = 1e-6  # [m] poses that differ by less are the same
ENOUGH = 20  # poses from which a path is fitted to other times, and other robots
LOOKED_AT = 30  # robots whose names may be exchanged
BLOCKS = 10  # into which ticks are cut, to see in which axes covariances fit


class Matched(NamedTuple):
    """Trajectories beside the true ones: the poses that every method has, aligned."""

    label: str  # of the truth
    paths: Mapping[str, Array]  # robot -> (T, 3) true poses
    teams: Mapping[str, Team]  # method -> robot -> as many poses
    remarks: tuple[str, ...]


def match_trajectories(
    place: Path, of_truth: str, estimates: Mapping[str, Path], align: str, axes: str, largest: float
) -> Matched:
    """Return the poses that all methods have beside the true ones, with the arguments of `judge_trajectories`.

    `place` and `of_truth` are those of `place_of_truth`.
    """
    for name, value, known in (("align", align, ALIGNMENTS), ("axes", axes, AXES)):
        if value not in known:
            raise BadInput(f"there is no {name} {value!r}; {nearest(value, list(known))}")
    if not estimates:
        raise BadInput("there are no estimates to judge: name a folder or bag")
    true = read_team(place, (), of_truth)
    teams = dict[str, Team]()
    for name, folder in estimates.items():
        try:
            teams[name] = read_team(folder, list(true), name)
        except BadInput as e:
            remedy = f"; if other columns or topics are true, name them: --truth WORD={place}"
            is_unsaid = "has no trajectory" in str(e) and folder == place and of_truth == TRUTH
            raise BadInput(f"{e}{remedy * is_unsaid}") from None
    for name, team in teams.items():
        require_estimates(name, team, true)
    matched = {robot: _common(robot, true[robot], teams, largest) for robot in true}
    paths = {robot: true[robot].x[index] for robot, (index, _) in matched.items()}
    remarks = [note for team in (true, *teams.values()) for one in team.values() for note in one.notes]
    remarks = list(dict.fromkeys(remarks)) + _shared_remarks(true, teams, paths, largest)
    remarks += filter(None, (_speed_remark(f"truth: robot {robot!r}", one) for robot, one in true.items()))
    chosen: dict[str, Team] = {}
    for name, team in teams.items():
        rows = {robot: matched[robot][1][name] for robot in true}
        there = {robot: team[robot].select(rows[robot]) for robot in true}
        chosen[name], said = align_team(name, there, paths, align, axes)
        remarks += said + path_remarks(name, team, true)
    first = next(iter(chosen.values()))
    remarks += filter(None, (_held_remark(robot, first[robot], path) for robot, path in paths.items()))
    return Matched(place.resolve().name, paths, chosen, tuple(shorten(remarks)))


def place_of_truth(truth: Path) -> tuple[Path, str]:
    """Return where true poses are and, of WORD=PLACE, the word of their columns or topics; refuse one that none has."""
    word, _, rest = str(truth).partition("=")
    if truth.exists() or not (word and rest):
        return truth, TRUTH
    place, found = Path(rest), list[dict[str, list[float]]]()
    for method in (word, "no such word"):
        with suppress(BadInput):
            found.append({robot: one.x.ravel().tolist() for robot, one in read_team(place, (), method).items()})
    if word != TRUTH and len(found) == 2 and repr(found[0]) == repr(found[1]):  # which compares nan, too
        raise BadInput(f"{place}: no column or topic has the word {word!r}: name one that is true, or leave it out")
    return place, word


def _common(
    robot: str, true: Trajectory, teams: Mapping[str, Team], largest: float
) -> tuple[Indices, dict[str, Indices]]:
    """Return the true poses that all methods have an estimate for, and which of each method's poses those are."""
    pairs = {name: match_stamps(true.stamp, team[robot].stamp, largest) for name, team in teams.items()}
    for name, (index, _) in pairs.items():
        if not len(index):
            own, t = teams[name][robot].stamp, true.stamp
            nearest_true, rows = match_stamps(t, own, np.inf)
            away = np.abs(own[rows] - t[nearest_true]).max()
            remedy = "; ".join(["write both by one clock", *dict.fromkeys((*true.notes, *teams[name][robot].notes))])
            if found := _best_shift(teams[name][robot], true):
                remedy += f", such as with {found[0]:.2f} s added to its own"
            if len(t) > 1 and away < GAP * np.median(np.diff(t)):  # one clock, and stamps between those of the truth
                remedy = f"interpolate the true poses at its stamps, or allow more by --within {away:.2g}"
            raise BadInput(
                f"{name}: no stamp of robot {robot!r} ({own[0]:.10g} to {own[-1]:.10g} s) is within {largest:g} s of "
                f"one of the truth ({t[0]:.10g} to {t[-1]:.10g} s): {remedy}"
            )
    if len(pairs) == 1:
        (name, (index, rows)), *_ = pairs.items()
        return index, {name: rows}
    common = reduce(np.intersect1d, (index for index, _ in pairs.values()))
    if not len(common):
        raise BadInput(f"robot {robot!r}: no true pose is met by all of {', '.join(pairs)}: judge them one by one")
    return common, {name: rows[np.searchsorted(index, common)] for name, (index, rows) in pairs.items()}


def _shared_remarks(true: Team, teams: Mapping[str, Team], paths: Mapping[str, Array], largest: float) -> list[str]:
    """Return remarks on robots that hardly move, and on poses that a method lacks, as nobody is judged there."""
    remarks = []
    for robot, path in paths.items():
        stamps, most = true[robot].stamp, 0
        for name, team in teams.items():
            index, _ = match_stamps(stamps, team[robot].stamp, largest)
            most = max(most, len(index))
            steps, span = np.diff(stamps[[0, *index, -1]]), stamps[-1] - stamps[0]
            away = steps[steps > GAP * np.median(np.diff(stamps[index]))].sum() if len(index) > 1 else 0.0
            if away > 0.1 * span:
                near = f"no poses within {largest:g} s of true ones in {away:.4g} of {span:.4g} s"
                remarks.append(f"{name}: robot {robot!r} has {near}, and is not judged there")
        if len(path) < 0.9 * most:
            remarks.append(f"robot {robot!r}: {len(path)} of {most} poses are judged; not every method has the others")
        if np.ptp(path[:, :2], axis=0).max() < STANDING:
            remarks.append(
                f"robot {robot!r} stands, within {STANDING:g} m: its RPE is noise, and --align se2 turns it at random"
            )
    return remarks


def match_stamps(a: Array, b: Array, largest: float) -> tuple[Indices, Indices]:
    """Return the rows of a and of b whose stamps are nearest, for each stamp of the shorter one, as evo does."""
    if len(b) > len(a):
        rows, index = match_stamps(b, a, largest)
        return index, rows
    right = np.searchsorted(a, b).clip(1, max(len(a) - 1, 1))
    candidates = np.stack([right - 1, np.minimum(right, len(a) - 1)])
    away = np.abs(a[candidates] - b)
    nearer = np.take_along_axis(candidates, away.argmin(0)[None], 0)[0]
    met = away.min(0) <= largest
    return nearer[met], np.flatnonzero(met)


def require_estimates(name: str, team: Team, truth: Team) -> None:
    """Refuse poses that are the true ones; one robot of several may stand where it was known to be."""
    same, moves = [], []
    for robot, true in truth.items():
        x, places = team[robot].x[:, :2], true.x[:, :2]
        if x.shape == places.shape and np.abs(x - places).max() < EQUAL:
            same.append(robot)
            moves += [robot] * bool(np.ptp(places, axis=0).max() > STANDING)
    if moves or (same and len(same) == len(truth)):
        which = "name other files, or which of a bag's topics is true, as in --truth vicon=BAG"
        raise BadInput(f"{name}: poses of robot {(moves or same)[0]!r} are the true ones: {which}")


def align_team(
    name: str, team: Mapping[str, Trajectory], paths: Mapping[str, Array], align: str, axes: str
) -> tuple[dict[str, Trajectory], list[str]]:
    """Return a team's trajectories in the frame of the truth, covariances in its axes, and remarks.

    `align` is one of `ALIGNMENTS`, or "" for trajectories of a stream, which has one frame.
    """
    remarks, found = [], {}
    if align and all(np.isnan(one.P[:, :2, :2]).all() for one in team.values()):
        remarks.append(f"{name} has no covariances, or zeros alone: its consistency is not known")
    everywhere = ([one.x for one in team.values()], paths.values())
    x, truths = (np.concatenate([x[:, :2] for x in all_of]) for all_of in everywhere)
    together, plain = fit_frame(x, truths), rms(x - truths)
    advice = ADVICE.get(align, "")
    is_apart = advice and len(team) > 1 and together[2] < ELSEWHERE * plain
    if is_apart:
        errs = f"{name} errs by {plain:.3g} m, and by {together[2]:.3g} m once all robots are aligned together"
        remarks.append(f"{errs}: {advice.format('team')}")
    for robot, one in team.items():
        true, of = paths[robot], f"{name}: robot {robot!r}"
        _require_units(of, one.x, true)
        angle, shift, residual = fit_frame(one.x[:, :2], true[:, :2])
        mirrored = fit_frame(one.x[:, :2] * [1, -1], true[:, :2])[2]
        if mirrored < MIRRORED * residual:
            fits = f"it fits the truth to {mirrored:.3g} m with y turned round, and to {residual:.3g} m as it is"
            raise BadInput(f"{of} has a mirrored path: {fits}: write it with x forward and y left")
        plain = rms(one.x[:, :2] - true[:, :2])
        if align:  # in a stream, robots whose filters drift would be named
            remarks += filter(None, [_scale_remark(of, one.x[:, :2], true[:, :2], angle, residual)])
        if residual < ELSEWHERE * spread_of(true):
            remarks += filter(None, [_heading_remark(of, one.x[:, 2] + angle, true[:, 2])])
        if align == "none" and not is_apart and residual < ELSEWHERE * plain:
            errs = f"{of} errs by {plain:.3g} m, and by {residual:.3g} m once aligned"
            remarks.append(f"{errs}: {advice.format('se2')}")
        if singular := np.count_nonzero(one.P[:, 0, 0] * one.P[:, 1, 1] == one.P[:, 0, 1] ** 2):
            remarks.append(f"{of} has {singular} singular covariances: with any error there, ANEES is infinite")
        if align == "origin" and not np.isfinite(true[0, 2] - one.x[0, 2]):
            raise BadInput(f"{of} has no heading in its first pose, or the truth: choose --align se2")
        if axes == "body" and np.isfinite(one.P[:, :2, :2]).any() and not np.isfinite(one.x[:, 2]).all():
            raise BadInput(f"{of} has no heading for axes of its body: add it, or choose --axes world")
        in_world = one._replace(P=turn_covariances(one.P, one.x[:, 2]))
        remarks += _axes_remark(f"{name}: the covariances of robot {robot!r}", one, in_world.P, true, axes)
        one = in_world if axes == "body" else one
        if align == "origin":
            angle = float(wrap(true[0, 2] - one.x[0, 2]))
            shift = true[0, :2] - rotation(angle) @ one.x[0, :2]
        elif align == "team":
            angle, shift, _ = together
        if align not in ADVICE:
            x = np.column_stack([one.x[:, :2] @ rotation(angle).T + shift, wrap(one.x[:, 2] + angle)])
            one = one._replace(x=x, P=turn_covariances(one.P, np.full(len(x), angle)))
        found[robot] = one
    return found, remarks


def _scale_remark(of: str, x: Array, true: Array, angle: float, residual: float) -> str:
    """Return a remark where a path (T, 2), turned by an angle, fits the true one far better in another size; "" else.

    Source: S. Umeyama, as `fit_frame`, with the scale.
    """
    a, b = (x - x.mean(0)) @ rotation(angle).T, true - true.mean(0)
    scale = float((a * b).sum() / max((a**2).sum(), 1e-12))
    scaled = rms(b - scale * a)
    if not scaled < SHIFTED * residual:
        return ""
    fits = f"fits the truth to {residual:.3g} m once aligned, and to {scaled:.3g} m with lengths times {scale:.3g}"
    return f"{of} {fits}: is its scale that of metres?"


def path_remarks(name: str, team: Team, truth: Team) -> list[str]:
    """Return remarks on robots whose paths fit the truth of another, or that of other times, far better."""
    if min(len(one.stamp) for one in team.values()) < ENOUGH:
        return []
    exchanged = _exchanged_names(name, team, truth)
    others = (robot for robot in truth if robot not in exchanged)
    clocks = (_clock_remark(f"{name}: robot {robot!r}", team[robot], truth[robot]) for robot in others)
    return [*exchanged.values(), *filter(None, clocks)]


def _clock_remark(of: str, one: Trajectory, true: Trajectory) -> str:
    """Return a remark where a path fits the truth far better at earlier or later times; "" else."""
    if not (found := _best_shift(one, true)):
        return ""
    shift, best, now = found
    fits = f"fits the truth to {now:.3g} m once aligned, and to {best:.3g} m with {shift:.3g} s added to its stamps"
    return f"{of} {fits}: if clocks differ, add them"


def _best_shift(one: Trajectory, true: Trajectory) -> tuple[float, float, float] | None:
    """Return the shift [s] of its stamps with which a path fits the truth far better, the misfit [m] then and now.

    Now is infinite where the stamps of both share little time: then the shift begins at that of their first stamps.
    """
    few = _thin(one)

    def misfits(shifts: Array) -> Array:
        """Return the root mean square distance [m] with each shift, once the path is aligned as by `fit_frame`."""
        at = few.stamp + shifts[:, None]
        inside = (at >= true.stamp[0]) & (at <= true.stamp[-1])
        count = np.maximum(inside.sum(1), 1)[:, None]
        x = np.broadcast_to(few.x[:, :2].T[:, None], (2, *at.shape))
        path = np.stack([np.interp(at, true.stamp, true.x[:, k]) for k in range(2)])
        (ax, ay), (bx, by) = (
            np.where(inside, each - (each * inside).sum(-1, keepdims=True) / count, 0.0) for each in (x, path)
        )
        overlap = np.hypot((ax * bx + ay * by).sum(1), (ax * by - ay * bx).sum(1))
        square = ((ax**2 + ay**2 + bx**2 + by**2).sum(1) - 2 * overlap) / count[:, 0]
        return np.where(inside.sum(1) < max(3, len(few.stamp) / 2), np.inf, np.sqrt(np.maximum(square, 0.0)))

    def search(shifts: Array) -> tuple[float, float]:
        found = misfits(shifts)
        return float(shifts[np.argmin(found)]), float(found.min())

    now, (shift, best) = float(misfits(np.zeros(1))[0]), search(SHIFTS)
    if best < SHIFTED * now < np.inf:
        return shift, best, now
    if now < ELSEWHERE * spread_of(true.x):
        return None
    start = 0.0 if now < np.inf else true.stamp[0] - few.stamp[0]
    far = start + np.linspace(-0.5, 0.5, 401) * np.ptp(true.stamp)
    shift, best = search(search(far)[0] + SHIFTS / SHIFTS[-1] * (far[1] - far[0]))
    return (shift, best, now) if best < ELSEWHERE * min(now, spread_of(true.x)) else None


def _thin(one: Trajectory) -> Trajectory:
    """Return at most a thousand poses, evenly spread."""
    return one.select(np.unique(np.linspace(0, len(one.stamp) - 1, 1000).astype(int)))


def _exchanged_names(name: str, team: Team, truth: Team) -> dict[str, str]:
    """Return remarks by robot where paths fit the truth far better once names are exchanged; none else."""
    robots, far = list(truth)[:LOOKED_AT], max(spread_of(one.x) for one in truth.values())
    misfits = np.full((len(robots), len(robots)), 1e3 * far)
    for i, path in enumerate(_thin(team[robot]) for robot in robots):
        for k, true in enumerate(truth[robot] for robot in robots):
            at = np.stack([np.interp(path.stamp, true.stamp, true.x[:, c], np.nan, np.nan) for c in range(2)], -1)
            there: Mask = np.asarray(np.isfinite(at).all(1))
            if there.mean() > 0.5:
                misfits[i, k] = fit_frame(path.x[there, :2], at[there])[2]
    mine, whose = linear_sum_assignment(misfits**2)
    if not np.square(misfits[mine, whose]).sum() < SHIFTED**2 * np.square(misfits.diagonal()).sum():
        return {}
    return {
        robots[i]: f"{name}: robot {robots[i]!r} fits the truth to {misfits[i, i]:.3g} m once aligned, and that of "
        f"{robots[k]!r} to {misfits[i, k]:.3g} m: are names exchanged?"
        for i, k in zip(mine, whose, strict=True)
        if i != k
    }


def _heading_remark(of: str, heading: Array, true: Array) -> str:
    """Return a remark where headings (T,) are off by quarters of a turn, or turn the other way; "" else."""
    known = np.isfinite(heading) & np.isfinite(true)
    if known.sum() < 3:
        return ""
    differ, turns = (complex(np.exp(1j * (true[known] + sign * heading[known])).mean()) for sign in (-1, 1))
    off = float(np.angle(differ))
    quarters = round(off / (np.pi / 2))
    if abs(differ) > 0.9 and quarters and abs(off - quarters * np.pi / 2) < TURNED:
        return f"{of} has headings that are off by {np.degrees(off):.3g} degrees: are they those from x to y?"
    if abs(turns) > 0.9 and abs(differ) < 0.7:
        return f"{of} has headings that fit the truth with the other sign: are they counter-clockwise?"
    return ""


def _speed_remark(of: str, true: Trajectory) -> str:
    """Return a remark where a robot moves at a speed of other units than m and s; "" else."""
    stamps, span = true.stamp, np.ptp(true.stamp)
    rows = np.unique(np.searchsorted(stamps, np.linspace(stamps[0], stamps[-1], BLOCKS**2)))
    length = np.hypot(*np.diff(true.x[rows, :2], axis=0).T).sum()
    if not span or np.ptp(true.x[:, :2], axis=0).max() < STANDING or SLOWEST < length / span < FASTEST:
        return ""
    return f"{of} moves at {length / span:.3g} m/s: are its lengths in m, and its stamps in s?"


def _held_remark(robot: str, one: Trajectory, true: Array) -> str:
    """Return a remark where true poses (T, 3) stay the same to the last digit, then jump as the robot did; "" else."""
    same = np.concatenate([[False], (np.diff(true[:, :2], axis=0) == 0).all(1), [False]])
    first, last = np.flatnonzero(np.diff(same.astype(int)) == 1), np.flatnonzero(np.diff(same.astype(int)) == -1)
    after = np.minimum(last + 1, len(true) - 1)
    moved, jump = (np.hypot(*step.T) for step in (one.x[last, :2] - one.x[first, :2], true[after, :2] - true[last, :2]))
    step = np.median(np.hypot(*np.diff(one.x[:, :2], axis=0).T)) if len(true) > 1 else 0.0
    if not (held := (moved > HELD) & (jump > moved / 2) & (jump > JUMP * step)).any():
        return ""
    stay = f"stay the same in {(one.stamp[last] - one.stamp[first])[held].sum():.4g} s, in which it moves"
    return f"truth: the poses of robot {robot!r} {stay} {moved[held].sum():.3g} m: leave them out"


def _require_units(of: str, x: Array, true: Array) -> None:
    """Refuse a path (T, 3) that fits the true one in another unit of length, or whose headings do as degrees."""
    spread, size = spread_of(true), spread_of(x)
    times = size / spread if spread > STANDING and size > 0 else 1.0
    if not 0.1 < times < 10 and fit_frame(x[:, :2] / times, true[:, :2])[2] < MIRRORED * spread:
        raise BadInput(f"{of} has the true path {times:.3g} times as large: write m, or name its columns x_mm, y_mm")
    both = np.isfinite(x[:, 2]) & np.isfinite(true[:, 2])
    as_it_is, as_degrees = (abs(np.exp(1j * (true[both, 2] - h)).sum()) for h in (x[both, 2], np.radians(x[both, 2])))
    is_turning = abs(np.exp(1j * true[both, 2]).sum()) < 0.9 * both.sum()  # else any small numbers fit
    if is_turning and as_it_is < 0.5 * both.sum() < 0.9 * both.sum() < as_degrees:
        raise BadInput(f"{of} has headings that fit the truth as degrees: write rad, or name the column heading_deg")


def spread_of(x: Array) -> float:
    """Return the root mean square distance [m] of places (T, 2 or more) from their mean."""
    return float(np.sqrt(x[:, :2].var(0).sum()))


def rms(x: Array) -> float:
    """Return the root mean square length of vectors (T, 2)."""
    return float(np.sqrt((x**2).sum(1).mean()))


def rotation(angle: float | Array) -> Array:
    """Return the matrices (..., 2, 2) that turn the plane by angles (...) [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


def fit_frame(a: Array, b: Array) -> tuple[float, Array, float]:
    """Return the angle and shift of least squares that take points a (m, 2) to b, and the RMSE that is left.

    Source: S. Umeyama, IEEE Trans. PAMI 13, 1991, without scale; in the plane its rotation is one angle.
    """
    from_a, from_b = a - a.mean(0), b - b.mean(0)
    angle = float(
        np.arctan2((from_a[:, 0] * from_b[:, 1] - from_a[:, 1] * from_b[:, 0]).sum(), (from_a * from_b).sum())
    )
    shift = b.mean(0) - rotation(angle) @ a.mean(0)
    left = from_b - from_a @ rotation(angle).T
    return angle, shift, rms(left)


def turn_covariances(P: Array, angle: Array) -> Array:
    """Return covariances (T, 3, 3) in axes that are turned back by an angle (T,) [rad]: R P R'; heading's stays."""
    R = np.tile(np.eye(3), (len(P), 1, 1))
    R[:, :2, :2] = rotation(angle)
    known = np.where(np.isnan(P), 0.0, P)
    return np.where(np.isnan(P), np.nan, R @ known @ R.swapaxes(1, 2))


def _axes_remark(of: str, one: Trajectory, turned: Array, true: Array, axes: str) -> list[str]:
    """Return a remark where errors fit covariances in the other axes better, in almost every part of the path.

    `turned` are the covariances if they are stated in the robot's axes. The determinant is the same in both, so that
    the smaller NEES is the likelier.
    """
    error = one.x[:, :2] - true[:, :2]
    known: Mask = np.asarray(np.isfinite(one.P[:, :2, :2] + turned[:, :2, :2]).all((1, 2)))
    known &= np.linalg.det(np.where(known[:, None, None], one.P[:, :2, :2], 0.0)) > 0
    if np.count_nonzero(known) < 10 * BLOCKS:
        return []
    nees = {
        said: np.einsum("ti,ti->t", error[known], np.linalg.solve(P[known, :2, :2], error[known][..., None])[..., 0])
        / 2
        for said, P in zip(AXES, (one.P, turned), strict=True)
    }
    (other,) = {*AXES} - {axes}
    here, there = nees[axes], nees[other]
    parts = zip(np.array_split(here, BLOCKS), np.array_split(there, BLOCKS), strict=True)
    better = sum(b.mean() < a.mean() for a, b in parts)
    if better < BLOCKS - 1 or there.mean() > 0.8 * here.mean():
        return []
    return [
        f"{of} fit in axes of the {other} (ANEES {there.mean():.3g}) better than in those of the {axes} "
        f"({here.mean():.3g}): if they are stated so, --axes {other}"
    ]
