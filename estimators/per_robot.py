"""Lifts a plain object that runs on one robot to the interface: the filter loop one would write with filterpy.

Write a class for a single robot, as below, and run `PerRobot(MyLoop, gate=9.0)`, or name it on the command line,
`path.py:MyLoop[gate=9]`. It is the quick way to begin, and a reference to test a batched version against, which is
about fifty times faster.

    class MyLoop:
        uses = ("odometry", "anchor_rssi")
        def __init__(self, prior, world, robot, key, gate: float = 13.8): ...  # parameters after the first four
        def predict(self, z): ...       # z.odometry (k,), z.dt
        def correct(self, z): ...       # z.anchor_rssi (a,), z.landmark (l, 2), or world.fixed(z)
        def send(self): ...             # (m,) numbers; optional
        def fuse(self, mail): ...       # mail.packets (n, m) where mail.heard (n,); optional
        def estimate(self): ...         # x (d,), P (d, d); not needed where the object has these as self.x and self.P

`uses`, and what else `PerRobot` takes beside parameters, may stand in the class or in the call.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from cooploc.estimators.interface import Array, Belief, Keys, Mail, Rows, Senses, World
from cooploc.estimators.lifting.handed import mail_of, senses_of
from cooploc.estimators.lifting.lift import Lift
from cooploc.estimators.lifting.returned import believed


class Single(Protocol):
    """What runs on one robot. `send`, `fuse` and `estimate`, as in the module's example, may be there too."""

    def predict(self, z: Senses) -> None:
        """Move by the robot's own odometry; `z` has no row axis."""
        ...

    def correct(self, z: Senses) -> None:
        """Use the robot's own readings of fixed things."""
        ...


class State(NamedTuple):
    """The objects, one per row. They change in place."""

    robots: tuple[Any, ...]
    key: Keys  # (r, 2)
    tick: int  # the last one that began; -1 before the first


@dataclass(frozen=True, init=False, repr=False)
class PerRobot(Lift):
    """One object per robot and trial, made by `make(prior, world, robot, key, **parameters)`: a class, or a function.

    Args:
        make: what makes an object from its robot's prior (x (d,), P (d, d)), the world, the robot's number and its key.
        uses: the channels that it reads, as `Estimator` says.
        axes: why its estimates do not turn with the world, as those of an unscented filter do not.
        notes: names of attributes of the objects, numbers that they count; shown under the table.
        own_random: whether it uses a library that draws from the global state of `random` or `numpy.random`: each call
            is then given one of its own, by trial, robot and tick, and the global state is restored afterwards.
        own_motion: why it does not move as dead reckoning does where it has odometry alone.
        parameters: what `make` takes beside; a default `cl.tunable(...)`, in its signature or here, may be tuned.

    Raises:
        TypeError: `make` does not take the four arguments, or has no such parameter.

    """

    given: ClassVar[tuple[str, ...]] = ("prior", "world", "robot", "key")

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        # Copies, because a plain loop may well write into its state.
        beliefs = [Belief(x.copy(), P.copy()) for x, P in zip(*prior, strict=True)]
        who, parameters = rows.robot.tolist(), self.parameters
        empty = State((None,) * len(who), rows.key, -1)
        made = self._each(empty, "init", lambda _, i: self.make(beliefs[i], world, who[i], rows.key[i], **parameters))
        return empty._replace(robots=tuple(made))

    def predict(self, s: State, z: Senses) -> State:
        s = s._replace(tick=s.tick + 1)
        self._each(s, "predict", lambda robot, i: robot.predict(senses_of(z, i)))
        return s

    def correct(self, s: State, z: Senses) -> State:
        self._each(s, "correct", lambda robot, i: robot.correct(senses_of(z, i)))
        return s

    def send(self, s: State, z: Senses) -> Array:
        said = self._each(s, "send", lambda robot, _: _said(robot))
        widths = {len(packet) for packet in said}
        if len(widths) > 1:
            raise ValueError(f"send() returned packets of {sorted(widths)} numbers; fill the shorter ones with nan")
        return np.stack(said)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        self._each(s, "fuse", lambda robot, i: hasattr(robot, "fuse") and robot.fuse(mail_of(mail, i)))
        return s

    def estimate(self, s: State) -> Belief:
        beliefs = self._each(s, "estimate", lambda robot, _: believed(robot))
        return Belief(np.stack([b.x for b in beliefs]), np.stack([b.P for b in beliefs]))

    def notes(self, s: State) -> Mapping[str, Array]:
        """What the objects counted, (r,) each."""
        return {name: np.array([getattr(robot, name) for robot in s.robots], float) for name in self.counted}

    def _each(self, s: State, step: str, call: Callable[[Any, int], Any]) -> list[Any]:
        """What a call with every object and its row returns."""
        found = []
        for i, robot in enumerate(s.robots):
            with self.random(s.key[i], s.tick, step):
                found.append(call(robot, i))
        return found


def _said(robot: Any) -> Array:
    """What a robot sends (m,); nothing where it has no `send`."""
    said: Array = np.array(robot.send(), float) if hasattr(robot, "send") else np.empty(0)
    if said.ndim != 1:
        raise ValueError(f"send() returned shape {said.shape}; it must be one axis of numbers")
    return said
