"""Network faults drawn from a seed: messages that are late, duplicated, reordered or lost."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from colony.runtime.protocol.messages import Message
from colony.runtime.transport.exchange import Delay


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultRates:
    """The probability of each fault per message, and the maximum delays.

    A late message may arrive after messages of later frames, a reordered one after others sent at its time.
    """

    lost: float = 0.02
    duplicated: float = 0.02
    late: float = 0.03
    reordered: float = 0.1
    late_ns: int = 120_000_000
    reordered_ns: int = 2_000_000


class LinkFaults:
    """A link with faults. Mutable.

    Messages for which `exempt(sender, receiver, message)` is true always arrive at once.
    """

    def __init__(
        self,
        seed: int,
        rates: FaultRates = FaultRates(),
        *,
        exempt: Callable[[str, str, Message], bool] = lambda sender, receiver, message: False,
    ) -> None:
        self._random = random.Random(seed).random
        self._rates = rates
        self._exempt = exempt

    def __call__(self, sender: str, receiver: str, message: Message) -> Delay:
        """Draw the fate of a message, as a `Link` returns it."""
        if self._exempt(sender, receiver, message):
            return 0
        rates, draw = self._rates, self._random()
        if draw < rates.lost:
            return None
        draw -= rates.lost
        if draw < rates.duplicated:
            return 0, self._random_delay(rates.late_ns)
        draw -= rates.duplicated
        if draw < rates.late:
            return self._random_delay(rates.late_ns)
        draw -= rates.late
        return self._random_delay(rates.reordered_ns) if draw < rates.reordered else 0

    def _random_delay(self, max_ns: int) -> int:
        return int(self._random() * max_ns)
