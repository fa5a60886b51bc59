"""One robot with its program, its servers and its scripts in one loop: frame after frame in lockstep.

A frame is what it is among the real servers in virtual time (`runtime/assembly/virtual.py`), in one fixed
order: the servers publish; the network decides on that, its commands are carried out; cameras grab when it is
time; scripts go on whose time has come; the world moves on to the next frame. So what a script sets in a
frame the network reads in the next one, and what the network sets, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

from colony.experiment.behavior import Behavior
from colony.experiment.local_cameras import LocalCamera
from colony.experiment.local_scripts import LocalScripts
from colony.experiment.local_servers import LocalBase, LocalData, LocalProximity, LocalServer
from colony.ir.frame import Frame, Outcome, Reading
from colony.ir.types import ScalarValue, Value
from colony.runtime.kit.script import Script
from colony.runtime.protocol.bindings import ActuatorBinding, SensorBinding
from colony.runtime.protocol.deployment import variables_read
from colony.runtime.protocol.fields import DSERVER, PSERVER, RSERVER, RUNTIME
from colony.runtime.servers.runtime_server import random_of_frame
from colony.sim.world.world import World

_Decided = tuple[tuple[str, str | None, tuple[ScalarValue, ...] | None, str | None], ...]
"""A `Decision` an actuator, as generated code gives it."""

Watch = Callable[[Frame, Outcome], None]
"""Is shown every frame, after the network has decided and before anything moves."""


class _Sense(NamedTuple):
    sensor: str
    field: str
    factor: float
    within_ns: int | None


class _Act(NamedTuple):
    """`number` is the actuator's place; `factors` lead from declared to base units."""

    binding: ActuatorBinding
    number: int
    factors: tuple[float, ...]


class Loop:
    """Mutable: the world, the servers and scripts, the network's memory, the time.

    Args:
        behavior: what decides.
        world: with the robot as its number 0.
        scripts: by name, in the order in which they run in a moment.
        cameras: the camera servers.
        seed: of `Runtime.random`.
        variables: of DServer, held as fresh as each frame, in declared units.
        watch: is shown every frame.
        moving: are told of the seconds of each step of the world, after it, as by `colony.sim.drivers.Plant`.
    """

    def __init__(
        self,
        behavior: Behavior,
        world: World,
        scripts: Mapping[str, Script],
        *,
        cameras: Iterable[LocalCamera] = (),
        seed: int = 0,
        variables: Mapping[str, Value] | None = None,
        watch: Watch | None = None,
        moving: Sequence[Callable[[float], None]] = (),
    ) -> None:
        self.world = world
        self._moving = tuple(moving)
        self.base, self.proximity = LocalBase(world), LocalProximity(world)
        self.data = LocalData(variables_read(behavior.bindings))
        self.data.variables.hold(variables or {})
        self._cameras = tuple(cameras)
        servers: tuple[LocalServer, ...] = (self.data, self.base, self.proximity, *self._cameras)
        self.scripts = LocalScripts(scripts, servers)
        self._seed = seed
        self._watch = watch
        self._executor = behavior.executor()
        self._frame_ns = behavior.program.robot.frame_ns
        self._frame_s = self._frame_ns / 1e9
        self._sensors = {
            server: tuple(_sense(b) for b in behavior.bindings.sensors if b.server == server)
            for server in (PSERVER.name, RSERVER.name, DSERVER.name, RUNTIME.name)
        }
        acts = [
            _Act(binding, number, tuple(field.factor for field in actuator.fields))
            for number, (actuator, binding) in enumerate(
                zip(behavior.program.robot.actuators, behavior.bindings.actuators, strict=True)
            )
        ]
        self._drives = tuple(act for act in acts if act.binding.server == RSERVER.name)
        self._sets = tuple(act for act in acts if act.binding.server == DSERVER.name)
        self.k = 0
        self.now_ns = 0

    def frame(self) -> None:
        """One frame, and on to the beginning of the next.

        Raises:
            ScriptFailed: a script raised.
        """
        now_ns = self.now_ns
        frame = Frame(now_ns, self._readings(now_ns))
        outcome = self._decide(frame)
        for act in self._sets:
            values = outcome[act.number][2]
            if values is not None:
                self.data.command(act.binding.command, values, now_ns)
        for act in self._drives:
            values = outcome[act.number][2]
            if values is not None:
                self.base.drive(*_speeds(act, values))
        self.data.expire(now_ns)
        for camera in self._cameras:
            camera.tend(now_ns)
        self.scripts.run(now_ns)
        self.world.advance(self._frame_s)
        for move in self._moving:
            move(self._frame_s)
        self.k += 1
        self.now_ns = now_ns + self._frame_ns

    def close(self) -> None:
        """Stop the robot and end all scripts."""
        self.base.stop()
        self.scripts.close()

    def _decide(self, frame: Frame) -> _Decided:
        if self._watch is not None:
            outcome = self._executor.step(frame)
            self._watch(frame, outcome)
            return outcome.decisions
        decisions: _Decided = self._executor.program.step(frame.t_ns, frame.readings)[0]
        return decisions

    def _readings(self, now_ns: int) -> dict[str, Reading]:
        readings: dict[str, Reading] = {}
        base = self.base.fields(now_ns)
        for sensor, field, factor, _ in self._sensors[RSERVER.name]:
            readings[sensor] = _in_unit(base[field], factor)
        for sensor, field, factor, _ in self._sensors[PSERVER.name]:
            ring: Value = self.proximity.sonar() if field == "sonar" else self.proximity.infrared()
            readings[sensor] = _in_unit(ring, factor)
        held = self.data.fields(now_ns)
        for sensor, field, factor, within_ns in self._sensors[DSERVER.name]:
            sample = held.get(field)
            if sample is not None and (within_ns is None or now_ns - sample.t_ns <= within_ns):
                readings[sensor] = _in_unit(sample.value, factor)
        for sensor, _, factor, _ in self._sensors[RUNTIME.name]:
            readings[sensor] = random_of_frame(self._seed, self.k) / factor
        return readings


def _sense(binding: SensorBinding) -> _Sense:
    factor = 1.0 if binding.declared else binding.factor
    return _Sense(binding.sensor, binding.field, factor, binding.within_ns)


def _in_unit(value: Value, factor: float) -> Value:
    if factor == 1.0:
        return value
    return tuple(v / factor for v in value) if isinstance(value, tuple) else value / factor


def _speeds(act: _Act, values: tuple[ScalarValue, ...]) -> tuple[float, float]:
    """The base's speeds in base units; a field that the actuator does not have is 0."""
    velocity, turn = (0.0 if i is None else float(values[i]) * act.factors[i] for i in act.binding.places)
    return velocity, turn
