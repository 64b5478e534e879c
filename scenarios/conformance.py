"""`check_estimator`: does an estimator keep to the rules of the comparison?

It runs on small simulated streams, again and again with readings perturbed or hidden, packets dropped, trials
reordered. A check compares such runs, bit by bit, and says where they differ first: a function that takes a `Harness`,
returns what it tried and saw, and raises `CheckFailed` or `CheckSkipped`; its remedy stands in `REMEDIES`.

Modelled on scikit-learn's check_estimator and PettingZoo's API tests.
"""

import contextlib
import io
import math
import pickle
import random
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import FunctionType
from typing import Any

import cloudpickle
import numpy as np

from cooploc.estimators import is_builtin, make
from cooploc.estimators.errors import BadInput, count_of, one_line
from cooploc.estimators.interface import Belief, Mail, Mask
from cooploc.estimators.label_syntax import expand, shorten_labels
from cooploc.estimators.models import Displacement, Unicycle, wrap_heading
from cooploc.estimators.registry import refusal
from cooploc.scenarios import variations
from cooploc.scenarios.check_harness import (
    ABSENT_READINGS,
    COVARIANCES,
    RUN_SHARE,
    WITH_GAPS,
    CheckFailed,
    CheckSkipped,
    Harness,
    RunRecord,
    require_equal,
    require_none,
)
from cooploc.scenarios.process import PLUGINS, SESSION, WorkerError, call
from cooploc.scenarios.runner.run import OFFLINE, ROBOT, label_of, list_table, make_instance, missing_methods
from cooploc.scenarios.runner.tick import Watcher
from cooploc.scenarios.runner.trace import ROUNDING, trace
from cooploc.scenarios.stream import Stream

TIME_LIMIT = 600.0  # [s] for all checks of one estimator
LONG = 120  # ticks of the longer streams, on which a channel that is seldom used is looked for again
TOLERANCE = 0.05  # of the stated standard deviation by which an estimate may miss a turned world
ROUNDED = 1e-6  # [m], [rad] and their squares


@dataclass(frozen=True)
class Result:
    """The outcome of one check."""

    check: str
    status: str  # "passed", "failed" or "skipped"
    detail: str  # what was tried and seen, and of a failure where; of a skipped check the reason
    seed: int
    remedy: str = ""  # of a failure, what to change
    exempt: str = ""  # of a check that passed in part, what it left out and why

    def __str__(self) -> str:
        fix = f"; to fix it: {self.remedy}" if self.remedy else ""
        return f"{self.detail} (seed {self.seed}){fix}" if self.status == "failed" else self.detail


@dataclass(frozen=True, repr=False)
class Report:
    """The outcomes of all checks."""

    name: str
    results: tuple[Result, ...]

    @property
    def passed(self) -> bool:
        """Whether some checks ran, and none failed."""
        return self.ran > 0 and all(r.status != "failed" for r in self.results)

    @property
    def ran(self) -> int:
        """The number of checks that ran."""
        return sum(r.status != "skipped" for r in self.results)

    def __getitem__(self, check: str) -> Result:
        return {r.check: r for r in self.results}[check]

    def table(self) -> str:
        """Return the results as aligned text: each check, and after a failure its remedy."""
        first = max((len(r.check) for r in self.results), default=0)
        lines = [f"{r.check:{first}}  {r.status:7}  {r}" for r in self.results]
        return "\n".join([*lines, self.summary()])

    def summary(self) -> str:
        """Say how many of the checks passed, failed and were skipped."""
        counts = Counter(r.status for r in self.results)
        of = f" of {len(self.results)}" * (counts["passed"] < len(self.results))
        rest = "".join(f", {counts[status]} {status}" for status in ("failed", "skipped") if counts[status])
        return f"{shorten_labels(self.name)}: {counts['passed']}{of} checks passed{rest}"

    def __repr__(self) -> str:
        return f"Report({self.summary()!r})"

    def _repr_html_(self) -> str:
        rows = [(r.check, r.status, str(r)) for r in self.results]
        return list_table(("check", "result", "what was found"), self.summary(), rows)


