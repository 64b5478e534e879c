"""Split covariance intersection: only the part of a covariance that may be correlated is inflated.

A covariance is P = Pd + Pi. Own odometry and own readings feed Pi; covariance intersection with the weight w of least
position trace acts on Pd alone. Ours: a reading is not used where that trace would not fall, or det P would rise.

Sent, in one broadcast a tick: x and the triangles of Pd and Pi (8 numbers, with a heading 15) and, with a camera, range
and bearing of every teammate in sight; 8 bytes each. A robot that was sighted uses that reading, too (`both`).

Which part of a received estimate counts as independent (`form`): "literal", its independent part, which its sender also
keeps: with independent priors the filter *is* ekf-naive. "received", none of it: still somewhat over-confident.
"conservative", what its sender has never sent before; a robot treats what it sent as dependent.

Source: H. Li, F. Nashashibi, "Cooperative multi-vehicle localization using split covariance intersection filter", IEEE
Intelligent Transportation Systems Magazine 5(2), 2013. Pd is updated in Joseph's form, because Pd = P - Pi would not
stay definite.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from cooploc.estimators import kalman, split_kernels
from cooploc.estimators.broadcasts import readings_for_loop
from cooploc.estimators.compiled import readable
from cooploc.estimators.interface import Array, Belief, Indices, Mail, Mask, Rows, Senses, World
from cooploc.estimators.models import AnchorReading, fixed_readings, wrap_heading
from cooploc.estimators.robust import AssumedLoss
from cooploc.estimators.tunable import tunable


class State(NamedTuple):
    """The memory of one robot."""

    x: Array  # (r, d)
    Pd: Array  # (r, d, d)  the part of P that may be correlated with teammates
    Pi: Array  # (r, d, d)  the part that is not
    robot: Indices  # (r,)
    world: World


@dataclass(frozen=True)
@kalman.explain
class EkfSplitCi:
    """EKF on own readings, split covariance intersection with received beliefs.

    Parameters:
        form: which part of a received estimate counts as independent: "literal", its independent part; "received",
            none of it; "conservative", what its sender has never sent before.
    """

    api: ClassVar[int] = 1
    sends: ClassVar[str] = "mean, both covariances, sightings"
    consistency: ClassVar[str] = "between naive and CI; `form=conservative` is conservative"
    anchor_reading: AnchorReading = "doa"
    gate: float = tunable(kalman.GATE, 2.0, 1000.0, log=True)
    inflation: float = tunable(1.0, 0.5, 5.0, log=True)
    engine: kalman.EngineName = "batched"
    reading: kalman.RadioReading = "range"
    form: Literal["literal", "received", "conservative"] = "received"
    both: bool = True
    loss: AssumedLoss = "world"

    uses = property(kalman.team_channels)

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        world = kalman.assume(self, world)
        return State(prior.x, np.zeros_like(prior.P), prior.P, rows.robot, world)

    def predict(self, s: State, z: Senses) -> State:
        """Pd' = F Pd F',  Pi' = F Pi F' + Q."""
        x, Pi, F = kalman.predict_ekf(self, s.world, s.x, s.Pi, z)
        return s._replace(x=x, Pd=kalman.symmetric(F @ s.Pd @ F.mT), Pi=Pi)

    def correct(self, s: State, z: Senses) -> State:
        """Kalman update by an independent reading: Pd' = (I - K H) Pd (I - K H)', the rest of P' is Pi'."""
        if seen := kalman.landmarks_alone(self, s.world, z):
            x, Pd, Pi = s.x.copy(), s.Pd.copy(), s.Pi.copy()
            split_kernels.sight_split(x, Pd, Pi, seen, True)
            return s._replace(x=x, Pd=Pd, Pi=Pi)
        for sensor, place, reading in fixed_readings(s.world, z, self.anchor_reading):
            y, H, _ = kalman.innovation(sensor, s.x, place, reading)
            y, H = kalman.soften(sensor, s.Pd + s.Pi, y, H)
            nothing = np.zeros((*y.shape, y.shape[-1]))
            s, _ = self._update(s, y, H, nothing, sensor.R + nothing, own=True)
        return s

    def send(self, s: State, z: Senses) -> Array:
        """Return the belief before this tick's fusion, and the sightings."""
        return kalman.Message(s.x, (s.Pd, s.Pi), z.sighting if self.both else z.sighting[:, :0]).pack()

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        """Use each reading between the robot and a sender, whose split covariance makes the reading's noise."""
        known, d, spent = np.zeros(mail.heard.shape, bool), s.x.shape[-1], self.form == "conservative"
        tables = readings_for_loop(self, s.world, z, mail, d + d * (d + 1))
        if tables is None:
            s = self._fuse_one_by_one(s, z, mail, known)
        else:
            s, packets = s._replace(x=s.x.copy(), Pd=s.Pd.copy(), Pi=s.Pi.copy()), readable(mail.packets)
            how = float(self.gate), self.form == "literal", spent
            for model, readings, by_sender in tables:
                split_kernels.fuse_split(*s[:3], s.robot, packets, readings, model, by_sender, how, known)
        if spent and s.world.robots > 1:  # the broadcast contained the independent part
            s = s._replace(Pd=s.Pd + s.Pi, Pi=np.zeros_like(s.Pi))
        return s

    def estimate(self, s: State) -> Belief:
        return Belief(wrap_heading(s.x), s.Pd + s.Pi)

    def _fuse_one_by_one(self, s: State, z: Senses, mail: Mail, known: Mask) -> State:
        """Do what `split_kernels.fuse_split` does with any sensor, loss and engine."""
        sent = kalman.Message.unpack(mail.packets, s.x.shape[-1], parts=2)
        for pair in kalman.receive(s.world, z, mail, sent.sightings, s.robot):
            x_j, Pd_j, Pi_j = (part[:, pair.sender] for part in (sent.x, *sent.P))
            if self.form == "conservative":
                again = known[:, pair.sender, None, None]
                Pd_j, Pi_j = np.where(again, Pd_j + Pi_j, Pd_j), np.where(again, 0.0, Pi_j)
            y, H, H_j = kalman.soften_pair(pair.sensor, *pair.linearise(s.x, x_j), s.Pd + s.Pi, Pd_j + Pi_j)
            s, used = self._update(s, y, H, H_j @ Pd_j @ H_j.mT, H_j @ Pi_j @ H_j.mT + pair.sensor.R)
            known[:, pair.sender] |= used
        return s

    def _update(self, s: State, y: Array, H: Array, Rd: Array, Ri: Array, own: bool = False) -> tuple[State, Mask]:
        """P1 = Pd / w + Pi,  R = Rd / (1 - w) + Ri,  K = P1 H' (H P1 H' + R)^-1 = P' H' R^-1,  x' = x + K y.

        Pd' = (I - K H) Pd / w (I - K H)' + K Rd / (1 - w) K',  Pi' = (I - K H) Pi (I - K H)' + K Ri K'. In all forms
        but the literal, K Ri K' of a received estimate goes to Pd'. An `own` reading has w = 1. Also return which rows
        used it.
        """
        keep, reading = own or self.form == "literal", tuple(map(np.ascontiguousarray, (y, H, Rd, Ri)))
        if self.engine == "batched":
            x, Pd, Pi, used = s.x.copy(), s.Pd.copy(), s.Pi.copy(), np.empty(len(y), bool)
            split_kernels.update_split(x, Pd, Pi, reading, own, self.gate, keep, used)
            return s._replace(x=x, Pd=Pd, Pi=Pi), used
        w = np.ones(len(y))
        for r in () if own else range(len(y)):
            w[r], helps = split_kernels.least_trace(s.Pd[r], s.Pi[r], *(part[r] for part in reading[1:]))
            w[r] = w[r] if helps else np.nan
        y, w = np.where(np.isnan(w)[:, None], np.nan, y), np.where(np.isnan(w), 0.5, w)[:, None, None]
        Pd, Rd = s.Pd / w, np.divide(Rd, 1 - w, out=np.zeros_like(Rd), where=w < 1)
        x, P = kalman.ENGINES[self.engine].update(s.x, Pd + s.Pi, y, H, Rd + Ri, self.gate)
        used = np.asarray((Pd + s.Pi != P).any((1, 2)))
        K = np.linalg.solve(np.where(used[:, None, None], Rd + Ri, np.eye(y.shape[-1])), H @ P).mT
        rest, noise = np.eye(x.shape[-1]) - K @ H, K @ Ri @ K.mT
        Pd = kalman.symmetric(rest @ Pd @ rest.mT + K @ Rd @ K.mT + (0.0 if keep else noise))
        Pi = kalman.symmetric(rest @ s.Pi @ rest.mT + (noise if keep else 0.0))
        Pd, Pi = np.where(used[:, None, None], Pd, s.Pd), np.where(used[:, None, None], Pi, s.Pi)
        return s._replace(x=x, Pd=Pd, Pi=Pi), used
