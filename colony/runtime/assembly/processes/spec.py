"""The spec of a robot's process: the address of the robot, and the part that the process runs.

It is a small JSON file in a private folder of the user. If the part needs a compiled program, the program and
its bindings are files in the same folder.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

import msgspec

from colony.execute.colonyc import from_shape, shape, to_shape
from colony.files import naming, read_file
from colony.ir.program import DEFAULT_FRAME_NS
from colony.ir.servers import ServerSpec
from colony.ir.types import Value
from colony.runtime.assembly.limits import LIMITS
from colony.runtime.assembly.sharing import ClientProcess, announcer_process_name
from colony.runtime.protocol.bindings import Bindings
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.interface import Interface
from colony.runtime.servers.drivers import (
    BaseDriver,
    BaseLimits,
    CameraDriver,
    DeviceDriver,
    ProximityDriver,
)
from colony.runtime.transport.live.robot_address import Credentials, Local, Remote, RobotAddress
from colony.runtime.transport.live.run_directory import RobotDirectory

# --- spec ----------------------------------------------------------------------------------------------


SPEC_BYTES = 4 * 1024 * 1024
"""Size limit of a spec, in bytes; a spec contains about as much as a command line."""


class LocalAddressSpec(msgspec.Struct, frozen=True, kw_only=True, tag="here"):
    """A robot on this machine, identified by its directory."""

    robot: str
    folder: str


class RemoteAddressSpec(msgspec.Struct, frozen=True, kw_only=True, tag="there"):
    """A robot behind a gateway; `certificate`, `key` and `authority` are paths of the user's PEM files."""

    robot: str
    endpoint: str
    user: str
    certificate: str
    key: str
    authority: str


class Device(msgspec.Struct, frozen=True, kw_only=True, tag="plant"):
    """The address of the simulated devices that a server drives: the socket of the plant."""

    plant: str


class HardwareDriver(msgspec.Struct, frozen=True, kw_only=True, tag="driver"):
    """A driver of a real device: the class `driver`, as `module:Class`, which is called with `options`.

    Drivers with the same `process` share a process. `search_path` are additional folders of its module;
    `origin` is the place that names it, for messages.
    `frame_ns` is the length of the robot's frames, which is given to a driver that has such a parameter.
    A driver that `listens` commands nothing, and hears what another controller commands.
    """

    driver: str
    options: dict[str, str | int | float | bool] = {}
    process: str | None = None
    search_path: tuple[str, ...] = msgspec.field(default=(), name="search")
    origin: str = ""
    frame_ns: int = DEFAULT_FRAME_NS
    listens: bool = False

    def with_options(self, options: Mapping[str, str | int | float | bool]) -> HardwareDriver:
        """Return this driver with options in place of its own, or besides them."""
        return msgspec.structs.replace(self, options={**self.options, **options})


PORT = "port"
"""The option of a driver that has the port of its device."""


class ClockPart(msgspec.Struct, frozen=True, kw_only=True, tag="Clock"):
    """The Clock, with the server `Runtime`.

    `servers` must answer ticks; the file `stop` stores an emergency stop. `interface` is that of the robot's
    description; without parts, any program fits. `resident` has the limits of the description, if there are
    any. With `read_only`, every program is refused.
    """

    servers: tuple[str, ...]
    stop: str
    interface: Interface = Interface()
    resident: Deployment | None = None
    read_only: bool = False


class RServerPart(msgspec.Struct, frozen=True, kw_only=True, tag="RServer"):
    """The server of the base, whose limits are those of the robot's body."""

    device: Device | HardwareDriver
    limits: BaseLimits


class PServerPart(msgspec.Struct, frozen=True, kw_only=True, tag="PServer"):
    """The server of `count` sonars and infrared detectors."""

    device: Device
    count: int


class DevicePart(msgspec.Struct, frozen=True, kw_only=True, tag="device"):
    """The server of any other device; `described` is what it offers, as `encoded_server` writes it."""

    device: Device | HardwareDriver
    described: msgspec.Raw

    @property
    def server(self) -> ServerSpec:
        """What the server offers."""
        return decoded_server(self.described)


