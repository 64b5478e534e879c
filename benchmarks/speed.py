"""What speed was aimed at and what is reached: `reports/speed.md`, every line with its median, range and aim.

Run: python benchmarks/speed.py [REPORT [ROUNDS]]. Processor time; what is compared is measured turn by turn in one
process, so that others on the machine slow both. The references are in reference_loops.py.
"""

import os
import resource
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from reference_loops import Filterpy, ask_cvxpy, lean_loop
from scipy.stats import linregress, t

import cooploc as cl
from cooploc.analysis.execution.provenance import provenance
from cooploc.analysis.plot import style
from cooploc.estimators.compiled import kernel, wide
from cooploc.estimators.covariance_intersection import solve_relative
from cooploc.scenarios.runner.trace import trace, warm_up

REPORTS = Path(__file__).resolve().parents[1] / "reports"
NOTES = "<!-- speed-notes: "  # what reports/page.py writes from here on
NO_NOTES = "python reports/page.py speed-notes RUNS reports/speed.md -->\n\n<!-- end of speed-notes -->\n"
HEAD = """# Speed

What `make bench` measured, in processor time, each ratio of two things that ran turn by turn in one process. "short by"
is how far the median is from the aim, as a factor; empty where the aim is met. "older" is of cvxpy the median of
`Problem.solve`, of a recording's filter that of its twin with `engine="filterpy"`.

{machine}

| | median | range | aim | short by | older |
| --- | ---: | ---: | ---: | ---: | ---: |
"""
EQUAL = 1e-7  # [m] within which a filter and its reference must agree


class Line(NamedTuple):
    """One measured number."""

    what: str
    values: Any  # (rounds,)
    aim: float
    at_most: bool  # else at least
    older: Any = None  # (rounds,)  of what one would use else

    def row(self) -> str:
        """Return the line as a row of the table."""
        median = float(np.median(self.values))
        short = median / self.aim if self.at_most else self.aim / median
        aim = f"{'at most' if self.at_most else 'at least'} {self.aim:g}"
        spread = f"{np.min(self.values):.3g} to {np.max(self.values):.3g}"
        older = "" if self.older is None or np.size(self.older) == 0 else f"{np.median(self.older):.3g}"
        by = f"{short:.2f} x" if short > 1 else ""
        return f"| {self.what} | {median:.3g} | {spread} | {aim} | {by} | {older} |\n"


def seconds(work: Callable[[], object]) -> float:
    """Return the processor time of this process."""
    start = process_time()
    work()
    return process_time() - start


# ---------------------------------------------------------------------------------------------- particle filters

OURS = "mrsl-rssi[anchor_reading=rssi,particles=500,precision={}]"
# robots, trials, ticks, the loop's trials and ticks, aims in double and in single precision
TEAMS = ((3, 100, 100, 2, 50, 25, 40), (10, 100, 20, 1, 20, 30, 40), (100, 4, 10, 1, 1, 40, 50))
TWICE, LARGE = 1.8, 10  # single over double, in teams this large
TRIALS, SAME = 1500, 0.1  # [%] by which the errors of both precisions may differ
ERRING = "mrsl-rssi[anchor_reading=rssi,{}]", "mrsl-rssi[{}]", "arl[{}]"


def particles(rounds: int) -> Iterator[Line]:
    """Measure particle filters in both precisions, beside the loop and beside each other."""
    for robots, trials, ticks, few, brief, *aims in TEAMS:
        _, stream = cl.simulate(f"scalability/n={robots}", trials=trials, seed=1, ticks=ticks)
        ours = {kind: {"ours": cl.make(OURS.format(kind))} for kind in ("double", "single")}
        work: dict[str, tuple[Callable[[], object], int]] = {
            **{kind: (partial(cl.run, one, stream, jobs=1), trials * ticks) for kind, one in ours.items()},
            "lean": (partial(lean_loop, stream, few, brief), few * brief),
        }
        for one in ours.values():
            cl.run(one, stream)
        taken = np.array([[seconds(function) / size for function, size in work.values()] for _ in range(rounds)])
        double, single, lean = taken.T
        for kind, mine, aim in zip(ours, (double, single), aims, strict=True):
            yield Line(f"lean filterpy loop / mrsl-rssi in {kind} precision, {robots} robots", lean / mine, aim, False)
        if robots >= LARGE:
            yield Line(f"double / single precision, {robots} robots", double / single, TWICE, False)
    yield from rounding()


