"""Faults of a network, drawn from a seed: messages that come late, twice, out of order, or not at all."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from colony.runtime.protocol.messages import Message
from colony.runtime.transport.virtual import Delay


@dataclass(frozen=True, slots=True, kw_only=True)
class Rates:
    """How likely each fault is for a message, and by how much it is late at most.

    A late one comes after those of later frames; one out of order after others of its moment.
    """

    lost: float = 0.02
    doubled: float = 0.02
    late: float = 0.03
    reordered: float = 0.1
    late_ns: int = 120_000_000
    reordered_ns: int = 2_000_000


class Faults:
    """A link with faults. Mutable: its random state.

    `spares` are messages that always arrive at once, given sender, receiver and the message itself.
    """

    def __init__(
        self,
        seed: int,
        rates: Rates = Rates(),
        *,
        spares: Callable[[str, str, Message], bool] = lambda sender, receiver, message: False,
    ) -> None:
        self._random = random.Random(seed).random
        self._rates = rates
        self._spares = spares

    def __call__(self, sender: str, receiver: str, message: Message) -> Delay:
        if self._spares(sender, receiver, message):
            return 0
        rates, drawn = self._rates, self._random()
        if drawn < rates.lost:
            return None
        drawn -= rates.lost
        if drawn < rates.doubled:
            return 0, self._some(rates.late_ns)
        drawn -= rates.doubled
        if drawn < rates.late:
            return self._some(rates.late_ns)
        drawn -= rates.late
        return self._some(rates.reordered_ns) if drawn < rates.reordered else 0

    def _some(self, most_ns: int) -> int:
        return int(self._random() * most_ns)
