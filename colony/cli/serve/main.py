"""`colony serve`: one server of a robot in the foreground, or all of them, with simulated or real devices."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.outputs import map_option
from colony.cli.reporting import report, say
from colony.cli.robot_choice import chosen_robot, robot_and_description_option
from colony.cli.robot_options import reporting_connection_errors
from colony.cli.run.options import (
    OptionError,
    camera_option,
    movers_option,
    seed_option,
    start_option,
    world_spec,
)
from colony.extras import expect_extras
from colony.files import user_folder

if TYPE_CHECKING:
    from colony.cli.serve.processes import ServeSpec
    from colony.execute.compiled import Compiled
    from colony.runs.described import DescribedRobot
    from colony.runtime.protocol.interface import Interface
    from colony.text.diagnostics import Diagnostic

ALL = "all"

COMMON = ("Clock", "DServer", "CServer", "Simulator", "Limits", "Gateway", ALL)
"""The names that every robot has."""


class Folder(click.Path):
    """A parameter type for folder names; an empty name, which would be the current folder, is refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the folder's path."""
        if value == "":
            self.fail("found an empty name; expected the name of a folder", param, ctx)
        return super().convert(value, param, ctx)


@click.command(name="serve", short_help="run the servers of a robot")
@click.argument("server", metavar="SERVER")
@robot_and_description_option(
    "The name by which programs find the robot, and its description (one that comes with colony, one in the "
    "folder robots, or a path), by default the one called NAME. Its limits hold whether or not a program "
    "runs, and programs that were checked against another interface are refused. A robot whose name is that "
    "of no description has the devices of RoME, and takes any program.",
    required=True,
)
@map_option
@start_option
@movers_option
@click.option(
    "--hardware",
    is_flag=True,
    help="Serve real devices, by the drivers that the robot's body names; with --map simulate all others.",
)
@click.option(
    "--read-only",
    is_flag=True,
    help="With --hardware: command nothing, for `colony shadow` beside the ROS 2 controller that drives.",
)
@click.option(
    "--port",
    metavar="PORT",
    help="Serve real devices at this serial port, or tcp:HOST:PORT, in place of the one in the robot's body.",
)
@click.option(
    "--baud", type=click.IntRange(min=50), help="With --port: the baud rate, in place of the driver's."
)
@seed_option
@click.option(
    "--hazards",
    type=click.IntRange(min=0),
    metavar="SEED",
    help="Simulate hazards drawn from this seed: people, open doors, broken lights and more.",
)
@camera_option()
@click.option(
    "--state",
    type=Folder(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="The folder of DServer's data and of the emergency stop. [default: ~/.local/state/colony/NAME]",
)
@click.option("--fsync", is_flag=True, help="Make DServer's data survive a power failure.")
@click.option("--isolate", is_flag=True, help="With all: run each server in a process of its own.")
@click.option(
    "--listen",
    metavar="ENDPOINT",
    help="Accept connections from other machines at tls/HOST:PORT (Gateway, all).",
)
@click.option(
    "--security",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="With --listen: the table of users, in TOML.",
)
def command(server: str, **arguments: Any) -> None:
    """Run the servers of a robot until Ctrl-C. Programs drive it with `colony drive FILE --robot NAME`.

    SERVER is Clock (the frames), DServer (variables and semaphores), a server of the robot's description,
    such as RServer (the base) or PServer (sonars and infrared detectors), CServer (a camera), Limits (those
    of the description, while no program runs), Simulator (in place of the hardware), Gateway (connections
    from other machines), or `all`. With `all` the servers share a process, but for cameras and those with
    drivers of real devices; a process that dies is restarted.

    With --hardware each server has the driver of its real device, as the body of the robot says
    (docs/robots.md); with --map besides, devices without a driver are simulated. A driver that cannot be
    made, because its device is not connected, is tried again.

    A server stops its hardware when it ends. A server that already runs under the same name is not started.

    With --port, which implies --hardware, all drivers whose table in the body has a `port` get this one
    (docs/drivers.md).

    \b
    Example:
      colony serve all --robot rome --map loop
      colony serve all --robot rome --map loop --listen tls/0.0.0.0:7447 --security users.toml
      colony serve all --robot lab=rome --map loop
      colony serve Simulator --robot rome --map loop
      colony serve RServer --robot rome
      colony serve all --robot s1=scout --hardware
      colony serve all --robot s1=scout --hardware --map loop
      colony serve all --robot s1=scout --port /dev/ttyUSB0
    """
    from colony.cli.interruption import interruptible
    from colony.cli.run.running import reporting_failures
    from colony.cli.serve.serving import serve_all, serve_one
    from colony.runtime.transport.live.robot_address import local

    robot = arguments.pop("robot")
    with reporting_failures(), reporting_connection_errors():
        spec = serve_spec(arguments | {"state": arguments["state"] or _state_folder(robot)})
        server = server_named(server, spec)
        if (reason := objection(server, spec)) is not None:
            raise OptionError(reason)
        if spec.world.map_path is not None:
            expect_extras("sim")
        if spec.hardware:
            report(_unwatched(spec, server))
        robot_address = local(robot, os.environ)
        robot_address.directory.prepare()
        if server == ALL:
            serve_all(robot_address, spec, say, interruptible("ending the servers"))
        else:
            serve_one(server, robot_address, spec, say)


def serve_spec(options: Mapping[str, Any]) -> ServeSpec:
    """Return the robot that options describe, and its servers.

    An option whose name is that of a field of `ServeSpec` or `WorldSpec` becomes this field. Exits with 1 if
    the description has errors.
    """
    from colony.cli.serve.processes import ServeSpec

    described, interface, limits = described_to_serve()
    own = {field.name: options[field.name] for field in fields(ServeSpec) if field.name in options}
    own |= {
        "described": described,
        "world": world_spec(options),
        "interface": interface,
        "limits": None if options.get("read_only") else limits,
        "hardware": options["hardware"] or options["port"] is not None,
    }
    return ServeSpec(**own)


def objection(server: str, spec: ServeSpec) -> str | None:
    """Return the reason why the settings do not fit this server; None if they do."""
    if spec.read_only and (text := _read_only_objection(spec)) is not None:
        return text
    if spec.hardware:
        if (text := _hardware_objection(server, spec)) is not None:
            return text
    elif server == ALL and spec.world.map_path is None:
        return "all requires --map MAP, the building of the robot, or --hardware, for its real devices"
    if spec.baud is not None and spec.port is None:
        return "--baud requires --port; the body may give its driver a `baud` as well"
    if server == "Simulator" and spec.world.map_path is None:
        return f"{server} requires --map MAP, the building of the robot"
    world_options = {
        "--hazards": spec.world.hazards is not None,
        "--movers": spec.world.movers > 0,
        "--start": spec.world.start is not None,
    }
    option = next((name for name, is_given in world_options.items() if is_given), None)
    if server not in ("Simulator", ALL) and option is not None:
        return f"{option} requires Simulator or all, which simulate the building; found {server}"
    if spec.isolate and server != ALL:
        return f"--isolate requires all; found {server}"
    if server == "CServer" and len(spec.world.cameras) != 1:
        return "CServer requires one --camera [NAME=]DEGREES|up, the camera of the Simulator that it serves"
    if server == "Limits" and spec.limits is None:
        return "Limits requires a description with limits: --robot NAME=DESCRIPTION"
    if server == "Gateway" and spec.listen is None:
        return "Gateway requires --listen tls/HOST:PORT"
    if (spec.listen is None) != (spec.security is None):
        return "--listen and --security require each other: the table of users decides who may connect"
    if spec.listen is not None and server not in ("Gateway", ALL):
        return f"--listen requires Gateway or all; found {server}"
    return None


def _read_only_objection(spec: ServeSpec) -> str | None:
    from colony.runs.ros2_devices import is_on_topics

    if not spec.hardware or spec.world.map_path is not None or spec.port is not None:
        return "--read-only requires --hardware, without --map and --port"
    others = [name for name, driver in spec.devices.hardware.items() if not is_on_topics(driver)]
    if others:
        return f"--read-only is for robots on topics of ROS 2: {others[0]} has a driver"
    return None


def _hardware_objection(server: str, spec: ServeSpec) -> str | None:
    if server == "Simulator" or (server != ALL and spec.world.map_path is not None):
        return "--hardware is for real devices: with a map it requires `all`, which simulates the others"
    if spec.world.map_path is None and spec.world.requires_simulation:
        options = "--camera, --hazards, --movers, --start"
        return f"--hardware without --map is for real devices alone: leave out {options}"
    if not spec.devices.hardware:
        name = spec.described.body.robot.name
        return f"--hardware: the body of `{name}` names no driver: `hardware = {{ driver = ... }}`"
    if server in spec.devices.absent:
        return f"--hardware: the body names no driver for {server}: `hardware = {{ driver = ... }}`"
    return None if spec.port is None else _port_objection(spec)


def _port_objection(spec: ServeSpec) -> str | None:
    from colony.cli.serve.processes import ports, real_devices

    found = ports(real_devices(spec.described))
    if len(found) == 1:
        return None
    body = f"the body of `{spec.described.body.robot.name}`"
    if not found:
        return f"--port: {body} gives no driver a port: `hardware = {{ driver = ..., port = ... }}`"
    return f"--port: {body} has the ports {', '.join(found)}: write there which driver has which"


def _unwatched(spec: ServeSpec, server: str) -> tuple[Diagnostic, ...]:
    """Return the warnings of served devices that nothing stops when their computer fails."""
    from colony.body.disagreements import unwatched_devices
    from colony.body.reader import read_body

    path = spec.described.path
    if path is None:
        return ()
    file = read_body(path)
    described, servers = spec.described, None if server == ALL else (server,)
    return tuple(unwatched_devices(described.interface, described.body, file, servers))


def server_named(text: str, spec: ServeSpec) -> str:
    """Return the server that a user named, in any case.

    Raises:
        OptionError: neither the robot's description nor `COMMON` has a server of this name.
    """
    from colony.cli.serve.processes import served_names
    from colony.text.wording import did_you_mean

    names = (*COMMON, *served_names(spec.described), *spec.world.cameras)
    found = next((name for name in names if name.casefold() == text.casefold()), None)
    if found is not None:
        return found
    hint = did_you_mean(text, names) or f"expected {', '.join(dict.fromkeys(names))}"
    raise OptionError(f"`{spec.described.body.robot.name}` has no server `{text}`; {hint}")


def described_to_serve() -> tuple[DescribedRobot, Interface | None, Compiled | None]:
    """Return the robot that the options describe, RoME if they give no more than an unknown name.

    The interface is what programs must have been checked against. The compiled program is the description's
    limits. Both are None without a description, and the second also for a description without limits.

    Exits with 1 if the description has errors.
    """
    from colony.compile.pipeline import compile_program
    from colony.dsl.descriptions import existing_choice
    from colony.runs.described import described_program, described_robot, rome
    from colony.runtime.protocol.deployment import limited_actuators
    from colony.runtime.protocol.interface import interface_of
    from colony.text.diagnostics import DiagnosticError

    choice = existing_choice(chosen_robot(), Path())
    if choice is None:
        return rome(), None, None
    try:
        program = described_program(choice)
        described = described_robot(program.robot)
    except DiagnosticError as failure:
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_ERRORS) from None
    compiled = compile_program(program).compiled
    return described, interface_of(program.robot), compiled if limited_actuators(compiled) else None


def _state_folder(robot: str) -> Path:
    environment = {"HOME": os.path.expanduser("~"), **os.environ}
    folder = user_folder(environment, "XDG_STATE_HOME", ".local/state")
    if folder is None:
        raise click.UsageError("this user has no home folder: give --state FOLDER")
    return folder / robot
