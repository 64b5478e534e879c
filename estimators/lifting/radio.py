"""The radio of a team that one object runs: packets over the links that hold, and who pays for them."""

from collections.abc import Sequence

import numpy as np

from cooploc.estimators.interface import HEADER, Array, Mail, Mask


class Radio:
    """One tick's radio; axis 0 is the receiver, axis 1 the sender, as in `Mail`.

    Attributes:
        heard (n, n): who has received a packet of whom in this tick.
        rssi, range (n, n): readings [dBm], [m] of those packets; nan elsewhere.
        messages, bytes (n,): what each robot has sent in this tick.

    """

    def __init__(self, air: Mail, awake: Mask, centralised: bool = False) -> None:
        """A radio over the links `air.heard`; of a centralised team everything is known from the start."""
        self._air, self._awake = air, awake
        self.heard: Mask = air.heard.copy() if centralised else np.zeros_like(air.heard)
        self.rssi, self.range = (np.where(self.heard, a, np.nan) for a in (air.rssi, air.range))
        self.messages, self.bytes = np.zeros(len(awake)), np.zeros(len(awake))

    def send(self, sender: int, receiver: int, numbers: Sequence[float] | Array) -> Array | None:
        """A packet (m,) to one teammate, which costs the sender one message.

        Returns:
            The packet as the receiver gets it; None where it does not arrive, or the sender is asleep. A packet of
            nothing but nan is silence: it is neither sent nor paid.

        Raises:
            ValueError: a robot sends to itself.

        """
        if sender == receiver:
            raise ValueError(f"robot {sender} sends a packet to itself; it has what it would send")
        packet = self._paid(sender, numbers)
        return packet if packet is not None and self._arrives(sender, receiver) else None

    def broadcast(self, sender: int, numbers: Sequence[float] | Array) -> list[int]:
        """A packet (m,) to everyone, which costs the sender one message; who received it."""
        if self._paid(sender, numbers) is None:
            return []
        return [receiver for receiver in range(len(self._awake)) if self._arrives(sender, receiver)]

    def _paid(self, sender: int, numbers: Sequence[float] | Array) -> Array | None:
        packet = np.array(numbers, float).ravel()
        if not self._awake[sender] or (packet.size and np.isnan(packet).all()):
            return None
        self.messages[sender] += 1
        self.bytes[sender] += 8.0 * np.isfinite(packet).sum() + HEADER
        return packet

    def _arrives(self, sender: int, receiver: int) -> bool:
        place = receiver, sender
        if not self._air.heard[place]:
            return False
        self.heard[place] = True
        self.rssi[place], self.range[place] = self._air.rssi[place], self._air.range[place]
        return True
