"""The EKFs that broadcast one belief a tick, and combine what they hear one reading after the other.

Sent: x and the triangle of P (5 numbers, with a heading 9) and, with a camera, range and bearing of every teammate in
sight; 8 bytes each. A robot that was sighted uses that reading, too (`both`). The filters differ in `combine` alone,
which states it in numpy. For the sensors that are built in, readings without a robust loss and the engine "batched",
a compiled loop over rows does the same for a sender's belief that is taken for independent, or intersected.
"""

from typing import Any, NamedTuple

import numpy as np

from cooploc.estimators.compiled import readable, strict_inlined, strict_kernel
from cooploc.estimators.covariance_intersection import ABSENT, BAD, least_weight, root, weight_equation, weight_root
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Rows, Senses, World
from cooploc.estimators.kalman import Message, SensorModel, assume, loop_model, receive, soften_pair
from cooploc.estimators.kalman_kernels import (
    absorb_row,
    fill_form,
    fill_sum,
    is_known,
    linearise_between,
    read_belief,
    whiten,
)


class BroadcastState(NamedTuple):
    """The memory of one robot."""

    x: Array  # (r, d)
    P: Array  # (r, d, d)
    robot: Indices  # (r,)
    world: World


def start_broadcasting(p: Any, prior: Belief, world: World, rows: Rows) -> BroadcastState:
    """Return the prior as the first belief."""
    return BroadcastState(prior.x, prior.P, rows.robot, assume(p, world))


def broadcast(p: Any, s: BroadcastState, z: Senses) -> Array:
    """Return the belief before this tick's fusion, and the sightings, as packets (r, m)."""
    return Message(s.x, (s.P,), z.sighting if p.both else z.sighting[:, :0]).pack()


def fuse_broadcasts(p: Any, s: BroadcastState, z: Senses, mail: Mail) -> BroadcastState:
    """Combine one reading after the other, each linearised at the belief that the last one left.

    `p.combine(belief, y, H, H_j, P_j, R)` returns the belief after readings y (r, k) with H (r, k, d) of senders with
    H_j (r, k, d) and P_j (r, d, d), and R (k, k); rows with a nan come back bit-identical.
    """
    belief, sent = Belief(s.x, s.P), Message.unpack(mail.packets, s.x.shape[-1])
    for pair in receive(s.world, z, mail, sent.sightings, s.robot):
        P_j = sent.P[0][:, pair.sender]
        linear = soften_pair(pair.sensor, *pair.linearise(belief.x, sent.x[:, pair.sender]), belief.P, P_j)
        belief = p.combine(belief, *linear, P_j, pair.sensor.R)
    return s._replace(x=belief.x, P=belief.P)


class Rule(NamedTuple):
    """How a compiled loop combines: the sender's belief independent of the own one, or both intersected."""

    intersect: bool = False
    trace: bool = True  # what a weight minimises of the result: its trace, else its determinant
    block: int = 2  # leading states that this is about


def readings_for_loop(
    p: Any, world: World, z: Senses, mail: Mail, belief: int
) -> list[tuple[SensorModel, Array, bool]] | None:
    """Return a tick's readings of teammates for a compiled loop; None if the loop does not know one of the sensors.

    Each is a sensor's model, its readings (r, n, k), and whether the senders made them: those are in their packets,
    behind the `belief` numbers of a belief.
    """
    tables = [(sensor, readings, False) for sensor, readings in world.of_teammates(z, mail)]
    if "sighting" in world.sensors and mail.packets.shape[-1] > belief:
        tables.append((world.sensors["sighting"], z.sighting, True))
    found = []
    for sensor, readings, by_sender in tables:
        if p.engine != "batched" or not (model := loop_model(sensor)):
            return None
        found.append((model, readable(readings), by_sender))
    return found