def rounding() -> Iterator[Line]:
    """Measure by how much the RMSE of single precision is larger, in percent: lower end, mean, upper end.

    Particles that resampling chooses differently after a rounding part two runs of one filter as another seed would, so
    that errors differ by chance; the interval says how much is chance.
    """
    truth, stream = cl.simulate("trajectory", trials=TRIALS, seed=1)
    for name in ERRING:
        run = cl.run({kind: cl.make(name.format(f"precision={kind}")) for kind in ("double", "single")}, stream)
        rmse = {kind: np.sqrt(((one.x - truth.x) ** 2).sum(-1).mean((1, 2))) for kind, one in run.traces.items()}
        apart, scale = rmse["single"] - rmse["double"], rmse["double"].mean() / 100
        half = 1.96 * apart.std(ddof=1) / np.sqrt(TRIALS)
        label = name.replace(",{}", "").replace("[{}]", "")
        values = (apart.mean() + half * np.array([-1, 0, 1])) / scale
        yield Line(f"RMSE of {label}, single less double [%], 95 % interval", values, SAME, True)


# ---------------------------------------------------------------------------------------------- what bounds them

# Counted in `particle_kernels` and `random_numbers`, of one particle of one tick in double precision; a product and a
# sum that are fused are two. Normals 70, motion 8, the moments twice 90, 38 where all links of teammates meet.
FLOPS, A_LINK, AN_ANCHOR = 206, 58, 36
WORDS = 14  # numbers that go through memory: x, y, log w in and out of both passes, once more where a line is written
AT_ONCE = 64  # independent sums, which keep the arithmetic busy


@kernel
def stream_through(a, b, c):  # three numbers through memory for each two operations
    wide()
    for i in range(len(a)):
        a[i] = b[i] + c[i]


@kernel
def calculate(x, times):  # nothing through memory
    wide()
    scale, one = x[0], x[1]
    for _ in range(times):
        for i in range(AT_ONCE):
            x[i] = x[i] * scale + one


def roofline(rounds: int) -> Iterator[Line]:
    """Measure which share of what the processor can calculate the particle filters use, and draw it beside memory."""
    points, roofs = [], {}
    for kind, name in ((np.float64, "double"), (np.float32, "single")):
        a, b, c = (np.ones(8_000_000, kind) for _ in range(3))
        x, times = np.full(AT_ONCE, 0.5, kind), 4_000_000
        stream_through(a, b, c), calculate(x, 1)
        bandwidth = 4 * a.nbytes / min(seconds(partial(stream_through, a, b, c)) for _ in range(rounds))
        roofs[name] = bandwidth, 2 * AT_ONCE * times / min(seconds(partial(calculate, x, times)) for _ in range(rounds))
        for robots, trials, ticks, *_ in TEAMS:
            _, stream = cl.simulate(f"scalability/n={robots}", trials=trials, seed=1, ticks=ticks)
            mine = cl.make(OURS.format(name))
            cl.run(mine, stream)
            spent = min(seconds(partial(cl.run, mine, stream, jobs=1)) for _ in range(rounds))
            each = spent / (stream.senses.dt.size * 500)
            work, moved = FLOPS + 4 * AN_ANCHOR + (robots - 1) * A_LINK, WORDS * a.itemsize
            points.append((name, robots, work / moved, work / each))
            share = work / each / roofs[name][1]
            yield Line(f"share of the processor's arithmetic, {name} precision, {robots} robots", share, 0.5, False)
    draw_roofline(points, roofs, REPORTS / "speed-roofline.png")


