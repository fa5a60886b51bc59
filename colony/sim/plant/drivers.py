"""Drivers of devices in another process, the plant (`colony.sim.plant.process`).

Each driver has a connection and a thread, which receives the device's reports and reconnects, with growing
delays, when the plant or the connection dies. A driver returns the latest report immediately, or None if it
is older than `MAX_READING_AGE_NS`: without hardware a robot reads "no value" rather than old readings.

A driver sends each command once and never repeats it: the device stops by itself without commands.
"""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import BaseState
from colony.sim.config import RobotConfig, limits_of, rome_config
from colony.sim.plant.protocol import (
    MAX_BYTES_FROM_PLANT,
    Attach,
    AttachBase,
    AttachCamera,
    Attached,
    AttachProximity,
    BaseReading,
    CameraReading,
    DriveBase,
    FromPlant,
    Halt,
    PlantProtocolError,
    ProximityReading,
    Reading,
    Refusal,
    Sense,
    ToPlant,
    Unpacker,
    pack,
    read_from_plant,
)

MAX_READING_AGE_NS = 500_000_000
"""Maximum age of a reading or an image in nanoseconds."""

_MIN_RETRY_DELAY_S = 0.02
_MAX_RETRY_DELAY_S = 0.1
_REPLY_TIMEOUT_S = 1.0
_CHUNK = 262144

R = TypeVar("R", bound=Reading)


class _DeviceConnection(Generic[R]):
    """A connection to the plant, and the latest reading. Mutable; shared by two threads.

    Args:
        path: path of the plant's socket.
        attach: the request that attaches it to a device.
        reading_type: the class of the device's readings.
    """

    def __init__(self, path: Path, attach: Attach, reading_type: type[R]) -> None:
        self._path = path
        self._attach = attach
        self._reading_type = reading_type
        self._condition = threading.Condition()
        self._sock: socket.socket | None = None
        self._attached = False
        self._logical = False
        self._newest: R | None = None
        self._number = 0
        self._problem = "not connected yet"
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name=type(attach).__name__, daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str | None:
        """The reason why there is no connection; None while there is one."""
        return None if self._attached else self._problem

    def newest(self) -> R | None:
        """Return the latest reading, however old; in logical time request a new one."""
        return self.request(lambda number: Sense(number=number)) if self._logical else self._newest

    def send(self, message: ToPlant) -> bool:
        """Send a message without blocking; return False if there is no connection."""
        with self._condition:
            sock = self._sock
            if sock is None or not self._attached:
                return False
            data = pack(message)
            try:
                if sock.send(data, socket.MSG_DONTWAIT) == len(data):
                    return True
            except OSError:
                pass
            _shut_down(sock)  # the device is stuck, or the message was sent only in part
            return False

    def request(self, make_request: Callable[[int], ToPlant]) -> R | None:
        """Send a numbered message and wait for the reading that answers it; return None without an answer."""
        with self._condition:
            self._number += 1
            number = self._number
        if not self.send(make_request(number)):
            return None
        with self._condition:
            self._condition.wait_for(
                lambda: not self._attached or (self._newest is not None and self._newest.number == number),
                _REPLY_TIMEOUT_S,
            )
            newest = self._newest
        return newest if newest is not None and newest.number == number else None

    @property
    def logical(self) -> bool:
        """True if the device's time advances only by commands."""
        return self._logical

    def close(self) -> None:
        """Close the connection. Idempotent."""
        self._closed.set()
        with self._condition:
            if self._sock is not None:
                _shut_down(self._sock)
        self._thread.join()

    # --- the thread ----------------------------------------------------------------------------------

    def _run(self) -> None:
        delay_s = _MIN_RETRY_DELAY_S
        while not self._closed.is_set():
            try:
                with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as sock:
                    sock.settimeout(_REPLY_TIMEOUT_S)
                    sock.connect(os.fspath(self._path))
                    sock.sendall(pack(self._attach))
                    sock.settimeout(None)
                    if self._adopt(sock):
                        self._receive(sock)
            except (OSError, PlantProtocolError) as problem:
                self._problem = str(problem)
            with self._condition:
                delay_s = _MIN_RETRY_DELAY_S if self._attached else min(2.0 * delay_s, _MAX_RETRY_DELAY_S)
                self._sock, self._attached = None, False
                self._condition.notify_all()
            self._closed.wait(delay_s)

    def _adopt(self, sock: socket.socket) -> bool:
        """Register a socket for `close`; return False if the connection is closed already."""
        with self._condition:
            self._sock = None if self._closed.is_set() else sock
            return self._sock is not None

    def _receive(self, sock: socket.socket) -> None:
        """Receive messages until the connection ends."""
        unpacker = Unpacker(MAX_BYTES_FROM_PLANT)
        while data := sock.recv(_CHUNK):
            for payload in unpacker.feed(data):
                self._handle(read_from_plant(payload))
        if self._attached:
            self._problem = "the plant ended the connection"

    def _handle(self, message: FromPlant) -> None:
        with self._condition:
            if isinstance(message, Attached):
                self._logical, self._attached = message.logical, True
            elif isinstance(message, Refusal):
                self._problem = message.message
            elif isinstance(message, self._reading_type):
                self._newest = message
            self._condition.notify_all()


