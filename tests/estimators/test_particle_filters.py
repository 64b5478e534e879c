"""ARL and MRSL against the same recursion on a grid, and against each other where they must agree to the bit."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from oracles import Grid, arrival, arrival_error, corners, gradient, log_distance, measure_anchor_ranges
from scipy.stats import norm

from cooploc.estimators import make
from cooploc.estimators.interface import Belief, Senses, World
from cooploc.estimators.models import Displacement, LogDistance, Range, Unicycle
from cooploc.scenarios import simulate
from cooploc.scenarios.runner.run import run
from cooploc.scenarios.runner.trace import trace
from cooploc.scenarios.stream import Air, Stream

SIDE, PRIOR, ODOMETRY, RANGE, TICKS = 6.0, 1.0, 0.06, 0.1, 12
NOISE = 5**0.5  # [dB] shadowing and fast noise together
PARTICLES, TIMES = 20_000, 4

# ---------------------------------------------------------------- the oracle


def anchor_log_likelihood(grid, reading):
    """The four anchors' raw readings, as far as they are there."""
    return sum(
        -((z - log_distance(np.hypot(grid.x - a, grid.y - b))) ** 2) / (2 * NOISE**2)
        for z, (a, b) in zip(reading, corners(SIDE), strict=True)
        if np.isfinite(z)
    )


def gradient_log_likelihood(grid, reading):
    """The gradient of the four readings, each of its two numbers with an independent error of NOISE / SIDE."""
    if np.isnan(reading).any():
        return np.zeros_like(grid.x)
    expected = (log_distance(np.hypot(grid.x - a, grid.y - b)) for a, b in corners(SIDE))
    (gx, gy), (mx, my) = gradient(*reading, SIDE, SIDE), gradient(*expected, SIDE, SIDE)
    return -((gx - mx) ** 2 + (gy - my) ** 2) / (2 * (NOISE / SIDE) ** 2)


def range_log_likelihood(grid, reading):
    """Ranges to the four anchors, as far as they are there."""
    pairs = zip(reading, corners(SIDE), strict=True)
    return sum(norm.logpdf(z, np.hypot(grid.x - a, grid.y - b), RANGE) for z, (a, b) in pairs if np.isfinite(z))


def nothing(grid, reading):
    return np.zeros_like(grid.x)


@cache
def doa_sigma():
    return np.sqrt((arrival_error(SIDE, NOISE)[0] ** 2).mean())


class Window:
    """The last M directions of arrival: a function of the present position, past samples shifted back by odometry.

    It is of samples, not of ticks: a tick without a direction adds nothing and forgets nothing.
    """

    def __init__(self, M, K, density="constant", temper=True, decay=0.99):
        self.M, self.K, self.decay, self.power = M, K, decay, 1 / M if temper else 1.0
        self.log = log_constant if density == "constant" else log_exact
        self.raw, self.smooth, self.since = [], [], []  # newest first

    def __call__(self, grid, reading, odometry):
        self.since = [moved + odometry for moved in self.since]
        if np.isnan(reading).any():
            return np.zeros_like(grid.x)
        gx, gy = gradient(*reading, SIDE, SIDE)
        self.raw = [np.arctan2(gy, gx), *self.raw][: self.K]
        average = np.angle(sum(self.decay**age * np.exp(1j * a) for age, a in enumerate(self.raw)))
        self.smooth = [average, *self.smooth][: self.M]
        self.since = [np.zeros(2), *self.since][: self.M]
        places = zip(self.smooth, self.since, strict=True)
        return self.power * sum(self.log(grid.x - dx, grid.y - dy, angle) for angle, (dx, dy) in places)


def log_constant(x, y, angle):
    return -(np.angle(np.exp(1j * (arrival(x, y, SIDE) - angle))) ** 2) / (2 * doa_sigma() ** 2)


def log_exact(x, y, angle):
    """Log-density of the angle of a noisy gradient: the gradient's Gaussian integrated numerically along the ray."""
    gx, gy = gradient(*(log_distance(np.hypot(x - a, y - b)) for a, b in corners(SIDE)), SIDE, SIDE)
    sd = NOISE / SIDE  # of either component
    along = gx * np.cos(angle) + gy * np.sin(angle)
    low, high = np.maximum(along - 9 * sd, 0), np.maximum(along, 0) + 9 * sd
    total = 0.0
    for t, w in zip(*np.polynomial.legendre.leggauss(40), strict=True):
        r = low + (high - low) * (t + 1) / 2
        d2 = (r * np.cos(angle) - gx) ** 2 + (r * np.sin(angle) - gy) ** 2
        total = total + w * r * np.exp(-d2 / (2 * sd**2))
    return np.log(np.maximum(total * (high - low) / 2 / (2 * np.pi * sd**2), 1e-300))