def draw_roofline(points: list[Any], roofs: dict[str, Any], path: Path) -> None:
    """Draw operations a second over operations a byte, below what memory and arithmetic allow."""
    ax, reach = style.new_axes(6.5, 3.8), np.geomspace(0.5, 200, 200)
    for name, colour, line, mark in (("double", "#0072b2", "-", "o"), ("single", "#d55e00", "--", "s")):
        bandwidth, peak = roofs[name]
        ax.plot(reach, np.minimum(reach * bandwidth, peak) / 1e9, line, color=colour, label=f"processor, {name}")
        for _, robots, x, y in (point for point in points if point[0] == name):
            ax.plot(x, y / 1e9, mark, color=colour, label=f"mrsl-rssi, {name}")
            ax.annotate(f"{robots} robots", (x, y / 1e9), (-8, 6), textcoords="offset points", fontsize=8)
    style.finish(ax, "operations per byte", "billion operations a second", grid="both")
    style.set_log_scale(ax.xaxis, 0.5, 200)
    style.set_log_scale(ax.yaxis, 10, 200)
    style.add_legend_below([ax], 2)
    style.save(ax, path)


# ---------------------------------------------------------------------------------------------- weights by cvxpy

FUSIONS, FRESH = 100, 10  # all, and those that the slow contender solves in a round


def weighing(rounds: int) -> Iterator[Line]:
    """Measure the weights of covariance intersection by cvxpy, each fusion a program of its own, as CTRN takes them."""
    rng = np.random.default_rng(2)
    a = rng.normal(size=(FUSIONS, 2, 2))
    P, H = a @ a.mT + 0.1 * np.eye(2), rng.normal(size=(FUSIONS, 1, 2))

    def ask() -> None:
        for p, h in zip(P[:FRESH], H, strict=False):
            ask_cvxpy(p, 0.05 * p, h)

    def solve() -> None:
        solve_relative(P, 0.05 * P, H, -H, np.eye(1), "trace", "cvxpy")

    ask(), solve()  # to compile
    taken = [(seconds(ask) / FRESH, seconds(solve) / FUSIONS) for _ in range(rounds)]
    slow, fast = 1e6 * np.array(taken).T
    yield Line("cvxpy, a range, alone [µs a fusion]", fast, 150, True, slow)


# ---------------------------------------------------------------------------------------------- EKFs

DATA = Path(os.environ.get("COOPLOC_DATA", Path(__file__).parents[2] / "shared" / "data")) / "mrclam6"
FILTERS = tuple(f"ekf-{name}" for name in ("local", "naive", "ci", "split-ci", "luft", "interim", "joint"))
TICKS, FEW = 1500, 300  # the filters', and the twins'


def recorded(rounds: int) -> Iterator[Line]:
    """Measure every EKF on a recording, beside its engine="filterpy" twin, and by the command."""
    there = DATA.is_dir()
    what = "MRCLAM 6" if there else "camera/n=5"
    given: Any = {"data": str(DATA)} if there else {"trials": 1, "seed": 1, "ticks": TICKS}
    _, stream = cl.simulate("mrclam/all" if there else what, **given)
    long, short = stream.first_ticks(TICKS), stream.first_ticks(FEW)
    ours: dict[str, Any] = {name: cl.make(name) for name in FILTERS}
    twins = {name: cl.make(name, engine="filterpy") for name in FILTERS}
    for estimator in (*ours.values(), *twins.values()):
        warm_up("warm", estimator, stream)
    mine, theirs, ratio = (dict[str, list[float]]((name, []) for name in FILTERS) for _ in range(3))
    for _ in range(rounds):
        for name, estimator in ours.items():
            mine[name].append(1e6 * trace(name, estimator, long).seconds / (TICKS * stream.robots))
            brief, other = trace(name, estimator, short), trace(name, twins[name], short)
            ratio[name].append(other.seconds / brief.seconds)
            theirs[name].append(1e6 * other.seconds / (FEW * stream.robots))
            demand_equal(f"the engines of {name}", other.x[..., :2], brief.x[..., :2])
    for name in ours:
        yield Line(f"{what}, {name} [µs per robot and tick]", mine[name], 20, True, theirs[name])
        yield Line(f"its engine=filterpy twin / {name}", ratio[name], 10, False)
    together = np.sum(list(theirs.values()), 0) / np.sum(list(mine.values()), 0)
    yield Line("all twins together / all seven filters together", together, 10, False)
    if there:
        command = ("run", "mrclam", "--estimators", ",".join(FILTERS), "--data", str(DATA), "--jobs", "1")
        spent = [command_seconds(*command) for _ in range(min(rounds, 2))]
        yield Line("`cooploc run mrclam` of the seven [s of processor time]", spent, 60, True)