def _shut_down(sock: socket.socket) -> None:
    """Shut a connection down; the other thread, which may be waiting on it, closes the socket."""
    with contextlib.suppress(OSError):
        sock.shutdown(socket.SHUT_RDWR)


class _RemoteDriver(Generic[R]):
    """The base class of all remote drivers."""

    def __init__(
        self, path: Path, attach: Attach, reading_type: type[R], origin_ns: int, clock: Callable[[], int]
    ) -> None:
        self._connection = _DeviceConnection(path, attach, reading_type)
        self._origin_ns = origin_ns
        self._clock = clock
        self._offset_ns: int | None = None

    @property
    def problem(self) -> str | None:
        """The reason why there is no connection to the device; None while there is one."""
        return self._connection.problem

    def close(self) -> None:
        """Close the connection to the device."""
        self._connection.close()

    def _newest(self) -> tuple[R, int] | None:
        """Return the latest reading and its time, in the robot's time; None if there is no fresh reading."""
        reading = self._connection.newest()
        if reading is None:
            return None
        now_ns, t_ns = self._clock(), reading.value.t_ns
        if self._connection.logical:
            return reading, self._logical_ns(t_ns, now_ns) - self._origin_ns
        return None if now_ns - t_ns > MAX_READING_AGE_NS else (reading, t_ns - self._origin_ns)

    def _logical_ns(self, t_ns: int, now_ns: int) -> int:
        """Return the time of a reading when the plant runs in logical time.

        It advances with the plant's time, frame by frame, and is never earlier than `now_ns`, the time of
        `clock`. It is therefore never earlier than the ticks of the robot's Clock, which start at the time of
        `clock` and also advance by frames.
        """
        offset_ns = now_ns - t_ns if self._offset_ns is None else max(self._offset_ns, now_ns - t_ns)
        self._offset_ns = offset_ns
        return t_ns + offset_ns


class RemoteBase(_RemoteDriver[BaseReading]):
    """The base of a robot in the plant.

    Args:
        path: path of the plant's socket.
        robot: name of the robot.
        origin_ns: start of the robot's time, on the plant's clock.
        clock: the plant's clock, by default the machine's monotonic clock.
        config: the parameters of the robot, which the plant does not report.
    """

    register_bits: int | None = None

    def __init__(
        self,
        path: Path,
        robot: str,
        *,
        origin_ns: int,
        clock: Callable[[], int] = time.monotonic_ns,
        config: RobotConfig | None = None,
    ) -> None:
        super().__init__(path, AttachBase(robot=robot), BaseReading, origin_ns, clock)
        self.limits = limits_of(config or rome_config())

    def drive(self, velocity: float, turn: float) -> None:
        """Command the speeds of the base; in logical time, wait for the end of the frame."""
        if self._connection.logical:
            self._connection.request(lambda number: DriveBase(velocity=velocity, turn=turn, number=number))
        else:
            self._connection.send(DriveBase(velocity=velocity, turn=turn))

    def stop(self) -> None:
        """Command the base to stop."""
        self._connection.send(Halt())

    def state(self) -> BaseState | None:
        """Return the latest state of the base, or None if there is none."""
        newest = self._newest()
        return None if newest is None else replace(newest[0].value, t_ns=newest[1])


class RemoteProximity(_RemoteDriver[ProximityReading]):
    """The sonars and infrared detectors of a robot in the plant; the arguments are those of `RemoteBase`."""

    def __init__(
        self, path: Path, robot: str, *, origin_ns: int, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        super().__init__(path, AttachProximity(robot=robot), ProximityReading, origin_ns, clock)

    def sonar(self) -> Sample | None:
        """Return the latest sonar readings, or None if there are none."""
        newest = self._newest()
        return None if newest is None else Sample(newest[0].value.sonar, newest[1])

    def infrared(self) -> Sample | None:
        """Return the latest infrared readings, or None if there are none."""
        newest = self._newest()
        return None if newest is None else Sample(newest[0].value.infrared, newest[1])


class RemoteCamera(_RemoteDriver[CameraReading]):
    """Camera `camera` of a robot in the plant; the other arguments are those of `RemoteBase`."""

    def __init__(
        self,
        path: Path,
        robot: str,
        camera: str,
        *,
        origin_ns: int,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(path, AttachCamera(robot=robot, camera=camera), CameraReading, origin_ns, clock)

    def grab(self) -> Image | None:
        """Return the latest image, or None if there is none."""
        newest = self._newest()
        return None if newest is None else msgspec.structs.replace(newest[0].value, t_ns=newest[1])
