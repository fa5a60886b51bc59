"""The servers of a robot within one process and one loop, for runs by the thousand.

What a script asks of them is answered at once, by the very parts of which the real servers consist
(variables, semaphores, the virtual position) but without messages, connections or a store. A call is answered
as the real server answers it, refusals included; what no client of the navigation asks for is refused with
the code "method". Everything happens at the times that the loop says (`loop.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache
from itertools import islice
from typing import Any, Protocol

import msgspec

from colony.ir.types import ScalarValue, Value
from colony.runtime.arbitration.motion import STILL, Speeds
from colony.runtime.library import data, proximity, robot
from colony.runtime.library.ask import Ask
from colony.runtime.protocol.calls import LATER, Asked, Later, Nothing, Refused
from colony.runtime.protocol.fields import DSERVER, PSERVER, RSERVER
from colony.runtime.servers.data_calls import several
from colony.runtime.servers.drivers import BaseState
from colony.runtime.servers.naming import named
from colony.runtime.servers.publishing import Fields
from colony.runtime.servers.semaphores import Semaphores, timed_out
from colony.runtime.servers.variables import Variables, encoded, prepared, unknown
from colony.runtime.servers.virtual_position import Odometer, OdometerPose
from colony.runtime.store.store import Journal, MemoryStore
from colony.sim.drivers import base_state
from colony.sim.world.world import World

Handler = Callable[[Asked, Any, Any, int], object]
"""From the call, its arguments, the type of its reply and the time to its result, or `LATER`."""


Granted = list[tuple[Asked, Refused | None]]
"""Calls that waited and are answered now: with a problem, or with nothing."""


class LocalServer(Protocol):
    """What answers calls in this process. Mutable: `granted`, which who runs the callers empties."""

    address: str
    handlers: Mapping[str, Handler]
    granted: Granted


def answer(server: LocalServer, asked: Asked, ask: Ask[Any], now_ns: int) -> object:
    """The result of a call, `LATER` where it has to wait.

    Raises:
        Refused: the server does not do it.
    """
    handler = server.handlers.get(ask.method)
    if handler is None:
        known = ", ".join(sorted(server.handlers))
        raise Refused("method", f"{server.address} has no method `{ask.method}` here; expected {known}")
    return handler(asked, ask.arguments, ask.reply, now_ns)


class _Forgetful(Journal):
    """A journal of what nobody will ever load."""

    def __init__(self) -> None:
        super().__init__(MemoryStore())

    def put(self, key: object, data: bytes) -> None:
        """Nothing is kept."""

    def drop(self, key: object) -> None:
        """Nothing was kept."""


class LocalData:
    """DServer's variables and semaphores. Mutable: those.

    Args:
        reads: the variables that `fields` has, which the network reads.
    """

    address: str = DSERVER.name

    def __init__(self, reads: Iterable[str] = ()) -> None:
        journal = _Forgetful()
        self.variables = Variables(journal)
        self.variables.read_by_program(reads)
        self.variables.show(reads)
        self.semaphores = Semaphores(journal)
        self.granted: Granted = []
        self._alarm: int | None = None
        self.handlers: Mapping[str, Handler] = {
            "set": self._set,
            "set_many": self._set_many,
            "get": self._get,
            "get_many": self._get_many,
            "history": self._history,
            "set_history": self._set_history,
            "create_semaphore": self._create_semaphore,
            "wait": self._wait,
            "signal": self._signal,
            "semaphore": self._semaphore,
        }

    def fields(self, now_ns: int) -> Fields:
        """What the network reads of the variables."""
        return self.variables.fields(now_ns)

    def present(self, name: str) -> object:
        """The present value of a variable, None where it has none."""
        found = self.variables.present(name)
        return None if found is None else _decoder(Any).decode(found.data)

    def command(self, name: str, values: tuple[ScalarValue, ...], now_ns: int) -> None:
        """What an actuator of the program sends: one field is a value, several are a list."""
        value: Value = values[0] if len(values) == 1 else values
        self.variables.put(prepared(name, encoded(value)), now_ns)

    def expire(self, now_ns: int) -> None:
        """Refuse those whose patience is at an end."""
        if self._alarm is not None and now_ns >= self._alarm:
            for waiter in self.semaphores.expire(now_ns):
                self.granted.append((waiter.asked, timed_out(waiter.name)))
            self._alarm = self.semaphores.wake_at

    def _set(self, asked: Asked, arguments: data.Set, reply: Any, now_ns: int) -> None:
        name = named(arguments.name)
        self.variables.set((prepared(name, arguments.value),), now_ns)

    def _set_many(self, asked: Asked, arguments: data.SetMany, reply: Any, now_ns: int) -> None:
        self.variables.set(several(arguments), now_ns)

    def _get(self, asked: Asked, arguments: data.Get, reply: Any, now_ns: int) -> object:
        found = self.variables.value(arguments.name, arguments.back)
        return _decoder(reply).decode(found.data)

    def _history(
        self, asked: Asked, arguments: data.History, reply: Any, now_ns: int
    ) -> tuple[data.Dated, ...]:
        found = islice(self.variables.history(arguments.name, arguments.back), arguments.limit)
        return tuple(data.Dated(t_ns=one.t_ns, value=msgspec.Raw(one.data)) for one in found)

    def _set_history(self, asked: Asked, arguments: data.SetHistory, reply: Any, now_ns: int) -> None:
        self.variables.set_history(named(arguments.name), arguments.length)

    def _get_many(self, asked: Asked, arguments: data.GetMany, reply: Any, now_ns: int) -> dict[str, object]:
        missing = [name for name in arguments.names if not self.variables.has(name)]
        if missing:
            raise unknown("`, `".join(missing[:10]))
        decode = _decoder(Any).decode
        return {name: decode(self.variables.value(name).data) for name in arguments.names}

    def _create_semaphore(
        self, asked: Asked, arguments: data.CreateSemaphore, reply: Any, now_ns: int
    ) -> bool:
        return self.semaphores.create(named(arguments.name), arguments.value)

    def _wait(self, asked: Asked, arguments: data.Wait, reply: Any, now_ns: int) -> Later | None:
        name, wait_ns = arguments.name, arguments.wait_ns
        waiter = self.semaphores.wait(asked, name, wait_ns, now_ns, hold=arguments.hold)
        if waiter is None:
            return None
        due = waiter.until_ns
        if due is not None and (self._alarm is None or due < self._alarm):
            self._alarm = due
        return LATER

    def _signal(self, asked: Asked, arguments: data.Named, reply: Any, now_ns: int) -> None:
        granted = self.semaphores.signal(arguments.name, asked.caller.connection)
        if granted is not None:
            self.granted.append((granted, None))

    def _semaphore(self, asked: Asked, arguments: data.Named, reply: Any, now_ns: int) -> data.SemaphoreState:
        return self.semaphores.state(arguments.name)


class LocalBase:
    """RServer over the base of a simulated robot. Mutable: the virtual position, and what was sent last."""

    address: str = RSERVER.name

    def __init__(self, world: World, robot_number: int = 0) -> None:
        self._world = world
        self._robot = robot_number
        self._odometer = Odometer(None)
        self._setting = STILL
        self.granted: Granted = []
        self.handlers: Mapping[str, Handler] = {
            "position": self._position,
            "adjust_position": self._adjust_position,
            "set_position": self._set_position,
            "bumper": self._bumper,
            "speed_setting": lambda *_: self._setting.velocity,
            "wheel_speed": lambda asked, arguments, reply, now_ns: self._state(now_ns).wheel_speed,
        }

    def fields(self, now_ns: int) -> dict[str, Value]:
        """What the network reads of the base, in base units."""
        state = self._state(now_ns)
        pose = self._odometer.observe(state)
        return {
            "bumper": state.front_bumper or state.rear_bumper,
            "front_bumper": state.front_bumper,
            "rear_bumper": state.rear_bumper,
            "x": pose.x,
            "y": pose.y,
            "heading": pose.heading,
            "speed": state.speed,
            "turn_rate": state.turn_rate,
            "wheel_speed": state.wheel_speed,
            "speed_setting": self._setting.velocity,
            "turn_setting": self._setting.turn,
        }

    def drive(self, velocity: float, turn: float) -> None:
        """Send a command, but not one that goes into a bumper that is pressed."""
        if velocity:
            bumper = self._world.bumper(self._robot)
            if bumper.front if velocity > 0.0 else bumper.rear:
                velocity = 0.0
        self._setting = Speeds(velocity, turn)
        self._world.command(self._robot, velocity, turn)

    def stop(self) -> None:
        """Stand: nobody commands."""
        self._setting = STILL
        self._world.command(self._robot, 0.0, 0.0)

    def believed(self, now_ns: int) -> OdometerPose:
        """The virtual position."""
        return self._odometer.observe(self._state(now_ns))

    def _state(self, now_ns: int) -> BaseState:
        return base_state(self._world, self._robot, now_ns)

    def _position(self, asked: Asked, arguments: Nothing, reply: Any, now_ns: int) -> robot.Position:
        pose = self.believed(now_ns)
        return robot.Position(x=pose.x, y=pose.y, heading=pose.heading, t_ns=now_ns)

    def _adjust_position(self, asked: Asked, arguments: robot.PoseArguments, reply: Any, now_ns: int) -> None:
        self._odometer.adjust(self._state(now_ns), _pose(arguments))

    def _set_position(self, asked: Asked, arguments: robot.PoseArguments, reply: Any, now_ns: int) -> None:
        self._odometer.set(self._state(now_ns), _pose(arguments))

    def _bumper(self, asked: Asked, arguments: Nothing, reply: Any, now_ns: int) -> robot.Bumpers:
        front, rear = self._world.bumper(self._robot)
        return robot.Bumpers(front=front, rear=rear)


class LocalProximity:
    """PServer over the rings of a simulated robot."""

    address: str = PSERVER.name

    def __init__(self, world: World, robot_number: int = 0) -> None:
        self._world = world
        self._robot = robot_number
        self.granted: Granted = []
        self.handlers: Mapping[str, Handler] = {"sonar": self._sonar, "infrared": self._infrared}

    def sonar(self) -> tuple[float, ...]:
        """24 ranges in mm."""
        return tuple(self._world.sonar(self._robot).tolist())

    def infrared(self) -> tuple[bool, ...]:
        """What the 24 detectors see."""
        return tuple(self._world.infrared(self._robot).tolist())

    def _sonar(self, asked: Asked, arguments: Nothing, reply: Any, now_ns: int) -> proximity.SonarReading:
        return proximity.SonarReading(t_ns=now_ns, ranges=self.sonar())

    def _infrared(
        self, asked: Asked, arguments: Nothing, reply: Any, now_ns: int
    ) -> proximity.InfraredReading:
        return proximity.InfraredReading(t_ns=now_ns, seen=self.infrared())


def _pose(arguments: robot.PoseArguments) -> OdometerPose:
    pose = OdometerPose(arguments.x, arguments.y, arguments.heading)
    if not all(map(math.isfinite, pose)):
        raise Refused("arguments", f"the pose is {tuple(pose)}; expected finite numbers")
    return pose


@lru_cache(maxsize=64)
def _decoder(reply: Any) -> msgspec.msgpack.Decoder[Any]:
    return msgspec.msgpack.Decoder(reply)