PLAIN = {"iterations": 1, "second_order": False, "update": "sequential", "anchor_reading": "doa-constant"}
JOINT = ((10, 100, 100, 2, 80), (50, 10, 10, 1, 200))  # robots, ticks, trials, the loop's, aim


def joint(rounds: int) -> Iterator[Line]:
    """Measure the joint EKF beside a filterpy loop.

    The estimates of the plain mode equal the loop's; the default uses a tick's readings together, three times: other
    work.
    """
    for robots, ticks, trials, few, aim in JOINT:
        _, stream = cl.simulate(f"scalability/n={robots}", trials=trials, seed=1, ticks=ticks)
        ours = {"plain": cl.make("ekf-joint", gate=np.inf, **PLAIN), "default": cl.make("ekf-joint")}
        cl.run({"filterpy": Filterpy(), **ours}, stream.select(slice(0, 1)).first_ticks(1), isolate=False)  # import
        ratios: dict[str, list[float]] = {name: [] for name in ours}
        for _ in range(rounds):
            theirs, loop = per_tick("filterpy", Filterpy(), stream.select(slice(0, few)))
            for name, estimator in ours.items():
                mine, x = per_tick(name, estimator, stream)
                ratios[name].append(theirs / mine)
                if name == "plain":
                    demand_equal(f"the plain mode and the loop at {robots} robots", x[:few], loop)
        for name, ratio in ratios.items():
            what = f"filterpy / ekf-joint, {name}, {robots} robots, {trials}x{ticks} (its {few}x{ticks})"
            yield Line(what, ratio, aim, False)


def per_tick(name: str, estimator: Any, stream: Any) -> tuple[float, Any]:
    """Return processor seconds per trial and tick, and positions."""
    found = cl.run({name: estimator}, stream, isolate=False).traces[name]
    return found.seconds / (found.x.shape[0] * found.x.shape[1]), found.x


def demand_equal(what: str, x: Any, y: Any) -> None:
    """Raise where two estimates are not equal to rounding."""
    if (off := float(np.abs(x - y).max())) > EQUAL:
        raise RuntimeError(f"{what} differ by {off:.1e} m")


# ---------------------------------------------------------------------------------------------- growth

GROWING = "mrsl-distance[anchor_reading=rssi,particles={particles}]"
BASE = {"robots": 10, "ticks": 20, "trials": 4, "particles": 200}
SIZES = {
    "robots": (1, 3, 10, 30, 100, 300, 1000),
    "ticks": (20, 60, 200, 600, 2000),
    "trials": (3, 10, 30, 100),
    "particles": (100, 300, 1000, 3000, 10_000, 30_000),
}
SPACING, HEARS = 6.0, 10.0  # [m] between robots, about; and how far they hear
STRAIGHT = 1.1  # a slope that counts as linear


def growing(rounds: int) -> Iterator[Line]:
    """Measure slopes of cost on logarithmic axes, over the larger half of the sizes; 1 is linear.

    Robots spread over an area that grows with the team, so that each hears about eight others however many there are.
    """
    _, stream = cl.simulate("trajectory", trials=1, seed=1, ticks=2)
    warm_up("growth", cl.make(GROWING.format(particles=200)), stream)
    for what, values in SIZES.items():
        sizes = [{**BASE, **({"trials": 1} if what == "robots" else {}), what: value} for value in values]
        times = np.array([[once(size)[:2] for _ in range(rounds)] for size in sizes])
        memory = np.array([[once(size, measured=True)[2]] for size in sizes])  # one round, as it takes time
        half = len(values) // 2
        for counted, costs in (("simulate", times[..., 0]), ("estimate", times[..., 1]), ("memory", memory)):
            found = [linregress(np.log(values[half:]), np.log(one[half:])).slope for one in costs.T]
            yield Line(f"slope of {counted} against {what}", found, STRAIGHT, True)
    yield from by_neighbours(rounds)


def once(size: dict[str, int], measured: bool = False) -> tuple[float, float, float]:
    """Return seconds to make a stream and to run on it, and what numpy had allocated at most [MB]."""
    estimator = cl.make(GROWING.format(**size))
    world = {"robots": size["robots"], "ticks": size["ticks"], "side": SPACING * size["robots"] ** 0.5}
    if measured:
        tracemalloc.start()
    start = process_time()
    _, stream = cl.simulate("trajectory", trials=size["trials"], seed=1, radio_range=HEARS, **world)
    made = process_time() - start
    estimate = trace("growth", estimator, stream).seconds
    memory = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return made, estimate, memory


