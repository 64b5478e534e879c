"""How much faster the cooperative particle filter is than a filterpy user's loop and than Stone Soup, doing the same.

Run: python benchmarks/particle_filter.py [rounds]. The work is `mrsl-rssi[anchor_reading=rssi,particles=500]`: predict,
four anchors, every neighbour with its variance, systematic resampling below half the effective sample size, Liu and
West's jitter. Ours goes through `cl.run(..., jobs=1)`, the others get the same stream's arrays as they are. All take
turns in one process and one thread. A ratio is of processor seconds per (trial, robot, tick) in the same round, given
as the median and the range over the rounds: the loops take fewer trials and ticks of the same stream, which is said in
the table. The errors printed beside are those of the trials and ticks that ours and the loop have in common.

A leaner loop is in `lean_filter.py`, with which `precision.py` compares. The shipped `mrsl-rssi` is compared with that
step at 3 robots, and two processes with one (by the clock).

Stone Soup is no dependency; `pip install stonesoup==1.9.1` beside cooploc adds its column.
"""

import importlib.util
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from time import perf_counter, process_time
from typing import Any

import numpy as np
from filterpy.monte_carlo import systematic_resample

import cooploc as cl

N = 500  # particles
H = 0.3 * N ** (-1 / 6)
NEAR = 0.1
OURS = "mrsl-rssi[anchor_reading=rssi,particles=500]"
SHIPPED = "mrsl-rssi[particles=500]"


@dataclass(frozen=True)
class Case:
    """A team, what we run of it, how much of that the loops take, and the ratios to reach."""

    robots: int
    trials: int
    ticks: int
    filterpy: tuple[int, int]  # trials, ticks
    stonesoup: tuple[int, int]
    times_filterpy: float = 30
    times_stonesoup: float = 100


CASES = (
    Case(3, 100, 100, (2, 50), (1, 20)),
    Case(10, 100, 20, (1, 20), (1, 5)),
    Case(100, 4, 10, (1, 1), (1, 1), times_stonesoup=40),
)


def world(case: Case) -> Any:
    """A world in which all hear all."""
    return cl.simulate(f"scalability/n={case.robots}", trials=case.trials, seed=1, ticks=case.ticks)


def filterpy_loop(stream: Any, trials: int, ticks: int) -> Any:
    """Positions (trials, ticks, n, 2) as a user of filterpy gets them: numpy over particles, loops over the rest."""
    rng, told, n = np.random.default_rng(0), stream.world, stream.robots
    odometry, anchor_rssi, rssi = stream.senses.odometry, stream.senses.anchor_rssi, stream.air.rssi
    anchor, radio, sigma = told.sensors["anchor_rssi"], told.sensors["radio_rssi"], told.motion.sigma
    out = np.empty((trials, ticks, n, 2))
    for t in range(trials):
        spread = np.linalg.cholesky(stream.prior.P[t])
        x = [stream.prior.x[t, i] + rng.standard_normal((N, 2)) @ spread[i].T for i in range(n)]
        w = [np.full(N, 1 / N) for _ in range(n)]
        for k in range(ticks):
            said = []
            for i in range(n):
                x[i] = x[i] + odometry[t, k, i] + sigma * rng.standard_normal((N, 2))
                log_likelihood = np.zeros(N)
                for a, q in enumerate(told.anchors):
                    d = np.maximum(np.linalg.norm(x[i] - q, axis=1), NEAR)
                    y = anchor_rssi[t, k, i, a] - (anchor.A - 10 * anchor.eta * np.log10(d))
                    log_likelihood -= y**2 / (2 * anchor.sigma**2)
                w[i] = reweighed(w[i], log_likelihood)
                said.append(mean_and_covariance(x[i], w[i]))
            for i in range(n):
                log_likelihood = np.zeros(N)
                for j in range(n):
                    if j == i or not stream.air.link[t, k, i, j]:
                        continue
                    mean, P = said[j]
                    delta = x[i] - mean
                    d = np.maximum(np.linalg.norm(delta, axis=1), NEAR)
                    J = np.where(d > NEAR, -10 * radio.eta / np.log(10) / d**2, 0.0)[:, None] * delta
                    v = radio.sigma**2 + ((J @ P) * J).sum(1)
                    y = rssi[t, k, i, j] - (radio.A - 10 * radio.eta * np.log10(d))
                    log_likelihood -= y**2 / (2 * v) + np.log(v) / 2
                w[i] = reweighed(w[i], log_likelihood)
                mean, P = mean_and_covariance(x[i], w[i])
                out[t, k, i] = mean
                if 1 / (w[i] ** 2).sum() < N / 2:
                    chosen = x[i][systematic_resample(w[i])]
                    jitter = rng.standard_normal((N, 2)) @ np.linalg.cholesky(P).T
                    x[i] = mean + np.sqrt(1 - H**2) * (chosen - mean) + H * jitter
                    w[i] = np.full(N, 1 / N)
    return out


