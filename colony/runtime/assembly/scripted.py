"""A robot in virtual time that can run any program, on scripted sensors.

DServer, clients, announcers and observer are the real ones; two servers publish given readings, and one takes
all commands. Unlike real servers, these serve the sensors and actuators of every program, with any readings,
valid or invalid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import NamedTuple

from colony.execute.compiled import Compiled
from colony.ir.frame import Reading
from colony.ir.program import Robot, in_declared_units
from colony.ir.servers import DSERVER
from colony.ir.types import ScalarValue
from colony.runtime.arbitration.arbiter import Dispatch, timing
from colony.runtime.assembly.virtual import Builders, VirtualRobot
from colony.runtime.frames.publishing import Fields, Publisher
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import ActuatorBinding, Bindings, SensorBinding
from colony.runtime.protocol.deployment import ActuatorSpec, Deployment, actuators_of, reported_fields
from colony.runtime.protocol.messages import (
    Effect,
    Fetch,
    Message,
    Node,
    QuietNode,
    Request,
    Sample,
    Tick,
    Wake,
)
from colony.runtime.servers.commanding import CommandDispatcher
from colony.runtime.servers.dserver import DServer
from colony.runtime.store.store import MemoryStore
from colony.runtime.transport.exchange import Link, deliver_immediately
from colony.runtime.transport.virtual import VirtualClock

SENSOR_SERVERS = ("Sensors0", "Sensors1")
ACTUATOR_SERVER = "Actuators"
SCRIPTED_SERVERS = (*SENSOR_SERVERS, ACTUATOR_SERVER)

Readings = Callable[[Tick], Mapping[str, Reading]]
"""A function that returns the readings of the sensors in the frame of a tick."""


class SentCommand(NamedTuple):
    """A command as sent to an actuator, in declared units; `by` is None for the idle command."""

    k: int
    actuator: str
    by: str | None
    values: tuple[ScalarValue, ...] | None
    fault: str | None


class SensorServer(QuietNode):
    """A server that publishes given readings of some sensors."""

    def __init__(self, address: str, readings: Readings, names: tuple[str, ...], frames_kept: int) -> None:
        self.address = address
        self._readings = readings
        self._names = names
        self._publisher = Publisher(address, self._read, frames_kept=frames_kept)
        self.listens = self._publisher.listens

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Publish the readings on a tick or a fetch."""
        if isinstance(message, (Tick, Fetch)):
            yield from self._publisher.handle(message)

    def _read(self, tick: Tick) -> Fields:
        readings, fields = self._readings(tick), {}
        for name in self._names:
            value = readings.get(name)
            if value is not None:
                fields[name] = Sample(value, tick.t_ns)  # type: ignore[arg-type]  # may be an invalid value
        return fields


