"""Lifts a plain object that runs on one robot to the interface: the filter loop one would write with filterpy.

Write a class for a single robot, as below, and run `PerRobot(MyLoop, uses=("odometry", "anchor_rssi"))`. It is the
quick way to begin, and a reference to test a batched version against, which is about fifty times faster.

    class MyLoop:
        def __init__(self, prior, world, robot, key): ...
        def predict(self, z): ...       # z.odometry (k,), z.dt
        def correct(self, z): ...       # z.anchor_rssi (a,), z.landmark (l, 2), or world.fixed(z)
        def send(self): ...             # (m,) numbers; optional
        def fuse(self, mail): ...       # mail.packets (n, m) where mail.heard (n,); optional
        def estimate(self): ...         # Belief(x (d,), P (d, d))
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from cooploc.estimators.interface import Array, Belief, Keys, Mail, Rows, Senses, World


class Single(Protocol):
    """What runs on one robot. `send` and `fuse`, as in the module's example, may be there too."""

    def predict(self, z: Senses) -> None:
        """Move by the robot's own odometry; `z` has no row axis."""
        ...

    def correct(self, z: Senses) -> None:
        """Use the robot's own readings of fixed things."""
        ...

    def estimate(self) -> Belief:
        """x (d,), P (d, d)."""
        ...


class State(NamedTuple):
    """The objects, one per row. They change in place."""

    robots: tuple[Any, ...]


@dataclass(frozen=True)
class PerRobot:
    """One object per robot and trial, made by `make(prior, world, robot, key)`: a class, or a function."""

    make: Callable[[Belief, World, int, Keys], Single]
    uses: tuple[str, ...] = ("odometry",)
    api: ClassVar[int] = 1
    mutable: ClassVar[bool] = True  # exempt from the check that a method leaves the state it is given alone

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        # Copies, because a plain loop may well write into its state.
        beliefs = (Belief(x.copy(), P.copy()) for x, P in zip(*prior, strict=True))
        who = zip(beliefs, rows.robot.tolist(), rows.key, strict=True)
        return State(tuple(self.make(belief, world, robot, key) for belief, robot, key in who))

    def predict(self, s: State, z: Senses) -> State:
        for i, robot in enumerate(s.robots):
            robot.predict(_own_senses(z, i))
        return s

    def correct(self, s: State, z: Senses) -> State:
        for i, robot in enumerate(s.robots):
            robot.correct(_own_senses(z, i))
        return s

    def send(self, s: State, z: Senses) -> Array:
        said = [_said(robot) for robot in s.robots]
        widths = {len(packet) for packet in said}
        if len(widths) > 1:
            raise ValueError(f"send() returned packets of {sorted(widths)} numbers; fill the shorter ones with nan")
        return np.stack(said)

    def fuse(self, s: State, z: Senses, mail: Mail) -> State:
        for i, robot in enumerate(s.robots):
            if hasattr(robot, "fuse"):
                robot.fuse(Mail(*(a[i] for a in mail)))
        return s

    def estimate(self, s: State) -> Belief:
        beliefs = [robot.estimate() for robot in s.robots]
        return Belief(np.stack([b.x for b in beliefs]), np.stack([b.P for b in beliefs]))


def _own_senses(z: Senses, i: int) -> Senses:
    """Row i, without the row axis."""
    arrays = {name: getattr(z, name)[i] for name in Senses._fields[:-1]}
    return Senses(**arrays, extra={name: a[i] for name, a in z.extra.items()})


def _said(robot: Any) -> Array:
    """What a robot sends (m,); nothing where it has no `send`."""
    said: Array = np.array(robot.send(), float) if hasattr(robot, "send") else np.empty(0)
    if said.ndim != 1:
        raise ValueError(f"send() returned shape {said.shape}; it must be one axis of numbers")
    return said