def neighbour_log_likelihood(grid, kind, moved, reading, mean, P):
    """The radio reading with the sender integrated out: variance sigma^2 + J P J', J the slope at each cell."""
    dx, dy = grid.x - moved[0] - mean[0], grid.y - moved[1] - mean[1]
    d = np.hypot(dx, dy)
    if kind == "range":
        if reading < 0.2:
            return np.zeros_like(d)
        expected, sd = d, RANGE
        rate = np.minimum(d / 0.1, 1.0)  # clamped near the sender
    else:
        expected, sd = log_distance(d), NOISE
        rate = np.where(d > 0.1, 30 / np.log(10) / np.maximum(d, 0.1), 0.0)
    ux, uy = dx / np.maximum(d, 1e-12), dy / np.maximum(d, 1e-12)
    v = sd**2 + rate**2 * (ux**2 * P[0, 0] + 2 * ux * uy * P[0, 1] + uy**2 * P[1, 1])
    return -((reading - expected) ** 2) / (2 * v) - np.log(v) / 2


def grid_posterior(stream, window=None, reading=None, trust=False, anchors=anchor_log_likelihood, samples=1):
    """Mean (T, n, 2) and covariance (T, n, 2, 2) of the first trial's robots.

    Without a `window` of directions of arrival `anchors` weighs the readings; `trust` takes senders at their word; of
    each sender the last `samples` packets are used.
    """
    z, air, n = stream.senses, stream.air, stream.robots
    grids = [Grid(stream.prior.x[0, i], PRIOR) for i in range(n)]
    windows = [Window(**window) if window else None for _ in range(n)]
    memory = {(i, j): [] for i in range(n) for j in range(n)}  # packets with the moves since, newest first
    x, P = np.empty((TICKS, n, 2)), np.empty((TICKS, n, 2, 2))
    for k in range(TICKS):
        for i, grid in enumerate(grids):
            step, own = z.odometry[0, k, i], z.extra.get("anchor_range", z.anchor_rssi)[0, k, i]
            grid.move(*step, ODOMETRY)
            grid.weigh(windows[i](grid, own, step) if window else anchors(grid, own))
            for j in range(n):
                memory[i, j] = [(moved + step, *packet) for moved, *packet in memory[i, j]]
        sent = [grid.moments() for grid in grids]  # before anything heard is used
        for i, grid in enumerate(grids):
            for j in range(n) if reading else ():
                if air.link[0, k, i, j]:
                    mean, cov = sent[j]
                    packet = getattr(air, reading)[0, k, i, j], mean, 0 * cov if trust else cov
                    memory[i, j] = [(np.zeros(2), *packet), *memory[i, j]][:samples]
                    then = (neighbour_log_likelihood(grid, reading, *packet) for packet in memory[i, j])
                    grid.weigh(sum(then) / samples)
            x[k, i], P[k, i] = grid.moments()
    return x, P


@cache
def papers_world(ranges=False):
    """A short stream of the paper's world; a tenth of the readings of anchors, RSSI or `ranges`, are missing."""
    sigmas = {"prior_sigma": PRIOR, "odometry_sigma": ODOMETRY}
    truth, stream = simulate("robots-1-3", seed=7, robots=3, drop=0.3, ticks=TICKS, **sigmas)
    if ranges:
        return measure_anchor_ranges(truth, stream)
    anchor = stream.senses.anchor_rssi.copy()
    anchor[np.random.default_rng(7).uniform(size=anchor.shape) < 0.1] = np.nan
    return stream.replace_arrays({"senses.anchor_rssi": anchor})


RSSI, RANGES = "mrsl-rssi", "mrsl-distance"
GRADIENT = {"anchors": gradient_log_likelihood}
ANCHOR_RANGES = {"anchors": range_log_likelihood}
CASES = {
    "arl[anchor_reading=rssi]": {},
    "arl[M=1,K=1]": {"window": {"M": 1, "K": 1}},
    "arl[M=3,K=3]": {"window": {"M": 3, "K": 3}},
    "arl[M=3,K=2,temper=false]": {"window": {"M": 3, "K": 2, "temper": False}},
    "arl[M=1,K=4,decay=0.7]": {"window": {"M": 1, "K": 4, "decay": 0.7}},
    "arl[M=1,K=1,density=exact]": {"window": {"M": 1, "K": 1, "density": "exact"}},
    "arl[anchor_reading=gradient]": GRADIENT,
    "arl": ANCHOR_RANGES,  # where there is no RSSI
    f"{RANGES}[anchor_reading=any]": {"reading": "range", **ANCHOR_RANGES},
    f"{RSSI}[anchor_reading=none]": {"reading": "rssi", "anchors": nothing},
    f"{RSSI}[anchor_reading=rssi,neighbour_samples=M,M=3]": {"reading": "rssi", "samples": 3},
    f"{RANGES}[anchor_reading=gradient,neighbour_samples=M,M=2]": {"reading": "range", "samples": 2, **GRADIENT},
    f"{RSSI}[anchor_reading=rssi]": {"reading": "rssi"},
    f"{RANGES}[anchor_reading=rssi]": {"reading": "range"},
    f"{RANGES}[M=2,K=2]": {"window": {"M": 2, "K": 2}, "reading": "range"},
    f"{RSSI}[anchor_reading=rssi,neighbours=exact]": {"reading": "rssi", "trust": True},
}