def check_estimator(
    estimator: Any,
    name: str | None = None,
    seed: int = 0,
    isolate: bool = True,
    time_limit: float = TIME_LIMIT,
    scenarios: str | Sequence[str] = (),
    data: str | Path | None = None,
) -> Report:
    """Run every check on an estimator: it may neither cheat nor break the interface.

    Args:
        estimator: its name, a class that needs no arguments, or an instance.
        name: what to call it in the report.
        seed: seeds the small streams, and what is done to them.
        isolate: False checks it in this process, for a debugger; else one that is not built in has a process of its
            own, where it may crash or hang.
        time_limit: [s] for all checks in that process, of which one run may take a tenth; those that are left are
            skipped. math.inf for none.
        scenarios: a label, or several, of others to try it on where it reads a channel that our small worlds lack,
            also if it can do without.
        data: the directory of those that are recordings.

    Returns:
        A report: `passed`, `table()`, and a `Result` for each check, `report["causality"]`.

    Raises:
        BadInput: an unknown name, a class that needs arguments, a seed that is not a whole number of 0 or more, or a
            time limit of nothing. What the estimator raises while it runs is a failure in the report.
    """
    name = name or label_of(estimator)
    if not time_limit > 0:
        raise BadInput(f"time_limit is {time_limit:g}; it must be above 0 s")
    labels = [scenarios] if isinstance(scenarios, str) else scenarios
    where = tuple(each for label in labels for each in expand(label)), data and Path(data)
    if not isolate or is_builtin(estimator):
        return _check_here(estimator, name, seed, math.inf, *where)
    run_limit = RUN_SHARE * time_limit
    longest = time_limit + run_limit
    owner = PLUGINS if isinstance(estimator, str) else SESSION  # a file's neighbours are not those of an object
    try:
        report: Report = call(
            owner, _check_quietly, estimator, name, seed, time_limit, *where, seconds=longest, limit=run_limit
        )
        return report
    except (WorkerError, MemoryError) as e:
        why = str(e) if isinstance(e, WorkerError) else one_line(e)
        failed = Result("runs", "failed", why, seed, "cooploc check --no-isolate shows where; --time-limit gives more")
        others = (Result(check, "skipped", FIRST["runs"], seed) for check in CHECKS if check != "runs")
        return Report(name, (failed, *others))


def _check_quietly(*asked: Any) -> Report:
    """Run the checks without what the estimator prints in 150 runs."""
    with contextlib.redirect_stdout(io.StringIO()):
        return _check_here(*asked)


def _check_here(estimator: Any, name: str, *how: Any) -> Report:
    """Run the checks in this process; after a failure of one of `FIRST`, no other means anything."""
    harness, results, reason = Harness(name, make_instance(estimator), *how), list[Result](), ""
    for check in CHECKS:
        results.append(Result(check, "skipped", reason, harness.seed) if reason else run_check(check, harness))
        reason = reason or (FIRST.get(check, "") if results[-1].status == "failed" else "")
    return Report(name, tuple(results))


def run_check(name: str, harness: Harness) -> Result:
    """Run one check; whatever the estimator raises is a failure."""
    check, before = CHECKS[name], harness.runs
    try:
        detail = f"{check(harness)} ({count_of(harness.runs - before, 'run')})"
        axes = harness.traits.axes
        exempt = f"axes: {axes}" if axes and name == "equivariance" else ""
        return Result(name, "passed", detail, harness.seed, exempt=exempt)
    except CheckSkipped as e:
        return Result(name, "skipped", str(e), harness.seed)
    except CheckFailed as e:
        return Result(name, "failed", str(e), harness.seed, e.remedy or REMEDIES[check])
    except BadInput:
        raise
    except (Exception, SystemExit, GeneratorExit) as e:
        return Result(name, "failed", one_line(e), harness.seed, REMEDIES[check])


# The checks. All but equivariance compare bitwise.