NEIGHBOURS = (19, 39, 69, 99)
HEARING = ("arl", "mrsl-rssi", "mrsl-distance", "ctrn[weights=exact]")
ROWS, SHORT = 400, 5  # robots times trials, about; ticks


def by_neighbours(rounds: int) -> Iterator[Line]:
    """Measure how seconds, and links evaluated, of a robot and tick grow where every robot hears every other."""
    for name in HEARING:
        table = np.array([per_robot(name, k, rounds) for k in NEIGHBOURS])
        for counted, values in zip(("seconds", "links"), table.T, strict=True):
            if values.all():
                fit = linregress(np.log(NEIGHBOURS), np.log(values))
                half = t.ppf(0.975, len(NEIGHBOURS) - 2) * fit.stderr
                what = f"slope of {counted}, {name}, {NEIGHBOURS[0]} to {NEIGHBOURS[-1]} neighbours (at most)"
                yield Line(what, fit.slope + half * np.array([-1, 0, 1]), STRAIGHT, True)


def per_robot(name: str, neighbours: int, rounds: int) -> tuple[float, float]:
    """Return median seconds, and links that are evaluated, per robot and tick."""
    n = neighbours + 1
    _, stream = cl.simulate(f"scalability/n={n}", trials=max(1, ROWS // n), seed=1, ticks=SHORT)
    mine, rows = {name: cl.make(name)}, stream.senses.dt.size
    cl.run(mine, stream.first_ticks(1))
    taken = [seconds(partial(cl.run, mine, stream, jobs=1)) for _ in range(rounds)]
    messages = cl.run(mine, stream).traces[name].messages
    return float(np.median(taken)) / rows, stream.air.link.sum() / rows if messages.any() else 0.0


# ---------------------------------------------------------------------------------------------- commands


def waiting(rounds: int) -> Iterator[Line]:
    """Measure what a user waits for before anything is computed, and what is compiled once."""
    yield Line("`cooploc --help` [s]", [command_seconds("--help") for _ in range(rounds)], 0.5, True)
    quick = np.array([command_seconds("run", "quick", "--jobs", "2") for _ in range(rounds)])
    yield Line("`cooploc run quick`, kernels compiled [s on two processors]", quick / 2, 10, True)
    with tempfile.TemporaryDirectory() as empty:
        cold, warm = (command_seconds("run", "quick", "--jobs", "2", cache=empty) for _ in range(2))
    yield Line("compiling what `quick` needs [s on two processors]", [(cold - warm) / 2], 8, True)


def command_seconds(*arguments: str, cache: str = "") -> float:
    """Return the processor seconds of `cooploc` with these arguments, of all its processes.

    A run's directory is thrown away; kernels are kept in `cache`.
    """
    with tempfile.TemporaryDirectory() as folder:
        place = ["--out", f"{folder}/run"] if arguments[0] == "run" else []
        command = [sys.executable, "-m", "cooploc", *arguments, *place]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        environment = {**os.environ, **({"NUMBA_CACHE_DIR": cache} if cache else {})}
        subprocess.run(command, check=True, capture_output=True, env=environment)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main(report: str = "", rounds: int = 3) -> None:
    """Print each line as soon as it is measured, and write the report."""
    made = provenance()
    names = ("python", "numpy", "numba", "scipy", "filterpy")
    versions = ", ".join(f"{name} {made['versions'][name]}" for name in names)
    busy = f"{os.getloadavg()[0]:.0f} processes wanted its {os.cpu_count()} processors when this began"
    text = HEAD.format(machine=f"{made['cpu']}; {versions}; {rounds} rounds; {busy}.")
    print(text, end="")
    for part in (particles, roofline, weighing, recorded, joint, growing, waiting):
        for line in part(rounds):
            text += line.row()
            print(line.row(), end="", flush=True)
    if report:
        page = Path(report)
        _, mark, rest = (page.read_text(encoding="utf-8") if page.exists() else "").partition(NOTES)
        page.write_text(f"{text}\n{NOTES}{rest if mark else NO_NOTES}", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:2], *map(int, sys.argv[2:]))
