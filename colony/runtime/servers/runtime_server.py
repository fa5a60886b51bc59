"""The server `Runtime`: chance, as a sensor like any other."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b

from colony.runtime.fields import RUNTIME
from colony.runtime.messages import Effect, Fetch, Message, Sample, Tick
from colony.runtime.servers.publishing import Fields, Publisher


class RuntimeServer:
    """Publishes `random`, which is a function of the run's seed and the frame's number and of nothing else,
    so that a server that was restarted goes on with the same numbers."""

    address = RUNTIME.name

    def __init__(self, seed: int, *, keep: int) -> None:
        self._seed = seed
        self._publisher = Publisher(self.address, self._read, keep=keep)
        self.listens = self._publisher.listens

    def start(self, now_ns: int) -> Iterable[Effect]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        if isinstance(message, (Tick, Fetch)):
            return self._publisher.handle(message)
        return ()

    def close(self) -> None:
        """It holds nothing."""

    def _read(self, tick: Tick) -> Fields:
        return {"random": Sample(random_of_frame(self._seed, tick.k), tick.t_ns)}


def random_of_frame(seed: int, k: int) -> float:
    """The number of frame `k`: the top 53 bits of a hash, as a fraction, uniform in [0, 1)."""
    digest = blake2b(f"{seed}:{k}".encode(), digest_size=8).digest()
    return (int.from_bytes(digest, "big") >> 11) / (1 << 53)
