"""A robot with its program, its servers and its scripts in one loop, for runs by the thousand.

The loop consists of the parts of the real servers (`runtime/servers`), without messages, connections or a
store. A frame is the same as among the real servers in virtual time (`virtual.py`), in one fixed order: the
servers publish; the network decides and its commands are carried out; cameras grab when due; scripts that are
due resume; the world advances to the next frame. The network therefore reads what a script, or the network
itself, sets in a frame in the next one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import msgspec

from colony.ir.frame import Executor, Frame, Outcome, Reading
from colony.ir.program import Robot
from colony.ir.types import Value
from colony.runtime.frames.publishing import Fields
from colony.runtime.kit.script import Script
from colony.runtime.kit.script_local import LocalScripts, LocalServer
from colony.runtime.library.ask import Ask
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.calls import CallId
from colony.runtime.protocol.deployment import actuator_table, variables_read
from colony.runtime.protocol.fields import DSERVER, PSERVER, RSERVER, RUNTIME
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.base import Base
from colony.runtime.servers.base_actuator import speeds_of
from colony.runtime.servers.cserver import Camera
from colony.runtime.servers.data_methods import DataMethods, command
from colony.runtime.servers.drivers import CameraDriver, Drivers
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.runtime_server import random_of_frame
from colony.runtime.servers.semaphores import Semaphores
from colony.runtime.servers.variables import Variables
from colony.runtime.store.store import Journal, MemoryStore
from colony.runtime.transport.virtual import VirtualClock

Watch = Callable[[Frame, Outcome], None]
"""A function that takes every frame and its outcome, both in base units, before anything moves."""


class _NullJournal(Journal):
    """A journal that keeps nothing, because nothing loads it."""

    def __init__(self) -> None:
        super().__init__(MemoryStore())

    def put(self, key: object, data: bytes) -> None:
        """Keep nothing."""

    def drop(self, key: object) -> None:
        """Do nothing: nothing is kept."""


class LocalData(LocalServer):
    """The variables and semaphores of DServer, called in this process. Mutable: both.

    Args:
        reads: the variables in frames, which the network reads.
    """

    def __init__(self, reads: Iterable[str] = ()) -> None:
        journal = _NullJournal()
        self.variables = Variables(journal)
        self.variables.read_by_program(reads)
        self.variables.show(reads)
        self.semaphores = Semaphores(journal)
        methods = DataMethods(self.variables, self.semaphores)
        self.expire = methods.expire
        super().__init__(DSERVER.name, methods.methods, methods.answers)

    def present(self, name: str) -> Any:
        """Return the present value of a variable, None if it has none."""
        found = self.variables.present(name)
        return None if found is None else msgspec.msgpack.decode(found.data)


class LocalCamera(LocalServer):
    """A camera server, called in this process. Mutable: the camera's image, its lock, the period."""

    def __init__(self, address: str, driver: CameraDriver) -> None:
        camera = Camera(address, driver)
        self.poll = camera.poll
        super().__init__(address, camera.methods, camera.answers)

    def do(self, call_id: CallId, ask: Ask[Any], now_ns: int) -> Any:
        """Return the result of a call; a lock that it released takes effect at once."""
        result = super().do(call_id, ask, now_ns)
        self.poll(now_ns)
        return result


class Loop:
    """A robot in one loop. Mutable: the servers and scripts, the network's memory, the time.

    Args:
        robot: sensors and actuators, as declared.
        executor: executor of the program in base units (`ir.program.robot_in_base_units`).
        drivers: devices, which read time from `clock`.
        scripts: scripts by name, in the order in which they run at one time.
        clock: time, which the loop advances.
        advance: function that advances the world to the next frame, called with the clock already there.
        seed: seed of `Runtime.random`.
        variables: DServer's variables, kept as fresh as each frame, in declared units.
        watch: callback for every frame and its outcome.

    Raises:
        DiagnosticError: a sensor or actuator is bound to something that no server offers.
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
    ) -> None:
        self._clock, self._advance = clock, advance
        bindings = bind(robot)
        self.base, proximity = Base(drivers.base), PServer(drivers.proximity, keep=1)
        self.data = LocalData(variables_read(bindings))
        self.data.variables.hold(variables or {})
        self._cameras = tuple(LocalCamera(name, driver) for name, driver in drivers.cameras.items())
        sensing = (LocalServer(RSERVER.name, self.base.methods), LocalServer(PSERVER.name, proximity.methods))
        self.scripts = LocalScripts(scripts, (self.data, *sensing, *self._cameras))
        self._watch = watch
        self._executor = executor
        self._frame_ns = robot.frame_ns
        self._sensors = sensors = bindings.sensors
        self._rings = {
            b.field: {"sonar": proximity.sonar, "infrared": proximity.infrared}[b.field]
            for b in sensors
            if b.server == PSERVER.name
        }
        servers: dict[str, Callable[[int], Fields]] = {
            RSERVER.name: self.base.fields,
            PSERVER.name: lambda now_ns: {field: ring() for field, ring in self._rings.items()},
            DSERVER.name: self.data.variables.fields,
            RUNTIME.name: lambda now_ns: {"random": Sample(random_of_frame(seed, self.k), now_ns)},
        }
        self._publish = {b.server: servers[b.server] for b in sensors}
        acts = tuple(
            actuator_table(actuator, binding, ())
            for actuator, binding in zip(robot.actuators, bindings.actuators, strict=True)
        )
        self._drives = tuple((i, act) for i, act in enumerate(acts) if act.server == RSERVER.name)
        self._sets = tuple((i, act) for i, act in enumerate(acts) if act.server == DSERVER.name)
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
        decisions = outcome.decisions
        for i, act in self._sets:
            values = decisions[i].values
            if values is not None:
                command(self.data.variables, act, values, now_ns)
        for i, act in self._drives:
            values = decisions[i].values
            if values is not None:
                self.base.drive(speeds_of(act, values))
        self.data.expire(now_ns)
        for camera in self._cameras:
            camera.poll(now_ns)
        self.scripts.run(now_ns)
        self.k += 1
        self._clock.now_ns = now_ns + self._frame_ns
        self._advance()

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
        return readings
