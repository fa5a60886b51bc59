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

from colony.backoff import Backoff
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
    ToPlant,
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

_RETRY_S = (0.02, 0.1)
"""Pauses before the plant is tried again: the first, which doubles, and the longest."""

_CONNECT_TIMEOUT_S = 1.0

R = TypeVar("R", bound=Reading)


class _RemoteDriver(Generic[R]):
    """A connection to a device in the plant, and its latest reading. Mutable; shared by two threads.

    Args:
        path: path of the plant's socket.
        attach: the request that attaches it to the device.
        reading_type: the class of the device's readings.
        origin_ns: start of the robot's time, on the plant's clock.
        clock: the plant's clock.
    """

    def __init__(
        self, path: Path, attach: Attach, reading_type: type[R], origin_ns: int, clock: Callable[[], int]
    ) -> None:
        self._origin_ns = origin_ns
        self._clock = clock
        self._path = path
        self._attach = attach
        self._reading_type = reading_type
        self._lock = threading.Lock()
        self._sock: socket.socket | None = None
        self._attached = False
        self._latest: R | None = None  # however old
        self._problem = "not connected yet"
        self.is_opening = True
        """True until there is a connection to the device, or a reason why there can be none."""
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name=type(attach).__name__, daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str | None:
        """The reason why there is no connection to the device any more; None while there is one."""
        return None if self._attached or self.is_opening else self._problem

    def close(self) -> None:
        """Close the connection to the device, which makes it safe. Idempotent."""
        self._closed.set()
        with self._lock:
            if self._sock is not None:
                _shut_down(self._sock)
        self._thread.join()

    # --- for the devices -----------------------------------------------------------------------------

    def _send(self, message: ToPlant) -> bool:
        """Send a message without blocking; return False if there is no connection."""
        with self._lock:
            if self._sock is None or not self._attached:
                return False
            try:
                self._sock.send(pack(message), socket.MSG_DONTWAIT)
            except OSError:
                _shut_down(self._sock)  # the device is stuck
                return False
            return True

    def _newest(self) -> R | None:
        """Return the latest reading; None without a fresh one."""
        reading = self._latest
        is_fresh = reading is not None and self._clock() - reading.t_ns <= MAX_READING_AGE_NS
        return reading if is_fresh else None

    def _sample(self, field: Callable[[R], Sample | None]) -> Sample | None:
        """Return a field of the latest reading in the robot's time; None if there is none."""
        newest = self._newest()
        found = None if newest is None else field(newest)
        return None if found is None else Sample(found.value, found.t_ns - self._origin_ns)

    # --- the thread ----------------------------------------------------------------------------------

    def _run(self) -> None:
        retries = Backoff(*_RETRY_S)
        while not self._closed.is_set():
            try:
                with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as sock:
                    sock.settimeout(_CONNECT_TIMEOUT_S)
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
            with self._lock:
                if self._attached:
                    retries.reset()
                self._sock, self._attached = None, False
            self._closed.wait(retries.next())

    def _adopt(self, sock: socket.socket) -> bool:
        """Register a socket for `close`; return False if the connection is closed already."""
        with self._lock:
            self._sock = None if self._closed.is_set() else sock
            return self._sock is not None

    def _receive(self, sock: socket.socket) -> None:
        """Receive messages until the connection ends."""
        room = memoryview(bytearray(MAX_BYTES_FROM_PLANT))
        while size := _receive_into(sock, room):
            self._handle(read_from_plant(room[:size]))
        if self._attached:
            self._problem = "the plant ended the connection"

    def _handle(self, message: FromPlant) -> None:
        if isinstance(message, Attached):
            self._attached, self.is_opening = True, False
        elif isinstance(message, Refusal):
            self._problem, self.is_opening = message.message, False
        elif isinstance(message, self._reading_type):
            self._latest = message


def _receive_into(sock: socket.socket, room: memoryview) -> int:
    """Receive a packet and return its size; 0 at the end."""
    try:
        return sock.recv_into(room)
    except ConnectionResetError:  # the plant closed it before it had read all; its refusal is still there
        return sock.recv_into(room)


def _shut_down(sock: socket.socket) -> None:
    """Shut a connection down; the other thread, which may be waiting on it, closes the socket."""
    with contextlib.suppress(OSError):
        sock.shutdown(socket.SHUT_RDWR)


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
        """Command the speeds of the base."""
        self._send(DriveBase(velocity=velocity, turn=turn, sideways=sideways))

    def stop(self) -> None:
        """Command the base to stop."""
        self._send(HaltBase())

    def state(self) -> BaseState | None:
        """Return the latest state of the base, or None if there is none."""
        newest = self._newest()
        state = None if newest is None else newest.value
        return None if state is None else replace(state, t_ns=state.t_ns - self._origin_ns)


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
        return msgspec.structs.replace(newest.value, t_ns=newest.value.t_ns - self._origin_ns)


class RemoteDevice(_RemoteDriver[DeviceReading]):
    """The device of server `server` of a robot in the plant; `clock` is as in `RemoteBase`."""

    def __init__(
        self, path: Path, robot: str, server: str, *, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        super().__init__(path, AttachDevice(robot=robot, server=server), DeviceReading, 0, clock)

    def fields(self) -> Mapping[str, DriverReading | None]:
        """Return the latest readings with their ages; none if the plant has sent none lately."""
        newest, now_ns = self._newest(), self._clock()
        if newest is None:
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
        if not self._send(DeviceCommand(name=name, values=values)):
            problem = "it is not connected yet" if self.is_opening else self.problem
            raise ConnectionError(
                f"the simulator takes no command{'' if problem is None else f': {problem}'}"
            )

    def safe(self) -> None:
        """Make the device safe; without a connection it is."""
        self._send(MakeSafe())


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
