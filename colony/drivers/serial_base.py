"""The drivers of a device on a serial line, made of its dialect: of its base, its actuators and sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from typing import Generic

from colony.drivers.dialect import Dialect, Packet
from colony.drivers.guarded import GuardedCommand
from colony.drivers.line import DeviceLine, check_options, handshake_first, to_stderr
from colony.ir.types import ScalarValue
from colony.runtime.kit.once import Report, exception_text
from colony.runtime.servers.drivers import BaseState, Reading

DEADLINE_NS = 150_000_000
DEADLINE_FRAMES = 3
"""Time without a decision after which the guard stops the base, or number of frames if that is longer."""

DEFAULT_FRAME_NS = 50_000_000


def _guarded(dialect: Dialect[Packet], port: str, stop: bytes, frame_ns: int) -> GuardedCommand:
    """Return what is left with the guard for an actuator that `stop` stops."""
    return GuardedCommand(
        stop=stop,
        goodbye=dialect.goodbye,
        deadline_ns=max(DEADLINE_NS, DEADLINE_FRAMES * frame_ns),
        handshake_first=handshake_first(dialect, port),
    )


class SerialBase(Generic[Packet]):
    """The driver of a base on a serial line, for `RServer`. Mutable: has a line, which it opens.

    Only `drive` sends what moves the base or keeps it moving, in the thread of the server that decided it. If
    that thread, or its process, does so no more, the guard stops the base.

    Args:
        dialect: the protocol of the base.
        port: a serial port or `tcp:HOST:PORT`.
        baud: the baud rate; 0 for that of the dialect.
        frame_ns: the length of the robot's frames in ns.
        report: takes each problem once in each outage, and the end of the outage.

    Raises:
        TypeError: the port is not text, or the baud rate is not a whole number.
    """

    register_bits: int | None = None  # `Registers` unwraps them

    def __init__(
        self,
        dialect: Dialect[Packet],
        port: str,
        *,
        baud: int = 0,
        frame_ns: int = DEFAULT_FRAME_NS,
        report: Report = to_stderr,
    ) -> None:
        check_options(port, baud)
        self._report = report
        command = _guarded(dialect, port, dialect.stop_bytes, frame_ns)
        self._line, (self._channel,) = DeviceLine.commanding(dialect, port, baud, [command], report)
        self._dialect = self._line.dialect

    @property
    def problem(self) -> str | None:
        """Why the base does not work, from its first failure until it works again; else None."""
        return self._line.problem

    @property
    def is_opening(self) -> bool:
        """True while the device is being opened, and has not failed."""
        return self._line.is_opening

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> None:
        """Drive as decided in this frame.

        Raises:
            ValueError: the base cannot do that.
            OSError: the base is not ready, or the guard has ended.
        """
        if not (math.hypot(velocity, sideways) <= self._dialect.max_speed):
            raise ValueError(
                f"{velocity:g}, {sideways:g} mm/s; at most {self._dialect.max_speed:g} is possible"
            )
        if not (abs(turn) <= self._dialect.max_turn):
            raise ValueError(f"{turn:g} deg/s; at most {self._dialect.max_turn:g} is possible")
        self._line.decide(self._channel, self._dialect.drive(velocity, turn, sideways))

    def stop(self) -> None:
        """Stop. Never raises: where the guard has ended, its successor begins with a stop."""
        try:
            self._line.stop(self._channel)
        except OSError as problem:
            self._report(f"the stop was not sent: {exception_text(problem)}")

    @property
    def unreached(self) -> str | None:
        """Why the last stop has not left this computer, or not yet; None once it has."""
        return self._line.unreached(self._channel)

    def watch_bumpers(self, watched: bool) -> None:
        """Let the base itself stop at a bumper or not, if it can."""
        self._dialect.watch_bumpers(watched)

    def state(self) -> BaseState | None:
        """Return the newest state; None while the base does not report one."""
        return self._line.base()

    def close(self) -> None:
        """Leave the line: the guard stops the base, at its deadline if other drivers use the line."""
        self._line.close()


class SerialFields(Generic[Packet]):
    """The driver of another server of the same port, such as a battery or a ring, which only listens.

    Args:
        dialect: the protocol, of its own: `Dialect` says what that means.
        port: a serial port or `tcp:HOST:PORT`.
        names: the dialect's name of each field or ring, by the name of the server's field.
        baud: the baud rate; 0 for that of the dialect.
        report: takes each problem once in each outage, and the end of the outage.

    Raises:
        TypeError: the port is not text, or the baud rate is not a whole number.
    """

    def __init__(
        self,
        dialect: Dialect[Packet],
        port: str,
        names: Mapping[str, str],
        *,
        baud: int = 0,
        report: Report = to_stderr,
    ) -> None:
        check_options(port, baud)
        self._names = dict(names)
        self.commands: Set[str] = frozenset()
        self._line = DeviceLine.listening(dialect, port, baud, report)

    @property
    def problem(self) -> str | None:
        """Why the device does not work, from its first failure until it works again; else None."""
        return self._line.problem

    @property
    def is_opening(self) -> bool:
        """True while the device is being opened, and has not failed."""
        return self._line.is_opening

    def fields(self) -> Mapping[str, Reading | None]:
        """Return the newest reading of each field."""
        found = self._line.readings(self._names.values())
        return {field: found.get(name) for field, name in self._names.items()}

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Refuse: such a driver sends nothing.

        Raises:
            ValueError: always.
        """
        raise ValueError(f"the device has no command `{name}`")

    def safe(self) -> None:
        """Do nothing: what only listens is safe."""

    def close(self) -> None:
        """End the connection to the guard. Idempotent."""
        self._line.close()


