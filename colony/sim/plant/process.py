"""The simulator as a separate process, like a robot's hardware.

    serve_plant(options, stop=stopped.is_set, ready=started.set)

The process simulates a building with robots in real time behind a unix socket, whether or not clients are
connected. A single thread simulates small steps, sends sensor readings to the attached drivers, and takes
commands. A slow reader misses readings but never delays others. An invalid message is answered by a refusal,
which ends its connection.
"""

from __future__ import annotations

import os
import selectors
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from colony.sim.plant.assembly import PlantOptions, assembled_devices
from colony.sim.plant.hardware import Devices
from colony.sim.plant.protocol import (
    MAX_BYTES_FROM_PLANT,
    MAX_BYTES_TO_PLANT,
    AskDoors,
    AskTruth,
    Attach,
    AttachBase,
    AttachCamera,
    AttachControl,
    AttachDevice,
    Attached,
    AttachProximity,
    BaseReading,
    CameraReading,
    Device,
    DeviceCommand,
    DeviceReading,
    Done,
    Doors,
    DriveBase,
    FromPlant,
    Give,
    HaltBase,
    Landed,
    MakeSafe,
    MoveDoors,
    PlaceRobot,
    ProximityReading,
    Reading,
    Refusal,
    RideElevator,
    ToPlant,
    pack,
    read_to_plant,
)

# --- ports --------------------------------------------------------------------------------------------
#
# The ports of a plant, to which connections attach, and the messages that each allows. No I/O.
#
# A message that is not allowed raises `ValueError`, whose text is returned to the sender.


def checked_attachment(message: ToPlant, devices: Devices) -> Attach:
    """Check the first message of a connection, which must attach it to a device or to the control.

    Raises:
        ValueError: the message does not attach, or the plant has no such robot, camera or device.
    """
    match message:
        case AttachCamera(robot=robot, camera=camera):
            devices.check_camera(camera)
            devices.number(robot)
        case AttachDevice(robot=robot, server=server):
            devices.check_device(devices.number(robot), server)
        case AttachProximity(robot=robot):
            devices.check_proximity(devices.number(robot))
        case AttachBase(robot=robot):
            devices.number(robot)
        case AttachControl():
            pass
        case _:
            raise _not_allowed(message)
    return message


def reading(port: Device, devices: Devices) -> Reading:
    """Return the reading of the device at this port."""
    robot, t_ns = devices.number(port.robot), devices.time_ns
    match port:
        case AttachBase():
            return BaseReading(value=devices.base(robot), t_ns=t_ns)
        case AttachProximity():
            return ProximityReading(value=devices.proximity(robot), t_ns=t_ns)
        case AttachCamera():
            return CameraReading(value=devices.image(robot, port.camera), t_ns=t_ns)
        case AttachDevice():
            return DeviceReading(value=devices.device(robot, port.server), t_ns=t_ns)


def answer(port: Attach, message: ToPlant, devices: Devices, *, sender: object = None) -> FromPlant | None:
    """Handle a message, and return the answer if there is one.

    An error on a control connection is answered by a refusal, and the connection stays open.

    Args:
        port: the port to which the connection is attached.
        message: the message.
        devices: the devices.
        sender: the connection, until whose end its values of fields are given.
    """
    if isinstance(port, AttachControl):
        try:
            return _handle_control(message, devices, sender)
        except ValueError as problem:
            return Refusal(message=str(problem))
    robot = devices.number(port.robot)
    match port, message:
        case AttachBase(), HaltBase():
            devices.halt(robot)
        case AttachBase(), DriveBase():
            devices.drive(robot, message.velocity, message.turn, message.sideways)
        case AttachDevice(server=server), DeviceCommand():
            devices.command(robot, server, message.name, message.values)
        case AttachDevice(server=server), MakeSafe():
            devices.safe(robot, server)
        case _:
            raise _not_allowed(message)
    return None


def _handle_control(message: ToPlant, devices: Devices, sender: object) -> FromPlant:
    match message:
        case AskTruth():
            return devices.truth(devices.number(message.robot))
        case PlaceRobot():
            devices.place(devices.number(message.robot), message.x, message.y, message.heading)
        case Give():
            robot = devices.number(message.robot)
            devices.give(sender, robot, message.server, message.field, message.t_ns, message.value)
        case AskDoors(node=node):
            return Doors(opening=devices.elevators.opening(node))
        case MoveDoors(node=node, is_opening=True):
            devices.elevators.open(node)
        case MoveDoors(node=node):
            devices.elevators.close(node)
        case RideElevator(node=node, floor=floor):
            return Landed(node=devices.elevators.ride(node, floor))
        case _:
            raise _not_allowed(message)
    return Done()


def _not_allowed(message: ToPlant) -> ValueError:
    return ValueError(f"{type(message).__name__} is not allowed on this connection")


# --- process ------------------------------------------------------------------------------------------

REPORT_NS = 20_000_000
"""Nanoseconds between two reports of a base or a ring."""

IMAGE_NS = 100_000_000
"""Nanoseconds between two images of a camera."""

_MAX_CONNECTIONS = 1000