def runs(harness: Harness) -> str:
    """Require the methods of the interface, and estimates that are finite and of the right shape."""
    estimator, about = harness.estimator, harness.traits
    if isinstance(estimator, type):
        raise CheckFailed(f"it is the class {estimator.__name__}, not an instance", f"pass {estimator.__name__}()")
    if not any(hasattr(estimator, method) for method in (*ROBOT, *OFFLINE)):
        raise CheckFailed(f"it is of type {type(estimator).__name__} and has no method of an estimator", "name another")
    if reason := refusal(estimator):
        fact, _, remedy = reason.rpartition(": ")
        raise CheckFailed(fact, remedy)
    for method in missing_methods(estimator):
        raise CheckFailed(f"it has no method {method}()", "add it; cooploc.estimators.interface describes it")
    if about.team and not about.offline and not isinstance(getattr(estimator, "bound", None), bool):
        raise CheckFailed("it does not say whether it is a bound", "set bound = True or bound = False")
    labels = [stream.scenario.removesuffix(WITH_GAPS).partition("[")[0] for stream in harness.streams]
    t, T, _, _ = harness.cases[0][1].trace.x.shape
    trials = f"{count_of(t, 'trial')} of {T} ticks of {', '.join(labels)}"
    return f"ran on {trials}: every estimate is finite and of the right shape"


def determinism(harness: Harness) -> str:
    """Require the same bits with everything the same: other global seeds, after other runs, and after pickle."""
    for stream, base in harness.cases:
        random.seed()  # by the system's entropy: another seed than whichever came before
        np.random.seed()  # noqa: NPY002, TID251
        harness.run(stream.select([0]).first_ticks(3), "another, shorter stream came before")
        harness.require_same(base, stream, "it ran a second time, after a run on a shorter stream")
        try:
            other = pickle.loads(cloudpickle.dumps(harness.estimator))
        except Exception as e:
            fault = f"it cannot be pickled, so it cannot run in parallel: {one_line(e)}"
            raise CheckFailed(fault, "make it a frozen dataclass, its parameters plain values") from e
        when = "it ran after a round trip through pickle"
        require_equal(base, harness.run(stream, when, estimator=other), when)
    return "it ran again, after other runs, with other global seeds and after pickling: the same bits"


def truth_blindness(harness: Harness) -> str:
    """Require the same bits under another label, by which a truth could be simulated again."""
    for stream, base in harness.cases:
        harness.require_same(base, replace(stream, scenario="another label"), "the stream had another label")
    return "it ran on a stream with another label: the same bits"