def fuse_compiled(p: Any, s: BroadcastState, z: Senses, mail: Mail, rule: Rule) -> BroadcastState:
    """Return what `fuse_broadcasts` does, by a compiled loop where there is one for all sensors."""
    d, x, P, packets = s.x.shape[-1], s.x.copy(), s.P.copy(), readable(mail.packets)
    tables = readings_for_loop(p, s.world, z, mail, d + d * (d + 1) // 2)
    if tables is None:
        return fuse_broadcasts(p, s, z, mail)
    for model, readings, by_sender in tables:
        one_number = readings.shape[-1] == 1 and rule.block == 2  # then the weight is a root, and nothing is searched
        block = None if one_number or not rule.intersect else rule.block
        how = rule.intersect, rule.trace, float(p.gate)
        if not _fuse(x, P, s.robot, packets, readings, model, by_sender, how, block, (0,) * d):
            return fuse_broadcasts(p, s, z, mail)  # it says which covariance cannot be used
    return s._replace(x=x, P=P)


@strict_inlined
def _squared_distance(y, S, e):
    """Return y' S^-1 y; S (k, k) is destroyed, e (k, 1) is scratch."""
    far = 0.0
    for a in range(len(y)):
        e[a, 0] = y[a]
    whiten(S, e)
    for a in range(len(y)):
        far += e[a, 0] * e[a, 0]
    return far


@strict_kernel
def _fuse(x, P, robot, packets, z, model, by_sender, how, block, axes):
    """Update x (r, d), P (r, d, d) in place by readings z (r, n, k) of senders; False where a sender's P is none.

    Or by those that the senders made of the `robot` (r,), in their packets (r, n, m) behind the belief.

    y = z - h,  N = H_j P_j H_j',  S = H P H' + N + R. Independent: by S. Intersected: by P/w and N/(1-w), gated by S of
    independent robots, twice as wide. Where `block` is None nothing that searches for w is compiled.
    """
    (kind, A, slope, R), (intersect, trace, gate) = model, how
    d, n, k = len(axes), z.shape[1], z.shape[2]
    x_j, P_j = np.empty(d), np.empty((d, d))
    y, H, H_j, N, noise = np.empty(k), np.empty((k, d)), np.empty((k, d)), np.empty((k, k)), np.empty((k, k))
    S, e, B, C, M = np.empty((k, k)), np.empty((k, 1)), np.empty((k, d + 1)), np.empty((d, d)), np.empty((3, d, d))
    for r in range(len(x)):
        for j in range(n):
            at = d + d * (d + 1) // 2 + k * robot[r]
            reading = packets[r, j, at : at + k] if by_sender else z[r, j]
            if np.isnan(reading[0]):
                continue
            read_belief(packets[r, j], d, x_j, P_j)
            linearise_between((kind, A, slope), x[r], x_j, reading, by_sender, y, H, H_j)
            fill_form(H_j, P_j, N)
            fill_sum(1.0, N, 1.0, R, noise)
            if not is_known(y, H, noise):
                continue
            if not intersect:
                absorb_row(x[r], P[r], y, H, noise, gate, S, B, C)
                continue
            fill_form(H, P[r], S)
            fill_sum(1.0, S, 1.0, noise, S)
            if not _squared_distance(y, S, e) <= 2 * gate:
                continue
            known, _ = root(P_j, M, axes)
            if known == ABSENT:  # the sender knows nothing
                continue
            if known == BAD:
                return False
            if block is None:
                own = P[r, 0, 0], P[r, 0, 1], P[r, 1, 1], H[0, 0], H[0, 1], N[0, 0], R[0, 0]
                w = 1 - weight_root(*weight_equation(*own, trace))
            else:
                w = least_weight(P[r], H, N, R, trace, block, axes)
                if np.isnan(w):
                    return False
            if w < 1:
                fill_sum(1 / w, P[r], 0.0, P[r], P[r])
                fill_sum(1 / (1 - w), N, 1.0, R, noise)
                absorb_row(x[r], P[r], y, H, noise, np.inf, S, B, C)
    return True