def serve_plant(
    options: PlantOptions,
    *,
    stop: Callable[[], bool],
    ready: Callable[[], None] = lambda: None,
    clock: Callable[[], int] = time.monotonic_ns,
) -> None:
    """Simulate until `stop` returns True; `ready` is called when drivers can attach.

    `stop` is polled. The caller has claimed the robots (`RobotDirectory.claim`), so that no other process
    serves the socket, and no other user can drive them.

    Raises:
        ValueError: a robot does not fit, or there is no room for people.
        DiagnosticError: a grid is to have hazards or cameras, which require a building.
        OSError: the socket cannot be created.
    """
    devices = assembled_devices(options, clock)
    with _listening(options.path) as listener, selectors.DefaultSelector() as selector:
        server = _Server(devices, listener, selector, clock)
        ready()
        try:
            while not stop():
                server.step()
        finally:
            server.close()


@contextmanager
def _listening(path: Path) -> Iterator[socket.socket]:
    """Listen at `path`, replacing the socket of a killed process."""
    path.unlink(missing_ok=True)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        listener.bind(os.fspath(path))
        listener.listen(128)
        listener.setblocking(False)
        yield listener
        path.unlink(missing_ok=True)


@dataclass(frozen=False, slots=True, kw_only=True, eq=False)
class _Connection:
    sock: socket.socket
    port: Attach | None = None
    due_ns: int = 0


class _Server:
    """The server of the devices. Mutable."""

    def __init__(
        self,
        devices: Devices,
        listener: socket.socket,
        selector: selectors.BaseSelector,
        clock: Callable[[], int],
    ) -> None:
        self._devices = devices
        self._listener = listener
        self._selector = selector
        self._clock = clock
        self._began_ns = clock()
        self._connections: set[_Connection] = set()
        selector.register(listener, selectors.EVENT_READ, None)

    def step(self) -> None:
        """Advance the simulation and report; then wait for the next step, or for a message."""
        self._devices.advance(self._clock())
        self._report()
        wait_ns = self._devices.time_ns + self._devices.step_ns - self._clock()
        for key, _ in self._selector.select(max(wait_ns, 0) / 1e9):
            if key.data is None:
                self._accept()
            elif key.data in self._connections:  # another message of this turn may have ended it
                self._receive(key.data)

    def close(self) -> None:
        for connection in tuple(self._connections):
            self._drop(connection)

    # --- connections ---------------------------------------------------------------------------------

    def _accept(self) -> None:
        try:
            sock, _ = self._listener.accept()
        except OSError:  # the client has disconnected, or this process has no more descriptors
            return
        if len(self._connections) >= _MAX_CONNECTIONS:
            sock.close()
            return
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MAX_BYTES_FROM_PLANT)
        connection = _Connection(sock=sock)
        self._connections.add(connection)
        self._selector.register(sock, selectors.EVENT_READ, connection)

    def _drop(self, connection: _Connection) -> None:
        if connection in self._connections:
            self._connections.remove(connection)
            self._selector.unregister(connection.sock)
            connection.sock.close()
            match connection.port:
                case AttachBase(robot=robot):
                    self._devices.halt(self._devices.number(robot))
                case AttachDevice(robot=robot, server=server) as port:
                    if all(other.port != port for other in self._connections):
                        self._devices.safe(self._devices.number(robot), server)
                case AttachControl():
                    self._devices.withdraw(connection)
                case _:
                    pass

    def _receive(self, connection: _Connection) -> None:
        try:
            packet = connection.sock.recv(MAX_BYTES_TO_PLANT)
        except BlockingIOError:
            return
        except OSError:
            packet = b""
        if not packet:
            self._drop(connection)
            return
        try:
            self._handle(connection, read_to_plant(packet))
        except ValueError as problem:
            self._send(connection, Refusal(message=str(problem)))
            self._drop(connection)

    def _handle(self, connection: _Connection, message: ToPlant) -> None:
        reply: FromPlant | None
        if connection.port is None:
            port = checked_attachment(message, self._devices)
            if isinstance(port, AttachBase):
                self._displace_idle_driver(port)
            connection.port, connection.due_ns = port, self._devices.time_ns
            reply = Attached(began_ns=self._began_ns)
        else:
            reply = answer(connection.port, message, self._devices, sender=connection)
        if reply is not None:
            self._send(connection, reply)

    def _displace_idle_driver(self, port: AttachBase) -> None:
        """Disconnect the idle driver of a base for a new one; refuse if the driver is in command."""
        for other in tuple(self._connections):
            if other.port == port:
                if self._devices.is_driven(self._devices.number(port.robot)):
                    raise ValueError("another driver is in command of the base")
                self._drop(other)

    # --- sending -------------------------------------------------------------------------------------

    def _report(self) -> None:
        """Send the readings that are due."""
        now_ns = self._devices.time_ns
        for connection in tuple(self._connections):
            port = connection.port
            if port is None or isinstance(port, AttachControl) or now_ns < connection.due_ns:
                continue
            period_ns = IMAGE_NS if isinstance(port, AttachCamera) else REPORT_NS
            connection.due_ns += period_ns * (1 + (now_ns - connection.due_ns) // period_ns)
            self._send(connection, reading(port, self._devices))

    def _send(self, connection: _Connection, message: FromPlant) -> None:
        """Send a message; a client that does not read misses readings, and an answer ends its connection."""
        try:
            connection.sock.send(pack(message))
        except OSError as problem:
            if not (isinstance(problem, BlockingIOError) and isinstance(message, Reading)):
                self._drop(connection)
