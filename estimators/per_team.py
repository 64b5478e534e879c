"""Lifts a plain object that holds a whole team to the interface: a loop over robots, as one writes it in a script.

    class MyTeam:
        uses = ("odometry", "anchor_rssi", "radio_range")
        centralised = False             # the default is True
        def __init__(self, prior, world, keys, gate: float = 13.8): ...  # prior x (n, d), P (n, d, d); keys (n, 2)
        def predict(self, z): ...       # z.odometry (n, k), z.dt (n,)
        def correct(self, z): ...       # z.anchor_rssi (n, a), z.landmark (n, l, 2), or world.fixed(z)
        def exchange(self, z, radio): ...  # readings between robots: z.sighting (n, n, 2), world.relative(z, radio)
        def estimate(self): ...         # x (n, d), P (n, d, d); not needed where these are self.x and self.P

What may be exchanged, and who pays:

- A *centralised* team may use everything in `exchange`. Each of its robots pays for the readings it uploads, which the
  runner counts: 8 bytes for each finite number that `uses` selects, and a header.
- A *distributed* team sends packets by `radio.send` and `radio.broadcast`. The sender pays for each packet, whether it
  arrives or not, 8 bytes for each finite number and a header; nothing else is counted, and the class states no bytes.
  Who does not hear a packet gets None, and a radio reading of a teammate exists once a packet of it was heard.

Its robots share one object's memory, so a check cannot see what one of them read of another: its bytes are shown as
declared. A loop for one robot, lifted by `PerRobot`, has no such remark.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from cooploc.estimators.interface import Array, Belief, Keys, Mail, Rows, Senses, Traffic, World
from cooploc.estimators.lifting.handed import mail_of, senses_of
from cooploc.estimators.lifting.lift import Lift
from cooploc.estimators.lifting.radio import Radio
from cooploc.estimators.lifting.returned import believed


class State(NamedTuple):
    """The objects, one per trial. They change in place."""

    teams: tuple[Any, ...]
    keys: Keys  # (trial, n, 2)
    tick: int  # the last one that began; -1 before the first


@dataclass(frozen=True, init=False, repr=False)
class PerTeam(Lift):
    """One object per trial, made by `make(prior, world, keys, **parameters)`: a class, or a function.

    Args:
        make: what makes an object from the team's priors, the world, and the robots' keys.
        uses, axes, notes, own_random, own_motion, parameters: as those of `PerRobot`.
        centralised: whether all readings reach one computer; then the runner counts what its robots upload.
        bound: whether it uses all readings as well as any estimator could.

    Raises:
        TypeError: `make` does not take the three arguments, or has no such parameter.

    """

    centralised: bool
    bound: bool
    given: ClassVar[tuple[str, ...]] = ("prior", "world", "keys")
    more: ClassVar[Mapping[str, Any]] = {"centralised": True, "bound": False}

    def init(self, prior: Belief, world: World, rows: Rows) -> State:
        teams = [Belief(x.copy(), P.copy()) for x, P in zip(*prior, strict=True)]
        none, parameters = State((None,) * len(teams), rows.key, -1), self.parameters
        made = self._each(none, "init", lambda _, i: self.make(teams[i], world, rows.key[i], **parameters))
        return none._replace(teams=tuple(made))

    def predict(self, s: State, z: Senses) -> State:
        s = s._replace(tick=s.tick + 1)
        self._each(s, "predict", lambda team, i: team.predict(senses_of(z, i)))
        return s

    def correct(self, s: State, z: Senses) -> State:
        self._each(s, "correct", lambda team, i: team.correct(senses_of(z, i)))
        return s

    def exchange(self, s: State, z: Senses, air: Mail) -> tuple[State, Traffic]:
        radios = [Radio(mail_of(air, i), z.dt[i] > 0, self.centralised) for i in range(len(s.teams))]
        self._each(s, "exchange", lambda team, i: team.exchange(senses_of(z, i), radios[i]))
        return s, Traffic(np.stack([one.messages for one in radios]), np.stack([one.bytes for one in radios]))

    def estimate(self, s: State) -> Belief:
        beliefs = self._each(s, "estimate", lambda team, _: believed(team, columns=False))
        return Belief(np.stack([b.x for b in beliefs]), np.stack([b.P for b in beliefs]))

    def notes(self, s: State) -> Mapping[str, Array]:
        """What the objects counted of each robot, (trial, n) each."""
        shape = s.keys.shape[:2]
        return {name: np.array([np.broadcast_to(getattr(t, name), shape[1]) for t in s.teams]) for name in self.counted}

    def _each(self, s: State, step: str, call: Callable[[Any, int], Any]) -> list[Any]:
        """What a call with every object and its trial returns."""
        found = []
        for i, team in enumerate(s.teams):
            with self.random(s.keys[i], s.tick, step):
                found.append(call(team, i))
        return found
