"""The simulator as a separate process, like a robot's hardware.

    serve_plant(options, stop=stopped.is_set, ready=started.set)

The process simulates a building with robots in real time behind a unix socket, whether or not clients are
connected. A single thread simulates small steps, sends sensor readings to the attached drivers, and takes
commands. A slow reader misses readings but never delays others. An invalid message is answered by a refusal,
which ends its connection.

In logical time there is one robot, whose time advances by one frame with each command to its base. Without
commands, as with `idle hold`, time stands still.
"""

from __future__ import annotations

import fcntl
import os
import selectors
import socket
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from colony.sim.plant.assembly import PlantOptions, assembled_devices
from colony.sim.plant.hardware import Devices
from colony.sim.plant.protocol import (
    MAX_BYTES_TO_PLANT,
    Advance,
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
    PlantProtocolError,
    ProximityReading,
    Reading,
    Refusal,
    RideElevator,
    Sense,
    ToPlant,
    Unpacker,
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


def reading(port: Device, devices: Devices, number: int = 0) -> Reading:
    """Return the reading of the device at this port, with the number of the request."""
    robot, t_ns = devices.number(port.robot), devices.time_ns
    match port:
        case AttachBase():
            return BaseReading(value=devices.base(robot), t_ns=t_ns, number=number)
        case AttachProximity():
            return ProximityReading(value=devices.proximity(robot), t_ns=t_ns, number=number)
        case AttachCamera():
            return CameraReading(value=devices.image(robot, port.camera), t_ns=t_ns, number=number)
        case AttachDevice():
            return DeviceReading(value=devices.device(robot, port.server), t_ns=t_ns, number=number)


def answer(
    port: Attach, message: ToPlant, devices: Devices, logical_ns: int | None, *, sender: object = None
) -> FromPlant | None:
    """Handle a message, and return the answer if there is one.

    An error on a control connection is answered by a refusal, and the connection stays open.

    Args:
        port: the port to which the connection is attached.
        message: the message.
        devices: the devices.
        logical_ns: the logical time that passes with each command; None in real time.
        sender: the connection, until whose end its values of fields are given.
    """
    if isinstance(port, AttachControl):
        try:
            return _handle_control(message, devices, logical_ns, sender)
        except ValueError as problem:
            return Refusal(message=str(problem))
    if isinstance(message, Sense):
        return reading(port, devices, message.number)
    robot = devices.number(port.robot)
    match port, message:
        case AttachBase(), HaltBase():
            devices.halt(robot)
        case AttachBase(), DriveBase():
            devices.drive(robot, message.velocity, message.turn, message.sideways)
            if logical_ns is not None:
                devices.pass_time(logical_ns)
                return reading(port, devices, message.number)
        case AttachDevice(server=server), DeviceCommand():
            devices.command(robot, server, message.name, message.values)
        case AttachDevice(server=server), MakeSafe():
            devices.safe(robot, server)
        case _:
            raise _not_allowed(message)
    return None


def _handle_control(message: ToPlant, devices: Devices, logical_ns: int | None, sender: object) -> FromPlant:
    match message:
        case AskTruth():
            return devices.truth(devices.number(message.robot))
        case PlaceRobot():
            devices.place(devices.number(message.robot), message.x, message.y, message.heading)
        case Give():
            robot = devices.number(message.robot)
            devices.give(sender, robot, message.server, message.field, message.t_ns, message.value)
        case Advance() if logical_ns is not None:
            devices.pass_time(message.dt_ns)
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
_IDLE_S = 0.1
_CHUNK = 65536
_MAX_UNREAD = 65536
"""Number of unsent bytes at which the plant stops reading from a client until the client receives them."""


class PlantInUseError(Exception):
    """Another process is serving this socket."""


def serve_plant(
    options: PlantOptions,
    *,
    stop: Callable[[], bool],
    ready: Callable[[], None] = lambda: None,
    clock: Callable[[], int] = time.monotonic_ns,
) -> None:
    """Simulate until `stop` returns True; `ready` is called when drivers can attach.

    `stop` is polled.

    Raises:
        ValueError: a robot does not fit, there is no room for people, or there are several robots in logical
            time.
        DiagnosticError: a grid is to have hazards or cameras, which require a building.
        PlantInUseError: another process is serving this socket.
        OSError: the socket cannot be created.
    """
    devices = assembled_devices(options, clock)
    with _listening(options.path) as listener, selectors.DefaultSelector() as selector:
        server = _Server(devices, listener, selector, clock, logical_ns=options.logical_ns)
        ready()
        try:
            while not stop():
                server.step()
        finally:
            server.close()


@contextmanager
def _listening(path: Path) -> Iterator[socket.socket]:
    """Listen at `path`, replacing the socket of a killed process."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    status = path.parent.stat()
    if status.st_uid != os.getuid() or stat.S_IMODE(status.st_mode) & 0o077:
        raise PermissionError(f"{path.parent} is open to other users, who could drive the robots")
    lock = os.open(path.with_name(path.name + ".lock"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise PlantInUseError(f"{path} is served by another process already") from None
        path.unlink(missing_ok=True)
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
            listener.bind(os.fspath(path))
            listener.listen(128)
            listener.setblocking(False)
            yield listener
            path.unlink(missing_ok=True)
    finally:
        os.close(lock)


@dataclass(frozen=False, slots=True, kw_only=True, eq=False)
class _Connection:
    sock: socket.socket
    port: Attach | None = None
    unpacker: Unpacker = field(default_factory=lambda: Unpacker(MAX_BYTES_TO_PLANT))
    outbox: bytearray = field(default_factory=bytearray)
    due_ns: int = 0


class _Server:
    """The server of the devices. Mutable."""

    def __init__(
        self,
        devices: Devices,
        listener: socket.socket,
        selector: selectors.BaseSelector,
        clock: Callable[[], int],
        *,
        logical_ns: int | None,
    ) -> None:
        self._devices = devices
        self._listener = listener
        self._selector = selector
        self._clock = clock
        self._logical_ns = logical_ns
        self._began_ns = clock()
        self._connections: set[_Connection] = set()
        selector.register(listener, selectors.EVENT_READ, None)

    def step(self) -> None:
        """Advance the simulation and report; then wait for the next step, or for a message."""
        wait_s = _IDLE_S
        if self._logical_ns is None:
            self._devices.advance(self._clock())
            self._report()
            wait_s = (self._devices.time_ns + self._devices.step_ns - self._clock()) / 1e9
        for key, events in self._selector.select(max(wait_s, 0.0)):
            if key.data is None:
                self._accept()
            else:
                self._serve(key.data, events)

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

    def _serve(self, connection: _Connection, events: int) -> None:
        if events & selectors.EVENT_WRITE:
            self._flush(connection)
        if events & selectors.EVENT_READ and connection in self._connections:
            self._read(connection)

    def _read(self, connection: _Connection) -> None:
        try:
            data = connection.sock.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(connection)
            return
        try:
            for payload in connection.unpacker.feed(data):
                self._handle(connection, payload)
        except (PlantProtocolError, ValueError) as problem:
            self._send(connection, pack(Refusal(message=str(problem))))
            self._drop(connection)

    def _handle(self, connection: _Connection, payload: bytes) -> None:
        message = read_to_plant(payload)
        reply: FromPlant | None
        if connection.port is None:
            port = checked_attachment(message, self._devices)
            if isinstance(port, AttachBase):
                self._displace_idle_driver(port)
            connection.port, connection.due_ns = port, self._devices.time_ns
            reply = Attached(logical=self._logical_ns is not None, began_ns=self._began_ns)
        else:
            reply = answer(connection.port, message, self._devices, self._logical_ns, sender=connection)
        if reply is not None:
            self._send(connection, pack(reply))

    def _displace_idle_driver(self, port: AttachBase) -> None:
        """Disconnect the idle driver of a base for a new one; refuse if the driver is in command."""
        for other in tuple(self._connections):
            if other.port == port:
                if self._devices.is_driven(self._devices.number(port.robot)):
                    raise ValueError("another driver is in command of the base")
                self._drop(other)

    # --- sending -------------------------------------------------------------------------------------

    def _report(self) -> None:
        """Send the readings that are due, unless the previous one is still being sent."""
        now_ns = self._devices.time_ns
        for connection in tuple(self._connections):
            port = connection.port
            if port is None or isinstance(port, AttachControl) or now_ns < connection.due_ns:
                continue
            period_ns = IMAGE_NS if isinstance(port, AttachCamera) else REPORT_NS
            connection.due_ns += period_ns * (1 + (now_ns - connection.due_ns) // period_ns)
            if not connection.outbox:
                self._send(connection, pack(reading(port, self._devices)))

    def _send(self, connection: _Connection, data: bytes) -> None:
        connection.outbox += data
        self._flush(connection)

    def _flush(self, connection: _Connection) -> None:
        if connection not in self._connections:
            return
        try:
            while connection.outbox:
                sent = connection.sock.send(connection.outbox)
                del connection.outbox[:sent]
        except BlockingIOError:
            pass
        except OSError:
            self._drop(connection)
            return
        events = selectors.EVENT_READ if len(connection.outbox) < _MAX_UNREAD else 0
        events |= selectors.EVENT_WRITE if connection.outbox else 0
        self._selector.modify(connection.sock, events, connection)