class ActuatorServer(QuietNode):
    """A server that takes the commands of every actuator, arbitrates, and records the results in `sent`."""

    address = ACTUATOR_SERVER

    def __init__(
        self, deployed: Deployment, readings: Readings, frames_kept: int, sent: list[SentCommand]
    ) -> None:
        self._run = deployed.run
        self._readings = readings
        self._publisher = Publisher(ACTUATOR_SERVER, self._read, frames_kept=frames_kept)
        commanded = actuators_of(deployed, ACTUATOR_SERVER)
        self._fields = {name: field for spec in commanded for name, field in reported_fields(spec).items()}
        self._commands = CommandDispatcher(
            commanded, timing(deployed.frame_ns), lambda *_: None, on_dispatch=self._on_dispatch
        )
        self._sent = sent
        self._given: set[str] = set()  # what is known of this epoch, of `reported`
        self.listens = (*self._publisher.listens, topics.requests(ACTUATOR_SERVER))

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Arbitrate the requests of each frame."""
        match message:
            case Tick():
                yield from self._commands.end_before(message, now_ns)
                yield from self._publisher.handle(message)
                if message.run == self._run:
                    yield from self._commands.tick(message, now_ns)
                else:
                    yield from self._commands.finish(now_ns)
            case Fetch():
                yield from self._publisher.handle(message)
            case Request():
                yield from self._commands.request(message, now_ns)
            case Wake():
                yield from self._commands.wake(now_ns)
            case _:
                pass

    def _read(self, tick: Tick) -> Fields:
        """Return what the actuators were given last, in declared units, unless the readings say otherwise.

        With the epoch, what they were given begins anew.
        """
        readings, sent = self._readings(tick), self._commands.fields(tick)
        if tick.k == tick.start:
            self._given.clear()
        fields: dict[str, Sample | None] = {}
        for name, spec in self._fields.items():
            sample = sent.get(name) if name in self._given else None
            if name in readings:
                value = readings[name]
                fields[name] = None if value is None else Sample(value, tick.t_ns)  # type: ignore[arg-type]
            elif sample is not None and spec is None:
                fields[name] = sample
            elif sample is not None:
                declared = in_declared_units((sample.value,), (spec,))  # type: ignore[arg-type]
                fields[name] = Sample(declared[0], tick.t_ns)  # type: ignore[index]
        return fields

    def _on_dispatch(self, actuator: ActuatorSpec, dispatch: Dispatch, now_ns: int) -> None:
        values = in_declared_units(dispatch.values, actuator.fields)
        known = reported_fields(actuator).items()
        self._given.update(name for name, field in known if field is None or values is not None)
        self._sent.append(SentCommand(dispatch.k, actuator.name, dispatch.by, values, dispatch.fault))


ActuatorServerBuilder = Callable[[Deployment, Readings, int, list[SentCommand]], ActuatorServer]
"""A function that builds an `ActuatorServer`, with its arguments."""


class FrameCollector:
    """A sink that collects the frames in `frames`. Mutable."""

    def __init__(self) -> None:
        self.frames: list[RunFrame] = []

    def take(self, log: RunFrame) -> None:
        """Add a frame."""
        self.frames.append(log)

    def close(self) -> None:
        """Do nothing: the sink holds no resources."""


class ScriptedRobot(VirtualRobot):
    """A robot that can run any program, on scripted sensors. Mutable: `sent` and `log` grow during the run.

    Args:
        compiled: the program to run.
        readings: function that returns the readings of the sensors in the frame of a tick.
        clock: as in `VirtualRobot`.
        seed: as in `VirtualRobot`.
        ticking: as in `VirtualRobot`.
        link: as in `VirtualRobot`.
        isolate: as in `VirtualRobot`.
        actuator_server: builds the server of the actuators.

    Raises:
        DiagnosticError: a Python module cannot be imported or built.
    """

    def __init__(
        self,
        compiled: Compiled,
        readings: Readings,
        *,
        clock: VirtualClock,
        seed: int = 0,
        ticking: bool = True,
        link: Link = deliver_immediately,
        isolate: bool = False,
        actuator_server: ActuatorServerBuilder = ActuatorServer,
    ) -> None:
        self.sent: list[SentCommand] = []
        self.log = FrameCollector()
        bindings, store = scripted_bindings(compiled.robot), MemoryStore()

        def servers(deployed: Deployment, frames_kept: int) -> Builders:
            builders: dict[str, Callable[[], Node]] = {
                ACTUATOR_SERVER: lambda: actuator_server(deployed, readings, frames_kept, self.sent),
                DSERVER.name: lambda: DServer(deployment=deployed, frames_kept=frames_kept, store=store),
            }
            for server in SENSOR_SERVERS:
                names = tuple(b.sensor for b in bindings.sensors if b.server == server)
                builders[server] = partial(SensorServer, server, readings, names, frames_kept)
            return builders

        sinks = (self.log,)
        super().__init__(
            compiled,
            bindings,
            servers,
            clock=clock,
            seed=seed,
            sinks=sinks,
            ticking=ticking,
            link=link,
            isolate=isolate,
        )


def scripted_bindings(robot: Robot) -> Bindings:
    """Return bindings that assign sensors to the servers in turn, in their declared units."""
    return Bindings(
        sensors=tuple(
            SensorBinding(
                sensor=s.name,
                server=ACTUATOR_SERVER if s.sent else SENSOR_SERVERS[i % len(SENSOR_SERVERS)],
                field=s.name,
                max_age_ns=None,
                factor=s.factor,
                declared=True,
                sent=s.sent is not None,
            )
            for i, s in enumerate(robot.sensors)
        ),
        actuators=tuple(
            ActuatorBinding(actuator=a.name, server=ACTUATOR_SERVER, command=a.name, field_indices=())
            for a in robot.actuators
        ),
    )
