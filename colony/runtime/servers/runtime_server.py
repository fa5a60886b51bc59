"""The server `Runtime`: randomness as a sensor."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b

from colony.runtime.frames.publishing import FRAMES_KEPT, Fields, Publisher
from colony.runtime.protocol.calls import Asked, CallDesk, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import DEPLOYMENT_BYTES, Deployment
from colony.runtime.protocol.fields import RUNTIME
from colony.runtime.protocol.leadership import Leadership
from colony.runtime.protocol.messages import (
    Alive,
    Call,
    Effect,
    Fetch,
    Malformed,
    Message,
    QuietNode,
    Sample,
    Tick,
    Wake,
)


class RuntimeServer(QuietNode):
    """The server of `random`, a function of only the run's seed and the frame's number.

    So a restarted server continues with the same numbers. Mutable: the seed. The seed comes with each
    deployment: by the call `deploy`, or from the Clock of the same process by `use`, before the first frame
    of the run.
    """

    address = RUNTIME.name

    def __init__(self, seed: int = 0, *, keep: int = FRAMES_KEPT) -> None:
        self._seed = seed
        self._publisher = Publisher(self.address, self._read, keep=keep)
        self._leadership = Leadership(self.address)
        self._desk = CallDesk(
            self.address,
            (method("deploy", Deployment, self._deploy, largest=DEPLOYMENT_BYTES),),
            lost=self._lost,
        )
        self.listens = (*self._publisher.listens, *self._desk.listens)

    def use(self, deployed: Deployment) -> None:
        """Publish the numbers of this run, from the next frame on."""
        self._seed = deployed.seed

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Answer ticks, fetches and calls."""
        match message:
            case Tick() | Fetch():
                return self._publisher.handle(message)
            case Call() | Alive() | Malformed() | Wake():
                return self._desk.handle(message, now_ns)
            case _:
                return ()

    def _read(self, tick: Tick) -> Fields:
        return {"random": Sample(random_of_frame(self._seed, tick.k), tick.t_ns)}

    def _deploy(self, asked: Asked, deployed: Deployment, now_ns: int) -> None:
        self._leadership.take(asked.caller, deployed)
        self.use(deployed)

    def _lost(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        self._leadership.lost(caller)
        return ()


def random_of_frame(seed: int, k: int) -> float:
    """Return the number of frame `k`: the top 53 bits of a hash, as a fraction, uniform in [0, 1)."""
    digest = blake2b(f"{seed}:{k}".encode(), digest_size=8).digest()
    return (int.from_bytes(digest, "big") >> 11) / (1 << 53)