def reweighed(w: Any, log_likelihood: Any) -> Any:
    w = w * np.exp(log_likelihood - log_likelihood.max())
    return w / w.sum()


def mean_and_covariance(x: Any, w: Any) -> tuple[Any, Any]:
    mean = w @ x
    return mean, (x - mean).T @ ((x - mean) * w[:, None])


def stonesoup_loop(stream: Any, trials: int, ticks: int) -> Any:
    """Positions (trials, ticks, n, 2) by Stone Soup's particle predictor, updater and resampler."""
    from stonesoup.models.control.linear import LinearControlModel
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, RandomWalk
    from stonesoup.predictor.particle import ParticlePredictor
    from stonesoup.resampler.particle import ESSResampler, SystematicResampler
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import ParticleState, State
    from stonesoup.updater.particle import ParticleUpdater

    Rssi, rng, told, n = stonesoup_rssi(), np.random.default_rng(0), stream.world, stream.robots
    anchor, radio, start = told.sensors["anchor_rssi"], told.sensors["radio_rssi"], datetime(2000, 1, 1)
    walk = CombinedLinearGaussianTransitionModel([RandomWalk(told.motion.sigma**2)] * 2)
    predictor = ParticlePredictor(walk, control_model=LinearControlModel(np.eye(2), control_noise=np.zeros((2, 2))))
    updater, resampler = ParticleUpdater(None), ESSResampler(resampler=SystematicResampler())

    def weigh(state: Any, sensor: Any, readings: Any, places: Any, spread: Any) -> Any:
        noise = sensor.R * np.eye(len(readings))
        model = Rssi(ndim_state=2, mapping=(0, 1), noise_covar=noise, sensor=sensor, places=places, spread=spread)
        return updater.update(SingleHypothesis(state, Detection(readings, measurement_model=model)))

    out = np.empty((trials, ticks, n, 2))
    for t in range(trials):
        L = np.linalg.cholesky(stream.prior.P[t])
        drawn = [stream.prior.x[t, i][:, None] + L[i] @ rng.standard_normal((2, N)) for i in range(n)]
        state = [ParticleState(StateVectors(x), weight=np.full(N, 1 / N), timestamp=start) for x in drawn]
        for k in range(ticks):
            for i in range(n):
                moved = State(stream.senses.odometry[t, k, i])
                state[i] = predictor.predict(state[i], start + timedelta(seconds=k + 1), control_input=moved)
                state[i] = weigh(
                    state[i], anchor, stream.senses.anchor_rssi[t, k, i], told.anchors, np.zeros((4, 2, 2))
                )
            places = np.array([np.ravel(s.mean) for s in state])
            spread = np.array([np.asarray(s.covar) for s in state])
            for i in range(n):
                j = np.flatnonzero(stream.air.link[t, k, i])
                state[i] = weigh(state[i], radio, stream.air.rssi[t, k, i, j], places[j], spread[j])
                mean, covar = np.asarray(state[i].mean), np.asarray(state[i].covar)
                out[t, k, i] = mean[:, 0]
                chosen = resampler.resample(state[i])
                if chosen is not state[i]:
                    jitter = np.linalg.cholesky(covar) @ rng.standard_normal((2, N))
                    x = mean + np.sqrt(1 - H**2) * (np.asarray(chosen.state_vector) - mean) + H * jitter
                    chosen.state_vector = StateVectors(x)
                state[i] = chosen
    return out


def stonesoup_rssi() -> Any:
    """The readings of nodes whose places are known up to a covariance, as one Stone Soup measurement model."""
    from stonesoup.base import Property
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement

    class Rssi(NonLinearGaussianMeasurement):  # type: ignore[misc]
        sensor: Any = Property()
        places: Any = Property()
        spread: Any = Property()

        @property
        def ndim_meas(self) -> int:
            return len(self.places)

        def offset(self, state: Any) -> tuple[Any, Any]:
            delta = np.asarray(state.state_vector) - self.places[:, :, None]
            return delta, np.maximum(np.linalg.norm(delta, axis=1), NEAR)

        def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
            return self.sensor.A - 10 * self.sensor.eta * np.log10(self.offset(state)[1])

        def logpdf(self, state1: Any, state2: Any, **kwargs: Any) -> Any:
            delta, d = self.offset(state2)
            J = np.where(d > NEAR, -10 * self.sensor.eta / np.log(10) / d**2, 0.0)[:, None] * delta
            v = self.sensor.sigma**2 + (J * (self.spread @ J)).sum(1)
            y = np.asarray(state1.state_vector, float) - self.function(state2)
            return -(y**2 / (2 * v) + np.log(v) / 2).sum(0)

    return Rssi


