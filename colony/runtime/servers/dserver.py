"""DServer: the variables that the processes of a robot share (thesis section 4.6.1)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from colony.ir.types import ScalarValue, Value
from colony.runtime import topics
from colony.runtime.arbitration import Timing, declared_units
from colony.runtime.fields import DSERVER
from colony.runtime.messages import Announcement, Effect, Fetch, Message, Request, Sample, Tick, Wake
from colony.runtime.servers.commanding import CommandDesk, Commanded
from colony.runtime.servers.publishing import Fields, Publisher
from colony.runtime.servers.relaying import ActivityRelay


class DServer:
    """Publishes all variables each frame and sets those that actuators are bound to. Mutable: the variables.

    An actuator of one field sets its variable to the field's value, one of several fields to an array of
    them in the order declared, in declared units. What a command of frame k sets is read in frame k + 1.

    It also hands on the activity of the modules in Python that are `announced`.

    `held` are variables that somebody outside keeps setting: they are as fresh as each frame. A command that
    sets one of them replaces it.
    """

    address = DSERVER.name

    def __init__(
        self,
        held: Mapping[str, Value],
        commanded: tuple[Commanded, ...],
        *,
        announced: tuple[str, ...] = (),
        times: Timing,
        keep: int,
    ) -> None:
        self._held = dict(held)
        self._variables: dict[str, Sample] = {}
        self._publisher = Publisher(self.address, self._read, keep=keep)
        self._desk = CommandDesk(commanded, times, self._set)
        self._relay = ActivityRelay(self.address, announced, keep=keep)
        self.listens = (*self._publisher.listens, *self._relay.listens, topics.requests(self.address))

    def start(self, now_ns: int) -> Iterable[Effect]:
        return ()

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        match message:
            case Tick():
                yield from self._publisher.handle(message)
                yield from self._desk.tick(message, now_ns)
            case Fetch() if message.server == self.address:
                yield from self._publisher.handle(message)
            case Fetch():
                yield from self._relay.fetch(message)
            case Announcement():
                yield from self._relay.announce(message, now_ns)
            case Request():
                yield from self._desk.request(message, now_ns)
            case Wake():
                yield from self._desk.wake(now_ns)
            case _:
                return

    def close(self) -> None:
        """It holds nothing outside this process."""

    def _read(self, tick: Tick) -> Fields:
        return {name: Sample(value, tick.t_ns) for name, value in self._held.items()} | self._variables

    def _set(self, commanded: Commanded, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        declared = declared_units(commanded.actuator, values)
        assert declared is not None
        name = commanded.binding.command
        self._held.pop(name, None)
        self._variables[name] = Sample(declared[0] if len(declared) == 1 else declared, now_ns)
