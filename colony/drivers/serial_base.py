"""The drivers of a device on a serial line, made of its dialect: of the base, and of other servers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Generic

from colony.drivers.decoder import Packet
from colony.drivers.dialect import Dialect
from colony.drivers.guarded import Command
from colony.drivers.line import Line, check_options, handshake_first, to_stderr
from colony.ir.types import ScalarValue
from colony.runtime.kit.once import Report, exception_text
from colony.runtime.servers.drivers import BaseState, Reading

DEADLINE_NS = 150_000_000
DEADLINE_FRAMES = 3
"""Time without a decision after which the guard stops the base, or number of frames if that is longer."""

DEFAULT_FRAME_NS = 50_000_000


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
        self._dialect = dialect
        self._report = report
        command = Command(
            stop=dialect.stop_bytes,
            goodbye=dialect.goodbye,
            deadline_ns=max(DEADLINE_NS, DEADLINE_FRAMES * frame_ns),
            handshake_first=handshake_first(dialect, port),
        )
        self._line = Line.commanding(dialect, port, baud, command, report)

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
        self._line.decide(self._dialect.drive(velocity, turn, sideways))

    def stop(self) -> None:
        """Stop. Never raises: where the guard has ended, its successor begins with a stop."""
        try:
            self._line.stop()
        except OSError as problem:
            self._report(f"the stop was not sent: {exception_text(problem)}")

    @property
    def unreached(self) -> str | None:
        """Why the last stop has not left this computer, or not yet; None once it has."""
        return self._line.unreached

    def watch_bumpers(self, watched: bool) -> None:
        """Let the base itself stop at a bumper or not, if it can."""
        self._dialect.watch_bumpers(watched)

    def state(self) -> BaseState | None:
        """Return the newest state; None while the base does not report one."""
        return self._line.base()

    def close(self) -> None:
        """End the connection to the guard, which stops the base. Idempotent."""
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
        self._line = Line.listening(dialect, port, baud, report)

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