LOOPS = {"filterpy": filterpy_loop, "stonesoup": stonesoup_loop}


def seconds(function: Callable[[], Any], clock: Callable[[], float] = process_time) -> tuple[float, Any]:
    start = clock()
    found = function()
    return clock() - start, found


def row(what: str, ratios: list[float], target: float) -> dict[str, Any]:
    return {"what": what, "ratio": np.median(ratios), "low": min(ratios), "high": max(ratios), "target": target}


def against_loops(case: Case, rounds: int) -> list[dict[str, Any]]:
    truth, stream = world(case)
    ours = {"ours": cl.make(OURS)}
    cl.run(ours, stream)  # compile, import
    found: dict[str, list[float]] = {name: [] for name in LOOPS}
    rmse = {}
    for _ in range(rounds):
        mine, run = seconds(lambda: cl.run(ours, stream, jobs=1))
        mine /= case.trials * case.ticks * case.robots
        for name, loop in LOOPS.items():
            if importlib.util.find_spec(name) is None:
                continue
            t, k = getattr(case, name)
            theirs, x = seconds(lambda loop=loop, t=t, k=k: loop(stream, t, k))  # type: ignore[misc]
            found[name].append(theirs / (t * k * case.robots) / mine)
            both = (run.traces["ours"].x, x)
            rmse[name] = [np.sqrt(((each[:t, :k] - truth.x[:t, :k]) ** 2).sum(-1).mean()) for each in both]
    rows = []
    for name, ratios in found.items():
        if ratios:
            t, k = getattr(case, name)
            size = f"{case.robots} robots, {case.trials}x{case.ticks} (its {t}x{k})"
            target = case.times_filterpy if name == "filterpy" else case.times_stonesoup
            rows.append(row(f"{name} / ours, {size}", ratios, target) | {"rmse": rmse[name]})
    return rows


def against_window(rounds: int) -> list[dict[str, Any]]:
    """The shipped `mrsl-rssi`, with directions of arrival, over the step on raw readings: to stay below 3."""
    _, stream = world(CASES[0])
    raw, shipped = {"raw": cl.make(OURS)}, {"shipped": cl.make(SHIPPED)}
    cl.run({**raw, **shipped}, stream)
    ratios = []
    for _ in range(rounds):
        mine, _ = seconds(lambda: cl.run(raw, stream, jobs=1))
        theirs, _ = seconds(lambda: cl.run(shipped, stream, jobs=1))
        ratios.append(theirs / mine)
    return [row("directions of arrival / raw readings, 3 robots (at most)", ratios, 3.0)]


def against_processes(rounds: int) -> list[dict[str, Any]]:
    """One process over two, by the clock, the pool warm."""
    _, stream = cl.simulate("scalability/n=10", trials=100, seed=1, ticks=60)
    ours = {"ours": cl.make(SHIPPED)}
    cl.run(ours, stream, jobs=2)
    ratios = []
    for _ in range(rounds):
        one, _ = seconds(lambda: cl.run(ours, stream, jobs=1), perf_counter)
        two, _ = seconds(lambda: cl.run(ours, stream, jobs=2), perf_counter)
        ratios.append(one / two)
    return [row("one process / two, 10 robots", ratios, 1.5)]


def rows(rounds: int = 5) -> list[dict[str, Any]]:
    """Every row: what, ratio (median), low, high, target."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Stone Soup's own
        raced = [found for case in CASES for found in against_loops(case, rounds)]
    return [*raced, *against_window(rounds), *against_processes(rounds)]


def main(rounds: int = 5) -> None:
    if importlib.util.find_spec("stonesoup") is None:
        print("Stone Soup is not installed: its rows are left out (pip install stonesoup==1.9.1)")
    print(f"{'trials x ticks':<58}{'ratio':>8}{'range':>16}{'target':>8}   RMSE [m] of ours and theirs")
    for found in rows(rounds):
        spread = f"{found['low']:.1f} to {found['high']:.1f}"
        errors = "  ".join(f"{error:.3f}" for error in found.get("rmse", []))
        print(f"{found['what']:<58}{found['ratio']:>8.1f}{spread:>16}{found['target']:>8g}   {errors}", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
