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
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from colony.body.model import Body
from colony.body.servers import servers_of
from colony.nav.maps.free_space import FreeSpace
from colony.nav.maps.world_map import WorldMap
from colony.sim.cameras.camera import Camera, CameraConfig
from colony.sim.cameras.ceiling import CeilingCamera, CeilingCameraConfig
from colony.sim.cameras.scene import scene_of
from colony.sim.config import RobotConfig, config_of, rome_config
from colony.sim.devices import devices_of
from colony.sim.hazards.hazards import Hazards, scenery_of
from colony.sim.hazards.scenery import Scenery
from colony.sim.plant.given import GivenFields
from colony.sim.plant.hardware import STEP_NS, WATCHDOG_NS, Devices, RobotCamera, RobotDevice
from colony.sim.plant.ports import answer, checked_attachment, reading
from colony.sim.plant.protocol import (
    MAX_BYTES_TO_PLANT,
    Attach,
    AttachBase,
    AttachCamera,
    AttachControl,
    AttachDevice,
    Attached,
    FromPlant,
    PlantProtocolError,
    Refusal,
    Unpacker,
    pack,
    read_to_plant,
)
from colony.sim.world.movers import with_movers
from colony.sim.world.world import World

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


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantOptions:
    """The options of a plant.

    Attributes:
        path: path of the socket, in a private folder, which is created if it is missing.
        world: the map of the world.
        robots: initial poses by name: x, y in mm, heading in degrees counterclockwise from north.
        cameras: cameras of each robot, by name.
        hazards: hazards of the building; none by default, and in a grid.
        hazards_seed: seed of the hazards.
        movers: number of people who walk around between free places, besides those of the hazards.
        body: the body of the robots; None for one that has no devices but those of `config` and `cameras`.
        real: the servers of the body whose devices are real; the plant does not simulate them.
        config: the parameters of the robots; those of the body by default, of RoME without one.
        seed: seed of the simulated errors.
        step_ns: step of the simulation.
        watchdog_ns: time without a command after which a base stops.
        logical_ns: logical time that passes with each command; None for real time.
    """

    path: Path
    world: WorldMap
    robots: Mapping[str, tuple[float, float, float]]
    cameras: Mapping[str, CameraConfig | CeilingCameraConfig] = field(default_factory=dict)
    hazards: Hazards = field(default_factory=Hazards.none)
    hazards_seed: int = 0
    movers: int = 0
    body: Body | None = None
    real: frozenset[str] = frozenset()
    config: RobotConfig | None = None
    seed: int = 0
    step_ns: int = STEP_NS
    watchdog_ns: int = WATCHDOG_NS
    logical_ns: int | None = None


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
    devices = _devices(options, clock)
    with _listening(options.path) as listener, selectors.DefaultSelector() as selector:
        server = _Server(devices, listener, selector, clock, logical_ns=options.logical_ns)
        ready()
        try:
            while not stop():
                server.step()
        finally:
            server.close()


def _devices(options: PlantOptions, clock: Callable[[], int]) -> Devices:
    if options.logical_ns is not None and len(options.robots) != 1:
        raise ValueError(f"logical time with {len(options.robots)} robots; expected 1")
    body = options.body
    config = options.config or (rome_config() if body is None else config_of(body))
    scenery = populated_scenery(options)
    world = World(walls=scenery, poses=list(options.robots.values()), config=config, seed=options.seed)
    given = GivenFields()
    robot_devices = [_robot_devices(options, world, robot, given) for robot in range(len(world))]
    cameras = _cameras(options, scenery, config.radius_mm)
    devices = Devices(
        world,
        tuple(options.robots),
        cameras,
        robot_devices,
        given=given,
        now_ns=clock(),
        step_ns=options.step_ns,
        watchdog_ns=options.watchdog_ns if options.logical_ns is None else None,
    )
    for name in cameras:  # warm up, so that the first real images and readings are not slow
        devices.image(0, name)
    for server in robot_devices[0]:
        devices.device(0, server)
    if config.channels:
        world.sonar(0)
    return devices


def populated_scenery(options: PlantOptions) -> Scenery:
    """Return the scenery of a plant, with all of its people.

    Raises:
        DiagnosticError: a grid is to have hazards.
        NoRoomError: there is no room for people.
    """
    scenery = scenery_of(options.world, options.hazards, options.hazards_seed)
    if not (options.movers and options.robots):
        return scenery
    (x, y, _), *_ = options.robots.values()
    return with_movers(scenery, lambda: FreeSpace(options.world), (x, y), options.movers, seed=options.seed)


def _cameras(options: PlantOptions, scenery: Scenery, radius_mm: float) -> dict[str, RobotCamera]:
    if not options.cameras:
        return {}
    scene = scene_of(options.world.building("a camera"), scenery)
    return {
        name: CeilingCamera(scenery, config)
        if isinstance(config, CeilingCameraConfig)
        else Camera(scene, config, robot_radius_mm=radius_mm, seed=options.seed)
        for name, config in options.cameras.items()
    }


def _robot_devices(
    options: PlantOptions, world: World, robot: int, given: GivenFields
) -> Mapping[str, RobotDevice]:
    """Return the devices of a robot besides its base, ring and cameras, by the names of their servers."""
    body = options.body
    if body is None:
        return {}
    servers = tuple(server for server in servers_of(body) if server.name not in options.real)
    return devices_of(body, servers, world, robot, seed=options.seed, given=given.of(robot))


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
