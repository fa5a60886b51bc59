"""A robot with its program, servers and scripts in one loop, fast enough for thousands of runs.

The loop consists of the parts of the real servers (`runtime/servers`), without messages, connections or a
store. Each frame has the same steps as with the real servers in virtual time (`virtual.py`), in a fixed
order: the servers publish; the network decides and its commands are carried out; cameras grab when due;
scripts that are due resume; the world advances to the next frame. A value that the network or a script sets
is therefore read by the network in the next frame. Scripts do not command the base here: only the network
does, within its limits.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from typing import Any

import msgspec

from colony.ir.frame import Executor, Frame, Outcome, Reading
from colony.ir.program import TUNABLE_SERVER, Robot, Role
from colony.ir.servers import DSERVER, PROXIMITY, RSERVER, RUNTIME
from colony.ir.types import ScalarValue, Value
from colony.runtime.frames.publishing import Fields
from colony.runtime.kit.commands import CommandPerformer
from colony.runtime.kit.devices import DeviceReader, device_commands
from colony.runtime.kit.errors import CallRefusedError, ServerNotFoundError
from colony.runtime.kit.once import Report
from colony.runtime.kit.script import Do, RunningScript, Script, ScriptScheduler
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.clock import Tune
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.calls import LATER, CallId, Handler, Method, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import actuator_spec, tunables_of, tuned_with, variables_read
from colony.runtime.protocol.messages import Sample
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.servers.base import Base
from colony.runtime.servers.commanding import NotSentError
from colony.runtime.servers.cserver import SharedCamera
from colony.runtime.servers.data_methods import DataMethods, set_commanded_variable
from colony.runtime.servers.drivers import CameraDriver, Drivers
from colony.runtime.servers.piloting import speeds_of, values_of
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.runtime_server import random_of_frame
from colony.runtime.servers.semaphores import Semaphores
from colony.runtime.servers.variables import Variables
from colony.runtime.store.store import Journal, MemoryStore
from colony.runtime.transport.virtual import VirtualClock

Watch = Callable[[Frame, Outcome], None]
"""A function that takes every frame and its outcome, in base units, before commands are carried out."""


class _NullJournal(Journal):
    """A journal that keeps nothing, because no store is ever loaded."""

    def __init__(self) -> None:
        super().__init__(MemoryStore())

    def put(self, key: object, data: bytes) -> None:
        """Keep nothing."""

    def drop(self, key: object) -> None:
        """Do nothing: nothing is kept."""


class LocalServer:
    """A server that is called in this process, without messages or connections. Mutable.

    `handlers` are its methods by name.

    Args:
        address: the name of the server.
        methods: all methods of the server.
        answers: results, or refusals, of calls that returned `LATER`; the scripts' runner empties the list.
    """

    def __init__(
        self,
        address: str,
        methods: Iterable[Method],
        answers: list[tuple[CallId, object]] | None = None,
    ) -> None:
        self.address = address
        self.answers = [] if answers is None else answers
        self.handlers: Mapping[str, Handler] = {m.name: m.handler for m in methods}

    def do(self, call_id: CallId, call: CallRequest[Any], now_ns: int) -> Any:
        """Return the result of a call, or `LATER` if the call has to wait.

        Raises:
            RefusedError: the server refuses the call.
        """
        handler = self.handlers.get(call.method)
        if handler is None:
            available = ", ".join(sorted(self.handlers))
            raise RefusedError(
                "method", f"{self.address} has no method `{call.method}` here; expected {available}"
            )
        result = handler(call_id, call.arguments, now_ns)
        if isinstance(result, msgspec.Raw):
            return _decoder(call.reply).decode(result)
        if isinstance(result, dict):
            decode = _decoder(Any).decode
            return {name: decode(value) for name, value in result.items()}
        return result


@lru_cache(maxsize=64)
def _decoder(reply: Any) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(reply)


class LocalScripts(ScriptScheduler):
    """Scripts whose calls go directly to the methods of servers. Mutable.

    A script that waits for a semaphore resumes as soon as it is signaled, after those that are ready already.

    Args:
        scripts: the scripts by name, in the order in which they run at one instant.
        servers: the servers that they may call.
    """

    def __init__(self, scripts: Mapping[str, Script], servers: Iterable[LocalServer]) -> None:
        super().__init__(scripts, self._do, self._take_answers)
        self._servers = {server.address: server for server in servers}
        self._callers = {name: Caller(f"local/{name}", name, 0, "local") for name in scripts}
        self._calls = itertools.count(1)
        self._waiting: dict[CallId, RunningScript] = {}

    def _do(self, running: RunningScript, step: Do, now_ns: int) -> Any:
        server = self._servers.get(step.server)
        if server is None:
            available = ", ".join(self._servers)
            raise ServerNotFoundError(f"there is no server `{step.server}` in this run; it has {available}")
        call_id = CallId(self._callers[running.name], next(self._calls))
        try:
            result = server.do(call_id, step.call, now_ns)
        except RefusedError as refused:
            raise _call_refused(refused) from None
        if result is LATER:
            self._waiting[call_id] = running
        return result

    def _take_answers(self) -> None:
        """Make the waiting scripts ready whose answers have arrived."""
        if not self._waiting:
            return
        for server in self._servers.values():
            for call_id, result in server.answers:
                refused = _call_refused(result) if isinstance(result, RefusedError) else None
                self.answer(self._waiting.pop(call_id), None, refused)
            server.answers.clear()


def _call_refused(refused: RefusedError) -> CallRefusedError:
    return CallRefusedError(refused.problem.code, refused.problem.message)


class LocalData(LocalServer):
    """The variables and semaphores of DServer, called in this process. Mutable.

    Args:
        network_variables: variables that the network reads, and which are therefore in frames.
    """

    def __init__(self, network_variables: Iterable[str] = ()) -> None:
        journal = _NullJournal()
        self.variables = Variables(journal)
        self.variables.set_program_names(network_variables)
        self.variables.show(network_variables)
        self.semaphores = Semaphores(journal)
        methods = DataMethods(self.variables, self.semaphores)
        self.expire = methods.expire
        super().__init__(DSERVER.name, methods.methods, methods.answers)

    def value(self, name: str) -> Any:
        """Return the current value of a variable, None if it has none."""
        variable = self.variables.current(name)
        return None if variable is None else msgspec.msgpack.decode(variable.data)


class LocalCamera(LocalServer):
    """A camera server, called in this process. Mutable."""

    def __init__(self, address: str, driver: CameraDriver) -> None:
        camera = SharedCamera(address, driver)
        self.poll = camera.poll
        super().__init__(address, camera.methods, camera.answers)

    def do(self, call_id: CallId, ask: CallRequest[Any], now_ns: int) -> Any:
        """Return the result of a call; a lock that it released takes effect at once."""
        result = super().do(call_id, ask, now_ns)
        self.poll(now_ns)
        return result


class Loop:
    """A robot in one loop. Mutable.

    Args:
        robot: sensors and actuators, as declared.
        executor: executor of the program in base units (`ir.program.robot_in_base_units`).
        drivers: device drivers, which read the time from `clock`.
        scripts: scripts by name; those due at the same time run in this order.
        clock: time, which the loop advances.
        advance: function that advances the world to the next frame, called after the clock has advanced.
        seed: seed of `Runtime.random`.
        variables: DServer's variables that stay fresh in every frame, in declared units.
        watch: callback for every frame and its outcome.
        report: takes each problem of a device, the first time that it occurs.

    Raises:
        DiagnosticError: a sensor or actuator is bound to something that no server offers.
        ValueError: the robot has no base.
    """

    def __init__(
        self,
        robot: Robot,
        executor: Executor,
        drivers: Drivers,
        scripts: Mapping[str, Script],
        *,
        clock: VirtualClock,
        advance: Callable[[], object],
        seed: int = 0,
        variables: Mapping[str, Value] | None = None,
        watch: Watch | None = None,
        report: Report = lambda problem: None,
    ) -> None:
        self._clock, self._advance = clock, advance
        bindings = bind(robot, drivers.servers)
        if drivers.base is None:
            raise ValueError("the loop is for robots with a base")
        self.base = Base(drivers.base)
        proximity = None if drivers.proximity is None else PServer(drivers.proximity, frames_kept=1)
        self.data = LocalData(variables_read(bindings))
        self.data.variables.pin(variables or {})
        self._cameras = tuple(LocalCamera(name, driver) for name, driver in drivers.cameras.items())
        sensor_servers = [LocalServer(RSERVER.name, self.base.methods)]
        if proximity is not None:
            sensor_servers.append(LocalServer(PROXIMITY, proximity.methods))
        clock_server = LocalServer(CLOCK, (method("tune", Tune, self._tune),))
        self.scripts = LocalScripts(scripts, (self.data, *sensor_servers, *self._cameras, clock_server))
        self._watch = watch
        self._executor = executor
        self._frame_ns = robot.frame_ns
        self._sensors = sensors = tuple(b for b in bindings.sensors if not b.sent)
        sent = {s.name: s.sent for s in robot.sensors if s.sent is not None}
        places = {a.name: i for i, a in enumerate(robot.actuators)}
        self._sent = tuple(
            (b, places[sent[b.sensor].actuator], sent[b.sensor].of) for b in bindings.sensors if b.sent
        )
        self._given: dict[str, Reading] = {}
        self._tuned: dict[str, float] = {}
        self._tunables = tunables_of(robot)
        rings = {} if proximity is None else {"sonar": proximity.sonar, "infrared": proximity.infrared}
        self._rings = {b.field: rings[b.field] for b in sensors if b.server == PROXIMITY}
        specs = {spec.name: spec for spec in drivers.servers}
        readers = {
            name: DeviceReader(specs[name], driver, report) for name, driver in drivers.devices.items()
        }
        servers: dict[str, Callable[[int], Fields]] = {
            RSERVER.name: self.base.fields,
            PROXIMITY: lambda now_ns: {field: ring() for field, ring in self._rings.items()},
            DSERVER.name: self.data.variables.fields,
            **{name: reader.read for name, reader in readers.items()},
            TUNABLE_SERVER: lambda now_ns: {name: Sample(x, now_ns) for name, x in self._tuned.items()},
            RUNTIME.name: lambda now_ns: {"random": Sample(random_of_frame(seed, self.k), now_ns)},
        }
        self._publish = {b.server: servers[b.server] for b in sensors}
        actuators = tuple(
            actuator_spec(actuator, binding, ())
            for actuator, binding in zip(robot.actuators, bindings.actuators, strict=True)
        )
        self._base_actuators = tuple((i, a) for i, a in enumerate(actuators) if a.server == RSERVER.name)
        self._variable_actuators = tuple((i, a) for i, a in enumerate(actuators) if a.server == DSERVER.name)
        performers = {
            name: CommandPerformer(name, device_commands(specs[name], driver), report)
            for name, driver in drivers.devices.items()
        }
        self._device_actuators = tuple(
            (i, a, performers[a.server]) for i, a in enumerate(actuators) if a.server in performers
        )
        self.k = 0

    @property
    def now_ns(self) -> int:
        """The time of the next frame."""
        return self._clock.now_ns

    def frame(self) -> None:
        """Run one frame, and advance to the beginning of the next.

        Raises:
            ScriptError: a script raised an exception.
        """
        now_ns = self._clock.now_ns
        frame = Frame(now_ns, self._readings(now_ns))
        outcome = self._executor.step(frame)
        if self._watch is not None:
            self._watch(frame, outcome)
        self._command([decision.values for decision in outcome.decisions], now_ns)
        self.data.expire(now_ns)
        for camera in self._cameras:
            camera.poll(now_ns)
        self.scripts.run(now_ns)
        self.k += 1
        self._clock.now_ns = now_ns + self._frame_ns
        self._advance()

    def _command(self, commands: list[tuple[ScalarValue, ...] | None], now_ns: int) -> None:
        """Carry out the commands of a frame, by actuator; the next frame reads what was sent of them."""
        refused = set[int]()
        for i, actuator in self._variable_actuators:
            values = commands[i]
            if values is not None:
                set_commanded_variable(self.data.variables, actuator, values, now_ns)
        for i, actuator in self._base_actuators:
            values = commands[i]
            if values is not None:
                speeds = speeds_of(actuator, values)
                if self.base.drive(speeds, now_ns) is not None:  # a bumper blocks the velocity
                    commands[i] = values_of(actuator, speeds._replace(velocity=0.0))
        for i, actuator, performer in self._device_actuators:
            values = commands[i]
            if values is not None:
                try:
                    performer.perform(actuator, values, stale=False)
                except NotSentError as problem:  # it has been reported, and the idle command was performed
                    commands[i] = problem.instead
                    refused.add(i)
        for binding, place, of in self._sent:
            command = commands[place]
            if isinstance(of, Role):
                self._given.pop(binding.sensor, None)  # the executor knows it
                if of.kind == "by" and place in refused:
                    self._given[binding.sensor] = False
            elif command is not None:
                self._given[binding.sensor] = binding.in_base_units(command[of])

    def _tune(self, call_id: CallId, arguments: Tune, now_ns: int) -> int:
        """Change tunable params from the next frame on."""
        self._tuned = tuned_with(self._tunables, self._tuned, arguments.values)
        return self.k + 1

    def close(self) -> None:
        """Stop the robot and end all scripts."""
        self.base.stop()
        self.scripts.close()

    def _readings(self, now_ns: int) -> dict[str, Reading]:
        self.base.refresh()
        published = {server: publish(now_ns) for server, publish in self._publish.items()}
        readings: dict[str, Reading] = {}
        for binding in self._sensors:
            sample = published[binding.server].get(binding.field)
            if sample is not None and binding.is_fresh(sample.t_ns, now_ns):
                readings[binding.sensor] = binding.in_base_units(sample.value)
        return {**readings, **self._given}