class SerialActuators(SerialFields[Packet]):
    """The driver of another server of the same port that commands, such as a gripper beside the base.

    Each command has a channel of its own: if its decisions stay away, the guard sends its stop, and no other.

    Args:
        dialect: the protocol, with a method for each command, called like it. The method takes the parameters
            by name and returns complete bytes, as `Dialect.drive` does.
        port: a serial port or `tcp:HOST:PORT`.
        names: the dialect's name of each field or ring, by the name of the server's field.
        stops: for each command the bytes that stop its actuator, which are harmless at any time. No other
            driver of the port has them.
        baud: the baud rate; 0 for that of the dialect.
        frame_ns: the length of the robot's frames in ns.
        report: takes each problem once in each outage, and the end of the outage.

    Raises:
        TypeError: the port is not text, or the baud rate is not a whole number.
        AttributeError: the dialect has no method for a command.
    """

    def __init__(
        self,
        dialect: Dialect[Packet],
        port: str,
        names: Mapping[str, str],
        stops: Mapping[str, bytes],
        *,
        baud: int = 0,
        frame_ns: int = DEFAULT_FRAME_NS,
        report: Report = to_stderr,
    ) -> None:
        check_options(port, baud)
        for name in stops:
            getattr(dialect, name)
        self._names, self._report = dict(names), report
        commands = [_guarded(dialect, port, stop, frame_ns) for stop in stops.values()]
        self._line, channels = DeviceLine.commanding(dialect, port, baud, commands, report)
        self._channels = dict(zip(stops, channels, strict=True))
        self.commands = self._channels.keys()

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Carry out a command that was decided in this frame.

        Raises:
            ValueError: the device has no such command, or cannot do that.
            OSError: the device is not ready, or the guard has ended.
        """
        if name not in self._channels:
            raise ValueError(f"the device has no command `{name}`")
        data: bytes = getattr(self._line.dialect, name)(**values)
        self._line.decide(self._channels[name], data, confirms=True)

    def safe(self) -> None:
        """Stop all actuators. Never raises: if the guard has ended, its successor begins with the stops."""
        try:
            for channel in self._channels.values():
                self._line.stop(channel)
        except OSError as problem:
            self._report(f"the stop was not sent: {exception_text(problem)}")

    @property
    def unreached(self) -> str | None:
        """Why a last stop or command has not left this computer, or not yet; None once all have."""
        return next(filter(None, map(self._line.unreached, self._channels.values())), None)