def causality(harness: Harness) -> str:
    """Require that nothing up to tick k depends on what comes after it."""
    if harness.traits.offline:
        raise CheckSkipped("it is offline: it sees later readings by definition")
    for stream, base in harness.cases:
        last = len(stream.time)
        for k in (last // 4, 2 * last // 3):
            for mode in variations.MODES:
                other = variations.perturb_readings(stream, mode, harness.rng, since=k + 1)
                harness.require_same(base, other, f"readings after tick {k} were {mode}", ticks=k + 1)
            cut = variations.drop_packets(stream, since=k + 1)
            harness.require_same(base, cut, f"links were cut after tick {k}", ticks=k + 1)
            harness.require_same(base, stream.first_ticks(k + 1), f"the stream ended after tick {k}")
    return "future readings were perturbed and hidden, links and the stream cut off: nothing before them changed"


def link_honesty(harness: Harness) -> str:
    """Require that dropped packets change nothing."""
    if harness.centralised:
        raise CheckSkipped("it is centralised and needs no packets")
    for stream, _ in harness.team_cases:
        since = len(stream.time) // 3
        for robot in range(stream.robots):
            cut = variations.drop_packets(stream, robot, since)
            base = harness.run(cut, f"no packet of robot {robot} arrived from tick {since} on")
            while_dropped = f"from tick {since} on while all its packets were dropped"
            _require_others_same(harness, base, robot, while_dropped, since=since)
    return "readings behind dropped packets made no difference"


def _require_others_same(
    harness: Harness, base: RunRecord, robot: int, meanwhile: str, watch: Watcher | None = None, since: int = 0
) -> None:
    """Perturb and hide one robot's readings from tick `since` on: no other robot's result may change."""
    for mode in variations.MODES:
        when = f"robot {robot}'s readings were {mode} {meanwhile}"
        other = variations.perturb_readings(base.stream, mode, harness.rng, robot, since)
        require_equal(base, harness.run(other, when, watch=watch), when, np.arange(base.stream.robots) != robot)


def non_interference(harness: Harness) -> str:
    """Require rows that are independent: of other trials, and while its mail stays the same of other robots."""
    mails: dict[int, Mail] = {}

    def record(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        if method == "fuse":
            mails[tick] = arguments[2]
        return call(*arguments)

    def replay(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        return call(*arguments[:2], mails[tick]) if method == "fuse" else call(*arguments)

    for stream, _ in [] if harness.centralised else harness.team_cases:
        # the runner carries no packets for a team, which is to be silent instead
        quiet = variations.drop_packets(stream) if harness.traits.team else stream
        alone = harness.run(quiet, "it ran again", watch=record)
        for robot in range(stream.robots):
            _require_others_same(harness, alone, robot, "while the mail stayed as it was", watch=replay)
    for stream, base in harness.cases:
        everything = list(range(len(stream.trial)))
        for order in (*([i] for i in everything), everything[::-1]):
            when = f"trials {stream.trial[order].tolist()} ran instead of all {len(everything)} in order"
            expected, found = base.select(order), harness.run(stream.select(order), when)
            require_equal(expected, found, when)
            for what in ("messages", "bytes"):
                differs = getattr(expected.trace, what) != getattr(found.trace, what)
                require_none(differs[:, None], found.stream, f" sent other {what} when {when}")
    if harness.centralised:
        return "trials alone and in reverse order: the same bits; of other robots it knows all, as it is centralised"
    return "trials alone and in reverse order, other robots' readings changed behind the same mail: the same bits"


def immutability(harness: Harness) -> str:
    """Require that methods write to nothing that they are given, and that parameters stay."""

    def compare(method: str, tick: int, arguments: tuple[Any, ...], call: Any) -> Any:
        inputs = ("prior", "world", "rows") if method in ("init", "smooth") else ("state",)
        named = dict(zip((*inputs, "senses", "mail"), arguments, strict=False))
        if harness.traits.mutable:
            named.pop("state", None)
        before = {name: _dump_data(one) for name, one in named.items()}
        result = call(*arguments)
        for name, one in named.items():
            if _dump_data(one) != before[name]:
                raise CheckFailed(f"{name} was changed by {method}() at tick {tick} of {label!r}")
        return result

    parameters = _dump_data(harness.estimator)
    for stream, base in harness.cases:
        label, when = stream.scenario, "it ran a second time"
        require_equal(base, harness.run(stream, when, watch=compare), when)
    if _dump_data(harness.estimator) != parameters:
        raise CheckFailed("its parameters were changed by running")
    exempt = "; its state is exempt, as it declares mutable = True" if harness.traits.mutable else ""
    return f"inputs, states and parameters were compared before and after each call: no change{exempt}"


class _DataPickler(cloudpickle.Pickler):  # type: ignore[misc]
    """Pickles data alone: classes and functions by their identity, as Python notes things in those of a notebook."""

    def persistent_id(self, thing: Any) -> int | None:
        return id(thing) if isinstance(thing, type | FunctionType) else None


def _dump_data(value: Any) -> bytes:
    """Return bytes that differ where the data of an object does."""
    file = io.BytesIO()
    _DataPickler(file).dump(value)
    return file.getvalue()


def nan_safety(harness: Harness) -> str:
    """Require finite estimates where single readings are absent, one channel, or odometry."""
    ways = 0
    for stream in harness.streams:
        for channel, name in harness.arrays(stream).items():
            array = stream.arrays()[name]
            for how, share in (("single", 0.3), ("all", 1.0)):
                some = np.where(harness.rng.uniform(size=array.shape) < share, np.nan, array)
                harness.run(stream.replace_arrays({name: some}), f"{how} readings of {channel} were absent")
                ways += 1
    if not ways:
        raise CheckSkipped("it reads no channel")
    return f"single and all readings of each channel were made absent in {ways} ways: every estimate stayed finite"


def covariance(harness: Harness) -> str:
    """Require covariances that are symmetric, and without a negative variance, of perturbed readings too."""
    for stream in harness.streams:
        for mode in variations.MODES:
            harness.run(variations.perturb_readings(stream, mode, harness.rng), f"readings were {mode}")
    return f"P was symmetric and positive semidefinite to {ROUNDING:g} of its largest entry at every tick"


def silence(harness: Harness) -> str:
    """Require that with odometry alone it moves as dead reckoning does, and that its uncertainty never shrinks.

    It agrees to one standard deviation of what odometry adds; one that draws random numbers, whose mean may wander as
    few particles do, to one more of what it states, and its covariance may shrink by chance. Where odometry has led out
    of the arena it may do as it likes.
    """
    if harness.traits.own_motion:
        raise CheckSkipped(f"own_motion: {harness.traits.own_motion}")
    moving = [stream for stream in harness.streams if "odometry" in harness.arrays(stream)]
    if not moving:
        raise CheckSkipped("it declares no odometry, so where it goes without other readings is its own affair")
    quietly = "nothing was sensed but odometry and no packet arrived"
    for stream in moving:
        quiet = variations.drop_packets(variations.hide(stream, *variations.can_be_absent(stream)))
        found, dead = harness.run(quiet, quietly).trace, trace("dead-reckoning", make("dead-reckoning"), quiet)
        stated, variance = (P[..., 0, 0] + P[..., 1, 1] for P in (found.P, dead.P))
        growth = np.sqrt(np.maximum(variance - variance[:, :1], 0.0))
        allowed = growth + 0.1 * growth[:, -1:] + (0.0 if harness.deterministic else np.sqrt(stated))
        moved, expected = (x[..., :2] - x[:, :1, :, :2] for x in (found.x, dead.x))
        low, high = quiet.world.arena
        inside = np.logical_and.accumulate(((dead.x[..., :2] > low) & (dead.x[..., :2] < high)).all(-1), axis=1)
        off = np.where(inside, np.sqrt(((moved - expected) ** 2).sum(-1)), 0.0)
        most = f"{(off - allowed).max():.2g} m more than the up to {allowed.max():.2g} m that are allowed"
        require_none(off > allowed, quiet, f" is away from where odometry leads, by {most}, when {quietly}")
        shrunk = np.diff(stated, axis=1, prepend=stated[:, :1]) < -ROUNDING * stated
        if harness.deterministic:
            require_none(shrunk, quiet, f"'s position variance shrank when {quietly}")
    return f"{quietly}: it moved as dead reckoning does, to one standard deviation"


def declaration(harness: Harness) -> str:
    """Require that every declared channel changes a result somewhere, and that a team's traffic adds up.

    A channel that matters seldom is looked for again in longer streams, and in those where the first robot starts with
    a hundredth of its standard deviation: covariance intersection of equal beliefs never pays.
    """
    for stream, base in harness.cases:
        messages, sent = base.trace.messages, base.trace.bytes
        sound = np.isfinite(messages) & (messages >= 0) & (messages == np.round(messages)) & (sent >= 8 * messages)
        sound &= (messages > 0) | (sent == 0)
        require_none(~sound[:, None], stream, " states messages and bytes of which each has no header of 8 bytes")
    declared = unused = {channel for stream in harness.streams for channel in harness.arrays(stream)}
    for ticks, factor in ((harness.ticks, 1.0), (LONG, 1.0), (LONG, 1e-4)):
        for stream in harness.of_length(ticks).streams if unused else ():
            P = stream.prior.P.copy()
            P[:, 0] *= factor
            unused = unused - _find_used(harness, stream.replace_arrays({"prior.P": P}), unused)
    if unused:
        raise CheckFailed(f"it declares {', '.join(sorted(unused))}, but that never changed an estimate or a packet")
    return f"each declared channel ({', '.join(sorted(declared))}) changed a result; messages and bytes add up"


def _find_used(harness: Harness, stream: Stream, channels: set[str]) -> set[str]:
    """Return those of these channels that change anything on a stream where they are perturbed, or hidden."""
    base, found = harness.run(stream, ""), set()
    for channel, name in harness.arrays(stream).items():
        array = stream.arrays()[name]
        perturbed = stream.replace_arrays({name: array + 0.1 * harness.rng.normal(size=array.shape)})
        if channel in channels and any(harness.differs(base, s) for s in (perturbed, variations.hide(stream, name))):
            found.add(channel)
    return found


def equivariance(harness: Harness) -> str:
    """Turn the world by 90 degrees and shift it; require that the estimates follow.

    Only for estimators without randomness, and to a tolerance, as other coordinates round differently. For one that
    states why it lies along the `axes`, the world is only shifted.
    """
    if not harness.deterministic:
        raise CheckSkipped("it draws random numbers, which do not turn with the world")
    axes = harness.traits.axes
    turn, moved = (np.eye(2), "shifted") if axes else (variations.QUARTER, "turned by 90 degrees and shifted")
    known = [case for case in harness.cases if _turns(case[0])]
    if not known:
        raise CheckSkipped("it is not known how this scenario's channels or odometry turn with the world")
    for stream, base in known:
        expected = variations.move_belief(Belief(base.trace.x, base.trace.P), turn)
        try:  # some estimators take the anchors one by one, some want the corners in order
            _require_close(harness, expected, variations.move_world(stream, turn, roll=0), f"the world was {moved}")
        except CheckFailed:
            if axes:
                raise
            _require_close(harness, expected, variations.move_world(stream, turn, roll=1), f"the world was {moved}")
    left = f"; not turned, as {axes}" if axes else ""
    return f"the world was {moved}: the estimates followed to {TOLERANCE:.0%} of a standard deviation{left}"


def _turns(stream: Stream) -> bool:
    """Whether it is known how a stream's readings turn with the world."""
    return stream.senses.extra.keys() <= {"anchor_range"} and isinstance(stream.world.motion, Displacement | Unicycle)


def _require_close(harness: Harness, expected: Belief, stream: Stream, when: str) -> None:
    """Run on the stream, and compare with the beliefs expected there."""
    found = harness.run(stream, when).trace
    sd = np.sqrt(np.maximum(np.diagonal(expected.P, axis1=-2, axis2=-1), 0.0))
    off_x, off_P = np.abs(wrap_heading(expected.x - found.x)), np.abs(expected.P - found.P)
    for what, off, scale in (("estimate", off_x, sd), ("covariance", off_P, sd[..., None] * sd[..., None, :])):
        far: Mask = np.asarray((off > TOLERANCE * scale + ROUNDED).reshape(*off.shape[:3], -1).any(-1))
        require_none(far, stream, f"'s {what} did not follow when {when}: it is up to {off.max():.2g} away")


FIRST = {  # checks without which no other one means anything, and why
    "runs": "it does not run",
    "determinism": "it does not repeat itself, so no two of its runs can be compared",
}
REMEDIES: dict[Callable[[Harness], str], str] = {
    runs: "correct it there; an absent reading is nan, and an absent channel has width 0",
    determinism: "draw random numbers from rows.key alone, and store everything in the state that init() makes: no "
    "global generator, cache, counter, clock, id() or hash(); a library that draws globally gets a keyed generator by "
    "cl.PerRobot(..., own_random=True)",
    truth_blindness: "use only what the methods are given",
    causality: "use only what the methods are given in this tick, and your own state",
    link_honesty: "use a packet and its radio readings only where mail.heard is True, and nothing else of a teammate",
    non_interference: "compute each row from that row alone, without a sum, mean or matrix product over rows; "
    "teammates' data come in only through `mail`, in fuse()",
    immutability: "copy an array before writing to it, return a new state, and store nothing in parameters or module "
    "variables",
    nan_safety: ABSENT_READINGS,
    covariance: COVARIANCES,
    silence: "where nothing is sensed or heard, move by odometry alone and let P grow; a method that must move "
    "otherwise, as a constant-velocity filter or Euler's integration, says why in a class variable: own_motion = '...'",
    declaration: "name in `uses` only channels that change the estimate; a message costs 8 bytes and its payload",
    equivariance: "take positions and directions only from the prior, the world and the readings; where the method "
    "itself lies along the axes, as sigma points and grids do, say so: axes = 'its sigma points lie along the axes'",
}
CHECKS = {check.__name__.replace("_", "-"): check for check in REMEDIES}  # in the order in which they run
