"""The server `Runtime`: randomness as a sensor."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b

from colony.ir.servers import RUNTIME
from colony.runtime.frames.publishing import FRAMES_KEPT, Fields, Publisher
from colony.runtime.protocol.calls import CallDispatcher, CallId, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import MAX_DEPLOYMENT_BYTES, Deployment, Leadership
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
    """The server of `random`, which depends only on the run's seed and the number of the frame.

    So a restarted server continues with the same numbers. Mutable: each deployment sets the seed before the
    first frame of its run, by the call `deploy` or, from a Clock in the same process, by `on_deploy`.
    """

    address = RUNTIME.name

    def __init__(self, seed: int = 0, *, frames_kept: int = FRAMES_KEPT) -> None:
        self._seed = seed
        self._publisher = Publisher(self.address, self._read, frames_kept=frames_kept)
        self._leadership = Leadership(self.address)
        self._calls = CallDispatcher(
            self.address,
            (method("deploy", Deployment, self._deploy, max_bytes=MAX_DEPLOYMENT_BYTES),),
            on_lost=self._lost,
        )
        self.listens = (*self._publisher.listens, *self._calls.listens)

    def on_deploy(self, deployed: Deployment) -> None:
        """Publish the numbers of this run, from the next frame on."""
        self._seed = deployed.seed

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Answer ticks, fetches and calls."""
        match message:
            case Tick() | Fetch():
                return self._publisher.handle(message)
            case Call() | Alive() | Malformed() | Wake():
                return self._calls.handle(message, now_ns)
            case _:
                return ()

    def _read(self, tick: Tick) -> Fields:
        return {"random": Sample(random_of_frame(self._seed, tick.k), tick.t_ns)}

    def _deploy(self, call_id: CallId, deployed: Deployment, now_ns: int) -> None:
        self._leadership.take(call_id.caller, deployed)
        self.on_deploy(deployed)

    def _lost(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        self._leadership.on_lost(caller)
        return ()


def random_of_frame(seed: int, k: int) -> float:
    """Return the random number of frame `k`, uniform in [0, 1): the top 53 bits of a hash as a fraction."""
    digest = blake2b(f"{seed}:{k}".encode(), digest_size=8).digest()
    return (int.from_bytes(digest, "big") >> 11) / (1 << 53)