@pytest.mark.slow
@pytest.mark.parametrize("configured", CASES)
def test_particle_filter_is_the_grid_posterior(configured):
    """The mean of some runs on the same readings: within the grid's error, and that of drawing particles."""
    stream = papers_world(CASES[configured].get("anchors") is range_log_likelihood)
    x, P = grid_posterior(stream, **CASES[configured])
    runs = [trace("pf", make(configured, particles=PARTICLES), replace(stream, seed=1000 + s)) for s in range(TIMES)]
    drawn, cov = np.stack([r.x[0] for r in runs]), np.stack([r.P[0] for r in runs]).mean(0)
    np.testing.assert_allclose(drawn.mean(0), x, atol=0.02 + 3 * drawn.std(0, ddof=1).max() / np.sqrt(TIMES))
    assert (np.linalg.norm(cov - P, axis=(-2, -1)) / np.linalg.norm(P, axis=(-2, -1))).max() < 0.1


# ---------------------------------------------------------------- identities


ANCHORS = [f"anchor_reading={kind}" for kind in ("doa", "gradient", "rssi", "none")]
TEAMWORK = [
    *(f"{name}[{kind}]" for name in ("mrsl-rssi", "mrsl-distance") for kind in ANCHORS),
    *(f"ctrn[weights=exact,fusion={fusion}]" for fusion in ("moments", "message", "received")),
    *("cmrl", "reciprocal-pf", "channel-pf"),
]


@pytest.mark.parametrize("configured", TEAMWORK)
@pytest.mark.parametrize("team", [{"robots": 1}, {"robots": 4, "drop": 1.0}], ids=["one robot", "all links down"])
def test_a_robot_that_hears_no_other_is_arl_to_the_bit(team, configured):
    _, stream = simulate("trajectory", trials=3, ticks=40, seed=2, **team)
    alone = make(configured).anchor_reading
    traces = run({"arl": make("arl", anchor_reading=alone), "team": make(configured)}, stream).traces
    np.testing.assert_array_equal(traces["team"].x, traces["arl"].x)
    np.testing.assert_array_equal(traces["team"].P, traces["arl"].P)


@pytest.mark.slow
@pytest.mark.parametrize("configured", ["mrsl-distance", "ctrn[weights=exact]", "ctrn[fusion=message]"])
def test_the_distance_of_a_sighting_is_a_range_to_the_bit(configured):
    _, seen = simulate("camera/n=5[landmarks=1]", trials=2, ticks=80, seed=3)
    sensors = {name: one for name, one in seen.world.sensors.items() if name != "sighting"}
    sensors["radio_range"] = Range(seen.world.sensors["sighting"].sigma_range)
    distances = np.where(seen.air.link, seen.senses.sighting[..., 0], np.nan)
    senses = seen.senses._replace(sighting=np.empty((*seen.senses.odometry.shape[:3], 0, 2)))
    ranged = replace(
        seen, world=replace(seen.world, sensors=sensors), senses=senses, air=seen.air._replace(range=distances)
    )
    one, other = (trace("it", make(configured), stream) for stream in (seen, ranged))
    np.testing.assert_array_equal(one.x, other.x)
    np.testing.assert_array_equal(one.P, other.P)
    assert not np.array_equal(one.x, trace("alone", make("arl"), seen).x)