class CServerPart(msgspec.Struct, frozen=True, kw_only=True, tag="CServer"):
    """The server of the camera `camera`, under the name `server`."""

    device: Device
    server: str
    camera: str


class DServerPart(msgspec.Struct, frozen=True, kw_only=True, tag="DServer"):
    """The server of variables and semaphores, kept in `store`; with `fsync` they survive a loss of power.

    `pinned_variables` stay fresh in every frame, as if an operator kept setting them.
    """

    store: str
    fsync: bool = False
    pinned_variables: dict[str, Value] = msgspec.field(default_factory=dict, name="held")


class GatewayPart(msgspec.Struct, frozen=True, kw_only=True, tag="Gateway"):
    """The gateway for other machines, listening at `listen`; `security` is the table of users."""

    listen: str
    security: str


class ProgramOfRun(msgspec.Struct, frozen=True, kw_only=True):
    """The file of a run's compiled program; `search_path` are additional folders of its Python modules."""

    run: str
    file: str
    search_path: tuple[str, ...] = msgspec.field(default=(), name="search")


class ClientsPart(msgspec.Struct, frozen=True, kw_only=True, tag="clients"):
    """A process of clients, by actuator and module; `shared` is True for the process that clients share."""

    program: ProgramOfRun
    clients: tuple[tuple[str, str], ...]
    shared: bool


class LimitsPart(msgspec.Struct, frozen=True, kw_only=True, tag="limits"):
    """The process of the limits of the robot's description: the clients of the bounds, and their leader."""

    program: ProgramOfRun


class AnnouncerPart(msgspec.Struct, frozen=True, kw_only=True, tag="announcer"):
    """The process that announces the activity of `module`, which is written in Python."""

    program: ProgramOfRun
    module: str


DevicesPart = RServerPart | PServerPart | CServerPart | DevicePart
"""A server that needs a driver."""

SinglePart = ClockPart | DevicesPart | DServerPart | ClientsPart | LimitsPart | AnnouncerPart


class GroupPart(msgspec.Struct, frozen=True, kw_only=True, tag="group"):
    """Parts that share a process."""

    parts: tuple[SinglePart, ...]


NodePart = SinglePart | GroupPart
Part = NodePart | GatewayPart


def singles(part: NodePart) -> tuple[SinglePart, ...]:
    """Return the parts of a process."""
    return part.parts if isinstance(part, GroupPart) else (part,)


class Spec(msgspec.Struct, frozen=True, kw_only=True):
    """The complete spec of a process."""

    robot_address: LocalAddressSpec | RemoteAddressSpec = msgspec.field(name="place")
    part: Part


_server_decoder: msgspec.json.Decoder[Any] = msgspec.json.Decoder(shape(ServerSpec))


def encoded_server(server: ServerSpec) -> msgspec.Raw:
    """Return what a server offers as JSON, in the shapes of compiled programs."""
    return msgspec.Raw(msgspec.json.encode(to_shape(server, _no_span)))


def decoded_server(described: msgspec.Raw) -> ServerSpec:
    """Return what a server offers.

    Raises:
        msgspec.DecodeError: it is not what `encoded_server` returns.
    """
    server: ServerSpec = from_shape(_server_decoder.decode(described), _no_span)
    return server


def _no_span(span: object) -> Any:
    raise TypeError("the description of a server contains no span")


def write_spec(path: Path, spec: msgspec.Struct) -> None:
    """Write a spec, readable by this user alone.

    Raises:
        OSError: the file cannot be written.
    """
    write_private(path, msgspec.json.encode(spec))


def write_private(path: Path, data: bytes) -> None:
    """Write a file for this user alone, atomically.

    Raises:
        OSError: the file cannot be written.
    """
    temporary = path.with_name(f"{path.name}.{os.getpid()}")
    temporary.unlink(missing_ok=True)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    with naming(temporary), open(os.open(temporary, flags, 0o600), "wb") as file:
        file.write(data)
    temporary.replace(path)


