"""A server of a simulated robot, whose hardware is the plant: `python -m colony.sim.plant.servers SPEC`.

The plant itself is `colony.sim.plant.child`.
"""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from colony.files import describe
from colony.ir.types import ScalarValue
from colony.runtime.assembly.processes.child import main
from colony.runtime.assembly.processes.spec import Device
from colony.runtime.protocol.images import Image
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.drivers import BaseLimits, BaseState
from colony.runtime.servers.drivers import Reading as DriverReading
from colony.sim.plant.protocol import (
    MAX_BYTES_FROM_PLANT,
    Attach,
    AttachBase,
    AttachCamera,
    AttachDevice,
    Attached,
    AttachProximity,
    BaseReading,
    CameraReading,
    DeviceCommand,
    DeviceReading,
    DriveBase,
    FromPlant,
    HaltBase,
    MakeSafe,
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

# --- drivers ------------------------------------------------------------------------------------------
#
# Drivers of devices in another process, the plant (`colony.sim.plant.process`).
#
# Each driver has a connection and a thread, which receives the device's reports and reconnects, with growing
# delays, when the plant or the connection dies. A driver returns the latest report immediately, or None if it
# is older than `MAX_READING_AGE_NS`: without hardware a robot reads "no value" rather than old readings.
#
# A driver sends each command once and never repeats it: the device stops by itself without commands.

MAX_READING_AGE_NS = 500_000_000
"""Maximum age of a report of a device in nanoseconds; what it reports may have been measured long before."""

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
        self.is_opening = True  # until it is connected, or refused
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name=type(attach).__name__, daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str | None:
        """The reason why there is no connection any more; None while there is one, and while it is opened."""
        return None if self._attached or self.is_opening else self._problem

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
            except (FileNotFoundError, ConnectionRefusedError):
                self._problem = "the Simulator is not running yet, or no longer"
            except OSError as problem:
                self._problem, self.is_opening = describe(problem), False
            except PlantProtocolError as problem:
                self._problem, self.is_opening = str(problem), False
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
                self._logical, self._attached, self.is_opening = message.logical, True, False
            elif isinstance(message, Refusal):
                self._problem, self.is_opening = message.message, False
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
        """The reason why there is no connection to the device any more; None while there is one."""
        return self._connection.problem

    @property
    def is_opening(self) -> bool:
        """True until there is a connection to the device, or a reason why there can be none."""
        return self._connection.is_opening

    def close(self) -> None:
        """Close the connection to the device."""
        self._connection.close()

    def _newest(self) -> tuple[R, int] | None:
        """Return the latest reading, and the offset from its times to the robot's.

        Without a fresh reading it is None.
        """
        reading = self._connection.newest()
        if reading is None:
            return None
        now_ns = self._clock()
        if self._connection.logical:
            return reading, self._logical_offset_ns(now_ns - reading.t_ns) - self._origin_ns
        return None if now_ns - reading.t_ns > MAX_READING_AGE_NS else (reading, -self._origin_ns)

    def _sample(self, field: Callable[[R], Sample | None]) -> Sample | None:
        """Return a field of the latest reading; None if there is none."""
        newest = self._newest()
        found = None if newest is None else field(newest[0])
        return None if newest is None or found is None else Sample(found.value, found.t_ns + newest[1])

    def _logical_offset_ns(self, behind_ns: int) -> int:
        """Return the offset from the plant's logical time, which is `behind_ns` behind, to that of the robot.

        The robot's time advances with the plant's, frame by frame, and is never earlier than that of `clock`.
        It is therefore never earlier than the ticks of the robot's Clock, which start at the time of `clock`
        and also advance by frames.
        """
        self._offset_ns = behind_ns if self._offset_ns is None else max(self._offset_ns, behind_ns)
        return self._offset_ns


class RemoteBase(_RemoteDriver[BaseReading]):
    """The base of a robot in the plant.

    Args:
        path: path of the plant's socket.
        robot: name of the robot.
        limits: the limits of its base, which the plant does not report.
        origin_ns: start of the robot's time, on the plant's clock.
        clock: the plant's clock, by default the machine's monotonic clock.
    """

    register_bits: int | None = None

    def __init__(
        self,
        path: Path,
        robot: str,
        *,
        limits: BaseLimits,
        origin_ns: int,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(path, AttachBase(robot=robot), BaseReading, origin_ns, clock)
        self.limits = limits

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> None:
        """Command the speeds of the base; in logical time, wait for the end of the frame."""
        command = DriveBase(velocity=velocity, turn=turn, sideways=sideways)
        if self._connection.logical:
            self._connection.request(lambda number: msgspec.structs.replace(command, number=number))
        else:
            self._connection.send(command)

    def stop(self) -> None:
        """Command the base to stop."""
        self._connection.send(HaltBase())

    def state(self) -> BaseState | None:
        """Return the latest state of the base, or None if there is none."""
        newest = self._newest()
        state = None if newest is None else newest[0].value
        return None if newest is None or state is None else replace(state, t_ns=state.t_ns + newest[1])


class RemoteProximity(_RemoteDriver[ProximityReading]):
    """`count` sonars and infrared detectors of a robot in the plant; else the arguments of `RemoteBase`."""

    def __init__(
        self,
        path: Path,
        robot: str,
        *,
        count: int,
        origin_ns: int,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(path, AttachProximity(robot=robot), ProximityReading, origin_ns, clock)
        self.count = count

    def sonar(self) -> Sample | None:
        """Return the latest sonar readings, or None if there are none."""
        return self._sample(lambda reading: reading.value.sonar)

    def infrared(self) -> Sample | None:
        """Return the latest infrared readings, or None if there are none."""
        return self._sample(lambda reading: reading.value.infrared)


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
        if newest is None:
            return None
        image = newest[0].value
        return msgspec.structs.replace(image, t_ns=image.t_ns + newest[1])


class RemoteDevice:
    """The device of server `server` of a robot in the plant; `clock` is as in `RemoteBase`."""

    def __init__(
        self, path: Path, robot: str, server: str, *, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._connection = _DeviceConnection(path, AttachDevice(robot=robot, server=server), DeviceReading)
        self._clock = clock

    @property
    def problem(self) -> str | None:
        """The reason why there is no connection to the device any more; None while there is one."""
        return self._connection.problem

    @property
    def is_opening(self) -> bool:
        """True until there is a connection to the device, or a reason why there can be none."""
        return self._connection.is_opening

    def fields(self) -> Mapping[str, DriverReading | None]:
        """Return the latest readings with their ages; none if the plant has sent none lately."""
        newest = self._connection.newest()
        if newest is None:
            return {}
        now_ns = newest.t_ns if self._connection.logical else self._clock()
        if now_ns - newest.t_ns > MAX_READING_AGE_NS:
            return {}
        return {
            name: None if found is None else DriverReading(found.value, now_ns - found.t_ns)
            for name, found in newest.value.items()
        }

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Send a command.

        Raises:
            ConnectionError: there is no connection to the device.
        """
        if not self._connection.send(DeviceCommand(name=name, values=values)):
            problem = "it is not connected yet" if self.is_opening else self._connection.problem
            raise ConnectionError(
                f"the simulator takes no command{'' if problem is None else f': {problem}'}"
            )

    def safe(self) -> None:
        """Make the device safe; without a connection it is."""
        self._connection.send(MakeSafe())

    def close(self) -> None:
        """Close the connection to the device, which makes it safe."""
        self._connection.close()


# --- servers ------------------------------------------------------------------------------------------


class PlantDevices:
    """Drivers of the devices in the plant."""

    def base(
        self, device: Device, robot: str, limits: BaseLimits, origin_ns: int, resources: ExitStack
    ) -> RemoteBase:
        """Open the base of a robot."""
        return resources.enter_context(
            closing(RemoteBase(Path(device.plant), robot, limits=limits, origin_ns=origin_ns))
        )

    def proximity(
        self, device: Device, robot: str, count: int, origin_ns: int, resources: ExitStack
    ) -> RemoteProximity:
        """Open the proximity sensors of a robot."""
        return resources.enter_context(
            closing(RemoteProximity(Path(device.plant), robot, count=count, origin_ns=origin_ns))
        )

    def camera(
        self, device: Device, robot: str, camera: str, origin_ns: int, resources: ExitStack
    ) -> RemoteCamera:
        """Open a camera of a robot."""
        return resources.enter_context(
            closing(RemoteCamera(Path(device.plant), robot, camera, origin_ns=origin_ns))
        )

    def device(self, device: Device, robot: str, server: str, resources: ExitStack) -> RemoteDevice:
        """Open the device of a server of a robot."""
        return resources.enter_context(closing(RemoteDevice(Path(device.plant), robot, server)))


if __name__ == "__main__":
    main(PlantDevices())
