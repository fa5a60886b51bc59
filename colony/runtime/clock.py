"""The Clock of a robot: it publishes tick k at k frame periods, with who is down and who is lost."""

from __future__ import annotations

from collections.abc import Iterable

from colony.runtime import topics
from colony.runtime.liveness import Liveness
from colony.runtime.messages import Effect, Fetch, Message, Request, Send, ServerFrame, Tick, Wake, WakeAt


class Clock:
    """Logical time of one robot. Mutable: the number of the next tick, and when everyone was heard of.

    `servers` are expected to answer each tick, `clients` (address to server) to send a request a frame.
    """

    address = topics.CLOCK

    def __init__(
        self,
        *,
        frame_ns: int,
        servers: tuple[str, ...],
        clients: tuple[tuple[str, str], ...],
        lease_ns: int,
        keep: int,
    ) -> None:
        self._frame_ns = frame_ns
        self._names = (servers, tuple(address for address, _ in clients))
        self._lease_ns = lease_ns
        self._keep = keep
        self._k = 0
        self._start_ns = 0
        self._kept: dict[int, Tick] = {}
        request_topics = sorted({topics.requests(server) for _, server in clients})
        self.listens = (
            topics.fetches(self.address),
            *(topics.frames(s) for s in servers),
            *request_topics,
        )

    def start(self, now_ns: int) -> Iterable[Effect]:
        servers, clients = self._names
        self._servers = Liveness(servers, lease_ns=self._lease_ns, now_ns=now_ns)
        self._clients = Liveness(clients, lease_ns=self._lease_ns, now_ns=now_ns)
        self._start_ns = now_ns
        return (WakeAt(now_ns),)

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        match message:
            case Wake():
                return self._tick(now_ns)
            case ServerFrame():
                self._servers.heard(message.server, now_ns)
            case Request():
                self._clients.heard(topics.client_address(message.actuator, message.client), now_ns)
            case Fetch():
                tick = self._kept.get(message.k)
                return () if tick is None else (Send(topics.TICKS, tick),)
            case _:
                pass
        return ()

    def close(self) -> None:
        """It holds nothing."""

    def _tick(self, now_ns: int) -> Iterable[Effect]:
        due = self._start_ns + self._k * self._frame_ns
        if now_ns < due:
            return (WakeAt(due),)
        tick = Tick(
            k=self._k,
            t_ns=due,
            down=self._servers.missing(now_ns),
            lost=self._clients.missing(now_ns),
        )
        self._kept[tick.k] = tick
        self._kept.pop(tick.k - self._keep, None)
        self._k += 1
        return (Send(topics.TICKS, tick), WakeAt(due + self._frame_ns))