def bindings_of(program: Path) -> Path:
    """Return the path of the bindings of a compiled program."""
    return program.with_suffix(".bindings")


def read_bindings(program: Path) -> Bindings:
    """Read the bindings of a compiled program.

    Raises:
        msgspec.DecodeError: the file contains no bindings.
        OSError: the file cannot be read.
    """
    return msgspec.json.decode(read_file(bindings_of(program), SPEC_BYTES), type=Bindings)


def read_spec(path: Path) -> Spec:
    """Read a spec.

    Raises:
        msgspec.DecodeError: the file is not a spec.
        OSError: the file cannot be read.
    """
    return msgspec.json.decode(read_file(path, SPEC_BYTES), type=Spec)


def address_spec(robot_address: RobotAddress) -> LocalAddressSpec | RemoteAddressSpec:
    """Return the spec of a robot's address."""
    match robot_address:
        case Local(directory=directory):
            return LocalAddressSpec(robot=directory.robot, folder=str(directory.path))
        case Remote(robot=robot, endpoint=endpoint, credentials=credentials):
            return RemoteAddressSpec(
                robot=robot,
                endpoint=endpoint,
                user=credentials.user,
                certificate=str(credentials.certificate),
                key=str(credentials.key),
                authority=str(credentials.authority),
            )


def address_of(spec: LocalAddressSpec | RemoteAddressSpec) -> RobotAddress:
    """Return the address in a spec."""
    match spec:
        case LocalAddressSpec(robot=robot, folder=folder):
            return Local(RobotDirectory(Path(folder), robot))
        case RemoteAddressSpec(robot=robot, endpoint=endpoint):
            credentials = Credentials(
                user=spec.user,
                certificate=Path(spec.certificate),
                key=Path(spec.key),
                authority=Path(spec.authority),
            )
            return Remote(robot=robot, endpoint=endpoint, credentials=credentials)


def name_of(part: Part) -> str:
    """Return the unique name of a part's process: the address of its node, or of its first one."""
    match part:
        case ClockPart():
            return "Clock"
        case RServerPart():
            return "RServer"
        case PServerPart():
            return "PServer"
        case DServerPart():
            return "DServer"
        case CServerPart(server=server):
            return server
        case DevicePart():
            return part.server.name
        case GroupPart(parts=parts):
            return name_of(parts[0])
        case GatewayPart():
            return "Gateway"
        case LimitsPart():
            return LIMITS
        case ClientsPart(clients=clients, shared=shared):
            return ClientProcess(clients, shared).name
        case AnnouncerPart(module=module):
            return announcer_process_name(module)


# --- driver factory ------------------------------------------------------------------------------------
#
# The factory of the drivers of simulated devices, independent of the simulator, and what drivers raise.


class DriverError(Exception):
    """A driver cannot be imported or made; the message has its name, the reason, and the place of it.

    With `is_final` another try would not help: the program of the driver is wrong, not its device.
    """

    def __init__(self, message: str, *, is_final: bool) -> None:
        super().__init__(message)
        self.is_final = is_final


class DriverFactory(Protocol):
    """A factory of drivers. Their times are nanoseconds since `origin_ns` on the machine's monotonic clock.

    Each driver is closed with `resources`.
    """

    def base(
        self, device: Device, robot: str, limits: BaseLimits, origin_ns: int, resources: ExitStack
    ) -> BaseDriver:
        """Return the driver of the base."""
        ...

    def proximity(
        self, device: Device, robot: str, count: int, origin_ns: int, resources: ExitStack
    ) -> ProximityDriver:
        """Return the driver of the proximity sensors."""
        ...

    def camera(
        self, device: Device, robot: str, camera: str, origin_ns: int, resources: ExitStack
    ) -> CameraDriver:
        """Return the driver of a camera."""
        ...

    def device(self, device: Device, robot: str, server: str, resources: ExitStack) -> DeviceDriver:
        """Return the driver of the device of a server."""
        ...
