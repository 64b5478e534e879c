"""Particle filters: the prior, motion, weights, moments and resampling that all of them share.

A row is resampled systematically where its effective sample size falls below half; then Liu and West's kernel keeps
mean and covariance. For positions (d = 2) a tick is two compiled passes over each row, `advance` and
`posterior_summary`; with a heading, and for other motions, it is numpy, with which tests compare the loops.

Source: J. Liu, M. West, "Combined parameter and state estimation in simulation-based filtering", 2001.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partialmethod
from typing import Any, Literal, NamedTuple, TypeVar, cast

import numpy as np

from cooploc.estimators import models, particle_likelihood, random_numbers
from cooploc.estimators.compiled import readable
from cooploc.estimators.errors import BadInput, require
from cooploc.estimators.interface import Array, Belief, Keys, Mail, Mask, Motion, Rows, Senses, Sensor, World
from cooploc.estimators.models import Displacement, circular_mean, gradient_doa, wrap, wrap_heading
from cooploc.estimators.particle_kernels import BANDWIDTH, advance_rows, summarize_rows, systematic
from cooploc.estimators.particle_likelihood import Fixed, ReceivedPackets, planes, teammates
from cooploc.estimators.robust import loss_of


def sample_prior(prior: Belief, key: Keys, n: int) -> Array:
    """Draw particles (r, n, d) from the prior."""
    noise = _noise(key, 0, random_numbers.INIT, n, prior.x.shape[-1])
    return wrap_heading(prior.x[:, None, :] + scatter(prior.P, noise))


def advance(
    s: "FilterState", z: Senses, tick: int, fixed: Sequence[Fixed] = (), sends: bool = False
) -> tuple[Array, Array, Belief | None]:
    """Begin a tick: resample the rows that are due, move, and weigh by the readings of fixed places.

    Returns particles (r, n, d) drawn from P(x' | x, u), their log-weights, and if they are to be sent their moments.
    """
    motion, x, logw, key = s.world.motion, s.x, s.logw, s.key
    anchors = particle_likelihood.anchor_readings(fixed, len(x))
    if type(motion) is not Displacement or x.shape[-1] != 2 or anchors is None:
        x, logw = resample(x, logw, key, tick - 1)
        noise = random_numbers.normals(key, tick, random_numbers.MOVE, x.shape[1])
        x = motion.sample(x, z.odometry[:, None, :], z.dt[:, None], noise)
        logw = particle_likelihood.anchors(fixed, x, logw)
        return x, logw, summary(x, logw) if sends else None
    cloud, sd = (planes(x), readable(logw), readable(s.due)), np.sqrt(motion.sigma**2 / motion.tick * z.dt)
    step = readable(z.odometry), readable(sd), readable(key), tick * random_numbers.PURPOSES
    after, logw_new = np.empty((2 * len(x), x.shape[1]), x.dtype), np.empty_like(logw, order="C")
    belief = Belief(np.empty((len(x), 2)), np.empty((len(x), 2, 2)))
    advance_rows(cloud, step, anchors, sends, (after, logw_new), tuple(belief))
    return after.reshape(-1, 2, x.shape[1]).transpose(0, 2, 1), logw_new, belief if sends else None


def summary(x: Array, logw: Array) -> Belief:
    """Return the weighted mean and covariance of particles x (r, n, d) with log-weights (r, n)."""
    return posterior_summary(x, logw)[0]


def posterior_summary(x: Array, logw: Array, heard: ReceivedPackets | None = None) -> tuple[Belief, Array, Mask]:
    """Weigh particles by the packets heard; return moments, log-weights, and the rows (r,) due for resampling."""
    if x.shape[-1] != 2 or (heard and not heard.has_loop):
        logw = particle_likelihood.teammates(heard, x, logw) if heard else logw
        w = weights(logw)
        return moments(x, w), restart_weights(logw), poor(w)
    belief = Belief(np.empty((len(x), 2)), np.empty((len(x), 2, 2)))
    logw_new, due = np.empty_like(logw, order="C"), np.empty(len(x), np.bool_)
    heard = heard or ReceivedPackets(models.Range(), np.empty((len(x), 0, 5)), np.empty((len(x), 0)), False)
    summarize_rows(planes(x), readable(logw), heard.for_loop(), tuple(belief), logw_new, due)
    return belief, logw_new, due


def weights(logw: Array) -> Array:
    """Return normalised weights (r, n). A row in which all are -inf starts again from equal weights; nan stays nan."""
    top = logw.max(-1, keepdims=True)
    w = np.exp(np.where(top == -np.inf, 0.0, logw - np.maximum(top, np.finfo(float).min)))
    return np.asarray(w / w.sum(-1, keepdims=True))


def moments(x: Array, w: Array) -> Belief:
    """Return the weighted mean and covariance of particles x (r, n, d), w (r, n); the heading's mean is circular."""
    m: Array = (w[..., None] * x).sum(-2)
    if x.shape[-1] > 2:
        m[:, 2] = circular_mean(x[..., 2], w)
    e = offset(x, m)
    P = np.stack([(w[..., None] * e[..., :, i, None] * e).sum(-2) for i in range(x.shape[-1])], -2)
    return Belief(m, P)


def poor(w: Array) -> Mask:
    """Return the rows (r,) of weights (r, n) with an effective sample size below n/2."""
    return np.asarray(1 / (w**2).sum(-1) < w.shape[-1] / 2)


def restart_weights(logw: Array) -> Array:
    """Return log-weights (r, n) in which a row of -inf alone starts again from equal weights."""
    return np.where(logw.max(-1, keepdims=True) == -np.inf, 0.0, logw)


def resample(x: Array, logw: Array, key: Keys, tick: int) -> tuple[Array, Array]:
    """Resample particles and their log-weights; rows that are not poor stay as they are."""
    n, d = x.shape[1:]
    logw = restart_weights(logw)
    w = weights(logw)
    due = poor(w)
    if not due.any():
        return x, logw
    h = BANDWIDTH * n ** (-1 / 6)
    old, w, key = x[due], w[due], key[due]
    u = random_numbers.uniforms(key, tick, random_numbers.RESAMPLE, 1)[:, 0, 0]
    chosen = np.take_along_axis(old, systematic(w, u)[..., None], 1)
    belief = moments(old, w)
    noise = _noise(key, tick, random_numbers.JITTER, n, d)
    kernel = np.sqrt(1 - h**2) * offset(chosen, belief.x) + h * scatter(belief.P, noise)
    x, logw = x.copy(), logw.copy()
    x[due] = wrap_heading(belief.x[:, None, :] + kernel)
    logw[due] = 0.0
    return x, logw


def offset(x: Array, m: Array) -> Array:
    """Subtract the mean (r, d) from particles (r, n, d), headings wrapped."""
    e = x - m[:, None, :]
    if x.shape[-1] > 2:
        e[..., 2] = wrap(e[..., 2])
    return e


def _noise(key: Keys, tick: int, purpose: int, n: int, d: int) -> Array:
    """Draw standard normals (r, n, d); the purpose after `purpose` is the heading's."""
    pair = random_numbers.normals(key, tick, purpose, n)
    if d == 2:
        return pair
    return np.concatenate([pair, random_numbers.normals(key, tick, purpose + 1, n)[..., : d - 2]], -1)


def scatter(P: Array, noise: Array) -> Array:
    """Multiply noise (r, n, d) by a Cholesky factor of P (r, d, d), which may be singular."""
    d = P.shape[-1]
    L = np.zeros_like(P)
    for j in range(d):
        L[:, j, j] = np.sqrt(np.maximum(P[:, j, j] - (L[:, j, :j] ** 2).sum(-1), 0.0))
        for i in range(j + 1, d):
            rest = P[:, i, j] - (L[:, i, :j] * L[:, j, :j]).sum(-1)
            L[:, i, j] = np.divide(rest, L[:, j, j], out=np.zeros_like(rest), where=L[:, j, j] > 0)
    out = np.zeros_like(noise)
    for i in range(d):
        for j in range(i + 1):
            out[..., i] += L[:, i, j, None] * noise[..., j]
    return out


# The last M packets of each sender, for the product over past samples of Latif & Parasuraman's eqs. (5)-(8): "we can
# use the Gaussian probability formula same as (Eq. 5) with RSSI as an error", and eq. (5) is a product over M.


class PastPackets(NamedTuple):
    """The last M packets of each sender, the newest first. A tick without a packet leaves a sender's as they are."""

    packets: Array  # (r, n, M, 5)  x, y, P_xx, P_xy, P_yy of the sender then
    readings: Array  # (r, n, M)
    trail: Array  # (r, n, M, 2)  where the robot was then, seen from where it is now [m]

    def shift(self, motion: Motion, z: Senses) -> "PastPackets":
        """Shift the packets by the robot's next move."""
        r, n, samples, _ = self.trail.shape
        trail = motion.retrace(self.trail.reshape(r, n * samples, 2), z.odometry, z.dt)
        return self._replace(trail=trail.reshape(self.trail.shape))


def no_past_packets(rows: int, senders: int, samples: int) -> PastPackets:
    """Return that nothing was received yet."""
    shape = rows, senders, samples
    return PastPackets(np.full((*shape, 5), np.nan), np.full(shape, np.nan), np.zeros((*shape, 2)))


def keep_received(past: PastPackets, heard: ReceivedPackets) -> PastPackets:
    """Put the packets of this tick in front, where there are any, and forget the oldest."""
    new, kept = ~np.isnan(heard.readings), []
    for memory, newest in zip(past, (heard.packets, heard.readings, np.zeros_like(past.trail[:, :, 0])), strict=True):
        longer = np.concatenate([newest[:, :, None], memory[:, :, :-1]], 2)
        kept.append(np.where(new.reshape(*new.shape, *[1] * (memory.ndim - 2)), longer, memory))
    return PastPackets(*kept)


def weigh_past_packets(
    past: PastPackets, heard: ReceivedPackets, motion: Motion, x: Array, logw: Array, power: float
) -> Array:
    """Add to `logw` (r, N) `power` times the log-likelihoods of the last M readings of each sender heard now.

    Each is taken at the particle x (r, N, d) shifted back along the path; `past` has the packets of this tick, too.
    """
    r, n, samples = past.readings.shape
    readings = np.where(np.isnan(heard.readings)[..., None], np.nan, past.readings)
    total = np.zeros_like(logw)
    if type(motion) is Displacement and heard.has_loop:  # the particle moves back, or the sender forth: it is the same
        packets = past.packets.copy()
        packets[..., :2] -= past.trail
        flat = heard._replace(packets=packets.reshape(r, n * samples, 5), readings=readings.reshape(r, n * samples))
        return logw + power * teammates(flat, x, total)
    for j in range(n):
        for k in range(samples):
            there = motion.place(x, past.trail[:, j, None, k])
            one = heard._replace(packets=past.packets[:, j, None, k], readings=readings[:, j, None, k])
            total = teammates(one, there, total)
    return logw + power * total


# A robot's own particle filter: on odometry and anchors it is ARL, and all others build on it; `p` is the estimator.
# Particles are weighed by anchors, or by landmarks where the world has those instead; no reading is refused.
#
# Source: Latif & Parasuraman, "Individual localization", eqs. (1)-(5); R. Parashar, R. Parasuraman, "Particle filter
# based localization of access points using direction of arrival on mobile robots", VTC-Fall 2020.

PARAMETERS = """

    Parameters of the robot's own particle filter; the defaults are the readings of the `paper` preset:
        particles: their number, at least 2.
        anchor_reading: "doa", the direction of arrival made of the four anchor readings; "gradient", the gradient
            [dB/m] that the direction is taken from, of this tick alone; "rssi", their raw likelihoods; "any", the
            likelihoods of whatever fixed things there are: RSSI [dBm] and ranges [m] of anchors, sightings of
            landmarks; or "none": odometry and teammates alone. Without RSSI the first three are the first that there is
            of landmarks and ranges.
        density: of the direction: "constant" is a Gaussian error of the angle, "exact" the projected normal.
        residual: the error in the constant density: "wrapped", the particle's angle less the measured one in
            (-pi, pi]; "sum", eq. (4) to the letter: that difference not wrapped, once for each of the four nodes;
            "corners", the same with the particle's direction from each node, which says little inside the arena; or
            "code", that of `particle_likelihood.weigh_by_folded_angle`, which uses neither M, K, decay nor temper.
        M: path samples in the product of eq. (5), at least 1.
        K: directions in the moving average, at least 1.
        decay: weight of a direction per sample of age, in (0, 1].
        temper: exponent 1/M on that product; without it a recursive filter counts every direction M times.
        point: "mean" of the particles, or "max", the paper's: the particle of largest weight.
        proposal: "walk" by the motion model; "box", the paper's: uniform around the present estimate, every tick; or
            "best", the same around the particle of largest weight.
        box: half-width of that box [m], above 0.
        inflation: factor, 0.01 to 100, on the standard deviation that is assumed of every reading; 1: as told.
        loss: the log-likelihood of a reading far from what is expected: Huber's ("huber") or that of Student's t
            ("student") in place of the Gaussian's ("none"), or as the world's sensors state ("world"), in simulated
            worlds "none". The exact density of a direction has none.
        precision: of particles and their weights, "double" or "single": half the memory and about half the time, with
            errors of rounding of a millionth of the distance from the origin; in an arena of at most 10 km.
"""
DOA = "anchor_reading", "doa"  # what most parameters are about
FARTHEST = 1e4  # [m] from the origin: there single numbers are a millimetre apart

AnchorReading = Literal["doa", "gradient", "rssi", "any", "none"]
RadioReading = Literal["rssi", "range"]
C = TypeVar("C", bound=type)


LIMITS = {
    **{"particles": (2, 1_000_000), "M": (1, 10_000), "K": (1, 10_000), "box": (1e-9, 1e6), "decay": (1e-9, 1)},
    "inflation": (models.LEAST, models.MOST),
}


def explain(cls: C) -> C:
    """Add `PARAMETERS` to a filter's docstring, and let it refuse values outside `LIMITS` and its own."""
    checked = cast(Any, cls)
    cls.__doc__ = f"{cls.__doc__}{PARAMETERS}"
    checked.__post_init__ = partialmethod(require, LIMITS | getattr(cls, "limits", {}))
    return cls


def own_channels(p: Any) -> tuple[str, ...]:
    """Return the channels of a robot's own readings, in order of preference."""
    return ("odometry", *models.fixed_channels(p.anchor_reading))


def team_channels(p: Any) -> tuple[str, ...]:
    """Return the channels in any world where teammates meet, in order of preference."""
    return (*own_channels(p), f"sighting|radio_{p.reading}")


# MRSL and CTRN measure ranges by radio. Where there is none they take the distances of a camera's sightings.


def radio_channel(p: Any) -> str:
    """Return the channel that `reading` names."""
    return "radio_range|sighting" if p.reading == "range" else f"radio_{p.reading}"


def take_sightings_for_ranges(world: World) -> World:
    """Return a world that has a radio's ranges in place of sightings, if it has these.

    Raises:
        BadInput: they have no range.
    """
    camera, others = world.sensors.get("sighting"), {c: s for c, s in world.sensors.items() if c != "sighting"}
    if camera is None:
        return world
    if not isinstance(camera, models.Sighting | models.Range):
        raise BadInput(f"it takes distances of teammates, which sightings by {type(camera).__name__} do not have")
    return replace(world, sensors=others | {"radio_range": models.Range(float(camera.R[0, 0]) ** 0.5, loss_of(camera))})


def range_of_sightings(z: Senses, mail: Mail) -> Mail:
    """Return mail with the distance of each sighting of a sender as its range, if there are sightings."""
    return mail._replace(range=np.where(mail.heard, z.sighting[..., 0], np.nan)) if z.sighting.shape[-2] else mail


def power(p: Any) -> float:
    """Return the exponent of every density in a product over M samples."""
    return 1 / p.M if p.temper else 1.0


class FilterState(NamedTuple):
    """The memory of one robot. The newest entry of each memory comes first."""

    x: Array  # (r, N, d)  particles
    logw: Array  # (r, N)     log-weights, unnormalised
    due: Mask  # (r,)       rows to be resampled when the next tick begins
    sent: Belief | None  # the belief to be sent, where it is computed already
    belief: Belief  # x (r, d), P (r, d, d)  at the end of the last tick
    key: Keys  # (r, 2)
    tick: int
    doa: Array  # (r, K)     raw angles [rad]
    smooth: Array  # (r, M)     averaged angles [rad]
    trail: Array  # (r, M, 2)  where the robot was then, seen from where it is now [m]
    errors: Array  # (r, 3)     of the best particles of the last ticks [rad], for residual="code"
    past: PastPackets  # of a robot that uses more than the newest packet of each sender
    world: World


def init(p: Any, prior: Belief, world: World, rows: Rows) -> FilterState:
    """Draw particles from the prior, with empty memories."""
    world = models.inflate(world, p.inflation, p.loss)
    if _anchor_kind(p, world) in ("doa", "gradient"):
        gradient_doa(world)
    reach = float(np.abs(world.arena).max())
    if p.precision == "single" and reach > FARTHEST:
        raise BadInput(
            f"precision='single' has seven digits, and this arena reaches {reach:.0f} m from the origin: set "
            f"precision='double', or put the origin within {FARTHEST:.0f} m"
        )
    r, x = len(prior.x), sample_prior(prior, rows.key, p.particles)
    empty = np.full((r, p.K), np.nan), np.full((r, p.M), np.nan), np.zeros((r, p.M, 2)), np.full((r, 3), np.nan)
    s = FilterState(
        x, np.zeros(x.shape[:2]), np.zeros(r, bool), None, prior, rows.key, 0, *empty, no_past_packets(r, 0, 0), world
    )
    return round_to_single(p, s)


def _anchor_kind(p: Any, world: World) -> str:
    """Return what particles are weighed by: the "doa" or "gradient" made of four RSSI, or each reading as it is."""
    return str(p.anchor_reading) if "anchor_rssi" in world.sensors else "as it is"


def _is_one_pass(p: Any, world: World) -> bool:
    """Return whether particles are drawn and weighed in one pass, in `correct`."""
    return p.proposal == "walk" and _anchor_kind(p, world) not in ("doa", "gradient")


def round_to_single(p: Any, s: FilterState) -> FilterState:
    """Round particles and log-weights as `precision` keeps them; numpy's steps compute in double."""
    real: Any = np.float32 if p.precision == "single" else np.float64
    return s if s.x.dtype == s.logw.dtype == real else s._replace(x=s.x.astype(real), logw=s.logw.astype(real))


def predict(p: Any, s: FilterState, z: Senses) -> FilterState:
    """Draw from P(x_t+1 | x_t), or uniformly around the moved estimate or best particle, forgetting the weights."""
    motion, tick = s.world.motion, s.tick + 1
    if _is_one_pass(p, s.world):
        return s._replace(tick=tick)
    trail = motion.retrace(s.trail, z.odometry, z.dt)
    if p.proposal != "walk":
        if p.proposal == "best":
            here = heaviest(s.x, s.logw)
        else:
            x, logw = resample(s.x, s.logw, s.key, s.tick)
            here = moments(x, weights(logw)).x
        middle, _, _ = motion.move(here, z.odometry, z.dt)
        x, logw = np.repeat(middle[:, None, :], p.particles, 1), np.zeros_like(s.logw)
        x[..., :2] += p.box * (2 * random_numbers.uniforms(s.key, tick, random_numbers.BOX, p.particles) - 1)
    else:
        x, logw, _ = advance(s, z, tick)
    return round_to_single(p, s._replace(x=x, logw=logw, tick=tick, trail=trail))


def correct(p: Any, s: FilterState, z: Senses) -> FilterState:
    """Weigh the particles by the readings of anchors, or of landmarks."""
    reads = _anchor_kind(p, s.world)
    if _is_one_pass(p, s.world):
        x, logw, sent = advance(s, z, s.tick, list(s.world.fixed(z)), p.sends != "nothing")
        s = s._replace(x=x, logw=logw, sent=sent)
    elif reads == "gradient":
        doa = gradient_doa(s.world)
        s = s._replace(logw=particle_likelihood.gradient(doa, s.x, s.logw, doa.gradient(z.anchor_rssi)))
    elif reads == "doa" and p.residual == "code" and p.density == "constant":
        doa = gradient_doa(s.world)
        logw, error = particle_likelihood.weigh_by_folded_angle(doa, s.x, s.logw, z.anchor_rssi, s.errors)
        s = s._replace(logw=logw, errors=np.where(np.isnan(error)[:, None], s.errors, _push(s.errors, error)))
    elif reads == "doa":
        doa = gradient_doa(s.world)
        s, angles = _remember(p, s, doa.measure(z.anchor_rssi))
        form = "exact" if p.density == "exact" else p.residual
        logw = particle_likelihood.window(doa, s.world.motion, s.x, s.logw, angles, s.trail, form, power(p))
        s = s._replace(logw=logw)
    else:
        s = s._replace(logw=particle_likelihood.anchors(list(s.world.fixed(z)), s.x, s.logw))
    return round_to_single(p, s)


def belief_to_send(s: FilterState) -> Belief:
    """Return the belief that a robot sends: before it uses any packet of this tick."""
    return s.sent or summary(s.x, s.logw)


def resample_and_estimate(p: Any, s: FilterState, heard: ReceivedPackets | None = None) -> FilterState:
    """Weigh by the packets heard; the belief is mean (with point="max" the heaviest particle) and covariance."""
    s = round_to_single(p, s)
    belief, logw, due = posterior_summary(s.x, s.logw, heard)
    if p.point == "max":
        belief = belief._replace(x=heaviest(s.x, logw))
    return round_to_single(p, s._replace(logw=logw, due=due, belief=belief))


def heaviest(x: Array, logw: Array) -> Array:
    """Return the particle of largest weight of each row (r, d)."""
    return np.take_along_axis(x, logw.argmax(-1)[:, None, None], 1)[:, 0]


def estimate(p: Any, s: FilterState) -> Belief:
    """Return the belief at the end of the last tick."""
    return s.belief


def _remember(p: Any, s: FilterState, angle: Array) -> tuple[FilterState, Array]:
    """Smooth the DOA by a circular moving average over the last K, weights decay^age; return the last M averages.

    These (r, M) are nan where this tick has no DOA. Memories count samples, not ticks: they stay as they are then.
    """
    doa = _push(s.doa, angle)
    weight = np.where(np.isnan(doa), 0.0, p.decay ** np.arange(p.K))
    smooth = _push(s.smooth, circular_mean(np.where(np.isnan(doa), 0.0, doa), weight))
    new, trail = ~np.isnan(angle)[:, None], _push(s.trail, np.zeros_like(s.trail[:, 0]))
    smooth, trail = np.where(new, smooth, s.smooth), np.where(new[..., None], trail, s.trail)
    s = s._replace(doa=np.where(new, doa, s.doa), smooth=smooth, trail=trail)
    return s, np.where(new, smooth, np.nan)


def _push(memory: Array, newest: Array) -> Array:
    """Put an entry in front of a memory (r, k, ...), and forget the last one."""
    return np.concatenate([newest[:, None], memory[:, :-1]], 1)


def team_readings(world: World, z: Senses, mail: Mail) -> tuple[Sensor, Array]:
    """Return the sensor of teammates, and its readings (r, n, k) of the senders heard; nan where absent or too near."""
    sensor, reading = world.of_teammates(z, mail)[0]
    ranged = isinstance(sensor, models.Range | models.Sighting)
    refused = ~mail.heard[..., None] | (ranged & (reading[..., :1] < models.TOO_NEAR_TO_RANGE))
    return sensor, np.where(refused, np.nan, reading)