def wheels_and_compass(ticks=25):
    """The same drive told twice: as displacements in a compass frame, and as arcs of a robot that knows its heading."""
    rng = np.random.default_rng(8)
    v, omega = rng.uniform(0.2, 0.4, ticks), rng.normal(0, 0.6, ticks)
    heading = np.concatenate([[2.5], 2.5 + np.cumsum(omega)])
    middle = (heading[:-1] + heading[1:]) / 2
    steps = v[:, None] * np.stack([np.cos(middle), np.sin(middle)], -1)
    path = np.array([4.0, 2.0]) + np.cumsum(steps, 0)
    d = np.stack([np.hypot(path[:, 0] - a, path[:, 1] - b) for a, b in corners(SIDE)], -1)
    rssi = (log_distance(d) + rng.normal(0, NOISE, d.shape))[None, :, None]
    nothing, times = np.empty((1, ticks, 1, 0)), np.arange(1.0, ticks + 1)
    air = Air(np.zeros((1, ticks, 1, 1), bool), nothing, nothing)
    arena, anchors = np.array([[0, 0], [SIDE, SIDE]]), np.array(corners(SIDE))
    start = [4.3, 1.8, 2.5], [0.25, 0.25, 0.0]
    drives = (Displacement(0.0), steps), (Unicycle(0.0, 0.0, 1.0), np.stack([v, omega], -1))
    for d, (motion, u) in enumerate(drives, 2):
        world = World(1, 1.0, arena, motion, {"anchor_rssi": LogDistance()}, anchors)
        u, dt = u[None, :, None], np.ones((1, ticks, 1))
        senses = Senses(u, dt, rssi.copy(), *np.empty((2, 1, ticks, 1, 0, 2)), {})
        prior = Belief(np.array(start[0][:d])[None, None], np.diag(start[1][:d])[None, None])
        yield Stream("told twice", 0, np.array([0]), times, world, prior, senses, air)


def folded_weights(particles, rssi, earlier):
    """The loop over particles of the public code, with its names, in the paper's arena; in logarithms."""

    def folded(rss):
        gy = (rss[1] - rss[0]) / 2 + (rss[2] - rss[3]) / 2
        gx = (rss[2] - rss[1]) / 2 + (rss[3] - rss[0]) / 2
        return math.atan(gy / gx)

    weights, errors = [], []
    for x, y in particles:
        actual_rss = [log_distance(math.hypot(x - a, y - b)) for a, b in corners(SIDE)]
        errors.append(abs(folded(actual_rss) - folded(rssi)))
        std_error = np.std(np.subtract(actual_rss, rssi))
        weights.append(sum(norm.logpdf(error, scale=std_error) for error in (errors[-1], *earlier)))
    return np.array(weights), errors[int(np.argmax(weights))]


@pytest.mark.slow
def test_the_reading_of_the_public_code_weighs_as_its_loop_does():
    """Five ticks, with the last three best errors; the particles of a tick are around the heaviest before."""
    _, stream = simulate("robots-1-3/n=1", trials=3, ticks=5, seed=4)
    seen = []

    def watch(method, tick, arguments, call):
        result = call(*arguments)
        if method in ("predict", "correct"):
            seen.append((method, result))
        return result

    trace("code", make("arl[point=max,proposal=best,box=0.1,residual=code]"), stream, watch)
    drawn, weighed = ([s for kind, s in seen if kind == method] for method in ("predict", "correct"))
    for r in range(3):
        earlier = []
        for t in range(5):
            rssi = stream.senses.anchor_rssi[r, t, 0]
            logw, best = folded_weights(drawn[t].x[r], rssi, earlier)
            found = weighed[t].logw[r]
            np.testing.assert_allclose(found - found.max(), logw - logw.max(), rtol=1e-7, atol=1e-7)
            earlier = [best, *earlier][:3]
            if t < 4:
                here = weighed[t].x[r, found.argmax()] + stream.senses.odometry[r, t + 1, 0]
                assert (np.abs(drawn[t + 1].x[r] - here) <= 0.1 + 1e-12).all()


KINDS = "", "anchor_reading=rssi", "anchor_reading=gradient", "density=exact,M=3", "proposal=box"


@pytest.mark.parametrize("changed", [*KINDS, "residual=sum", "residual=corners"])
def test_known_heading_is_as_good_as_a_compass(changed):
    """The window's past positions turn with the robot."""
    (compass, wheels) = (trace("arl", make(f"arl[{changed}]"), stream) for stream in wheels_and_compass())
    np.testing.assert_allclose(wheels.x[..., :2], compass.x, atol=1e-7)
    np.testing.assert_allclose(wheels.P[..., :2, :2], compass.P, atol=1e-7)


def test_point_max_reports_the_particle_of_largest_weight():
    """Even in a tick in which the particles are renewed, which makes all weights equal."""
    _, stream = simulate("robots-1-3/n=1", trials=30, ticks=20, seed=4, prior_sigma=1.0)
    heaviest = []

    def watch(method, tick, arguments, call):
        result = call(*arguments)
        if method == "correct":
            best = result.logw.argmax(-1)
            heaviest.append(result.x[np.arange(len(best)), best])
        return result

    got = trace("max", make("rssi-pf", point="max", particles=500), stream, watch)
    np.testing.assert_allclose(got.x[:, :, 0], np.stack(heaviest, 1), atol=1e-12)
