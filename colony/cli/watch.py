"""`colony watch`: a page in the browser that shows a recording, or a robot that runs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.interruption import interruptible
from colony.cli.outputs import BEHAVIOR, map_option
from colony.cli.params_choice import params_option
from colony.cli.recorded import program_for
from colony.cli.reporting import refuse, report, say
from colony.cli.robot_choice import chosen_robot, robot_and_description_option
from colony.cli.robot_options import (
    connect_option,
    reporting_connection_errors,
    robot_address_of,
    security_option,
)
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.analysis.played import PlayedRun
    from colony.ir.program import Program
    from colony.runtime.recordings.recorded import RecordingReader
    from colony.runtime.transport.live.robot_address import RobotAddress
    from colony.watch.foxglove.sinks import FoxgloveServer
    from colony.watch.scene import PageScene
    from colony.watch.serving import PageServer
    from colony.watch.watched import Watched

POLL_S = 0.1

DEFAULT_FOXGLOVE_PORT = 8765
"""The port at which Foxglove looks for a live robot."""

CLOSING = "closing the page"

_Command = TypeVar("_Command", bound=Callable[..., object])


def page_options(command: _Command) -> _Command:
    """Add the options of a page: its port, and whether to open it."""
    port = click.option(
        "--port",
        type=click.IntRange(0, 65535),
        help="The port of the page. [default: 7450, or any that is free]",
    )
    return port(click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")(command))


@click.command("watch", short_help="watch a recording or a running robot in the browser")
@click.argument("recording", metavar="[RECORDING]", required=False)
@click.option(
    "--behavior",
    metavar="FILE",
    type=BEHAVIOR,
    help="The behavior of the recording; an MCAP recording contains it.",
)
@params_option()
@map_option
@page_options
@robot_and_description_option(
    "Watch this robot. While it runs no program, its description, by default the one called NAME, says what "
    "there is to see. For a recording, the description of its robot."
)
@connect_option()
@security_option()
@click.option(
    "--foxglove",
    "foxglove_port",
    type=click.IntRange(0, 65535),
    is_flag=False,
    flag_value=DEFAULT_FOXGLOVE_PORT,
    metavar="[PORT]",
    help=f"Also show the robot in Foxglove, by ws://127.0.0.1:PORT. [default: {DEFAULT_FOXGLOVE_PORT}]",
)
@click.option("--allow-stop", is_flag=True, help="Let the page stop the robot in an emergency.")
@click.option("--allow-tuning", is_flag=True, help="Let the page change tunable params.")
def command(
    recording: str | None,
    behavior: str | None,
    map_path: str | None,
    port: int | None,
    opens: bool,
    robot: str | None,
    connect: str | None,
    security: Path | None,
    foxglove_port: int | None,
    allow_stop: bool,
    allow_tuning: bool,
) -> None:
    """Show a run in the browser: the network with its live wires, every module and its state, sensors,
    commands against their limits, the map and the path, contracts, and late or lost clients.

    A recording can be played at any speed, and searched for the next change of winner, broken contract,
    fault, or late client. With --robot the page shows a robot that runs, as it runs, and lets you look back;
    while no program runs, it shows what the robot senses and is sent. Watching commands nothing,
    unless you give --allow-stop and press the button, or --allow-tuning and move a slider. Behind a gateway
    you need the right to read, for the button the right to stop, and for sliders the right to command.

    The page listens on this machine alone, and its address ends in a token, without which it shows nothing.
    The token stays the same, so that a page reconnects to the next `colony watch`. When the robot runs
    another program, the page shows that.

    \b
    Example:
      colony watch run.mcap
      colony watch run.mcap --map loop --open
      colony watch run.jsonl --behavior wander
      colony watch --robot rome --map loop --allow-stop
      colony watch --robot rome --map loop --foxglove
      colony watch --robot rome --connect tls/rome.lab:7447 --security ada.toml
    """
    context = click.get_current_context()
    if recording is None and robot is None:
        raise click.UsageError("give a RECORDING, or --robot NAME", context)
    rights = {"--allow-stop": allow_stop or None, "--allow-tuning": allow_tuning or None}
    live = {"--connect": connect, "--security": security, "--foxglove": foxglove_port} | rights
    given = [name for name, value in live.items() if value is not None]
    if recording is not None and given:
        raise click.UsageError(f"{given[0]} is for a robot that runs, not for a recording", context)
    if recording is None and behavior is not None:
        raise click.UsageError("--behavior is for a recording: a robot that runs gives its program", context)
    expect_extras("watch", *([] if foxglove_port is None else ["foxglove"]))
    with ExitStack() as resources:
        if recording is not None:
            watched = _recorded(recording, behavior, map_path, resources)
            _serve_page(watched, port=port, opens=opens)
        else:
            assert robot is not None
            with reporting_connection_errors():
                robot_address = robot_address_of(robot, connect, security)
            _watch_live(
                robot,
                robot_address,
                map_path,
                port=port,
                foxglove_port=foxglove_port,
                opens=opens,
                may_stop=allow_stop,
                may_tune=allow_tuning,
            )


def _recorded(recording: str, behavior: str | None, map_path: str | None, resources: ExitStack) -> Watched:
    from colony.analysis.recording import OpenRecording
    from colony.text.diagnostics import DiagnosticError

    try:
        opened = resources.enter_context(OpenRecording.at(recording))
        program, reader = program_for(opened, behavior), opened.reader
        title = Path(recording).name
        if reader.run is not None and reader.run.shadow:
            title += " (SHADOW: nothing of it was sent)"
        scene = scene_for(program, title, map_path, None if reader.run is None else reader.run.robot)
    except DiagnosticError as failure:
        refuse(failure.diagnostics)
    return _read(reader, program, scene, resources)


def _read(reader: RecordingReader, program: Program, scene: PageScene, resources: ExitStack) -> Watched:
    """Return a recording that is read in the background until the resources are released."""
    from colony.watch.sources import RecordingSource
    from colony.watch.store import SnapshotStore
    from colony.watch.trail import RunTrail
    from colony.watch.watched import Watched

    store = SnapshotStore(scene.modules)
    resources.callback(store.close)
    trail = RunTrail(program)
    resources.enter_context(RecordingSource(reader, program, store, trail))
    return Watched(scene=scene, store=store, is_live=False, explain=trail.explain)


def watch_played(runs: Mapping[str, PlayedRun], *, port: int | None, opens: bool) -> None:
    """Serve a page for each run that a proof found, by its title, until the command is interrupted.

    The second page has the next port that is free. Exits with 2 if the port is taken.
    """
    with ExitStack() as resources:
        interrupted = resources.enter_context(interruptible(CLOSING))
        for title, run in runs.items():
            watched = _read(run, run.program, scene_for(run.program, title, None, None), resources)
            server = resources.enter_context(page_server(watched, port))
            click.echo(f"{title}: ", nl=False)
            _tell(server, opens=opens)
            port = None
        while not interrupted():
            time.sleep(POLL_S)


def _watch_live(
    robot: str,
    robot_address: RobotAddress,
    map_path: str | None,
    *,
    port: int | None,
    foxglove_port: int | None,
    opens: bool,
    may_stop: bool,
    may_tune: bool,
) -> None:
    """Show the run of a robot, or the robot without one, and what follows, until interrupted."""
    from colony.files import reason
    from colony.runs.described import NoDescriptionError, served_program
    from colony.text.diagnostics import DiagnosticError
    from colony.watch.joined_run import JoinedRun, Succession, joined_run

    choice = chosen_robot()
    assert choice is not None

    def join() -> AbstractContextManager[JoinedRun]:
        return joined_run(
            robot,
            robot_address,
            description=lambda interface: served_program(interface, choice),
            scene_for=lambda program, title: scene_for(program, title, map_path, robot),
            may_stop=may_stop,
            may_tune=may_tune,
            tap_for=None if foxglove is None else foxglove.tap_for,
        )

    with ExitStack() as resources:
        foxglove = None if foxglove_port is None else foxglove_server(foxglove_port)
        if foxglove is not None:
            resources.callback(foxglove.close)
        with reporting_connection_errors():
            try:
                runs = resources.enter_context(Succession(robot_address, join))
            except DiagnosticError as failure:
                refuse(failure.diagnostics)
        interrupted = resources.enter_context(interruptible(CLOSING))
        server = resources.enter_context(page_server(runs.watched, port))
        _tell(server, opens=opens)
        if foxglove is not None:
            click.echo(f"in Foxglove, open the connection {foxglove.url}")
        while not interrupted():
            time.sleep(POLL_S)
            try:
                runs.follow(server.show)
            except DiagnosticError as failure:
                report(failure.diagnostics)
            except NoDescriptionError as problem:
                say(f"colony: error: {problem}")
            except OSError as problem:
                say(f"colony: error: the next run cannot be shown yet: {reason(problem)}")


def scene_for(program: Program, title: str, map_path: str | None, robot: str | None) -> PageScene:
    """Return the scene of a program, with the footprint of its robot, on a map if there is one.

    `robot` is the name of the robot at run time; None for that of its description.

    Raises:
        DiagnosticError: the map, or the body of the robot, is invalid.
    """
    from colony.compile.pipeline import compile_program
    from colony.runs.described import described_robot
    from colony.watch.scene import footprint_of, scene_of

    world = None
    if map_path is not None:
        expect_extras("sim")
        from colony.nav.maps.world_map import load_world
        from colony.watch.map import map_scene

        world = map_scene(load_world(map_path))
    body = described_robot(program.robot).body
    clients = compile_program(program).compiled.clients
    return scene_of(program, title, clients, world, footprint_of(body), robot)


def _serve_page(watched: Watched, *, port: int | None, opens: bool) -> None:
    """Serve the page of a run until the command is interrupted; exit with 2 if the port is taken."""
    with interruptible(CLOSING) as interrupted, page_server(watched, port) as server:
        _tell(server, opens=opens)
        while not interrupted():
            time.sleep(POLL_S)


def _tell(server: PageServer, *, opens: bool) -> None:
    """Print the address of the page, and open it in the browser if asked to."""
    click.echo(f"watch at {server.url}")
    if opens:
        import webbrowser

        from colony.watch.serving import page_link

        if (link := page_link(os.environ, server.url)) is None or not webbrowser.open(link):
            say("the page cannot be opened from here: open the address")


def foxglove_server(port: int) -> FoxgloveServer:
    """Return a server for Foxglove; exit with 2 if the port is taken."""
    from colony.watch.foxglove.sinks import FoxgloveServer

    try:
        return FoxgloveServer(port)
    except RuntimeError as problem:
        say(f"colony: error: --foxglove: cannot listen on {port}: {problem}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None


def page_server(watched: Watched, port: int | None) -> PageServer:
    """Return a server of the page of a run; exit with 2 if the port is taken."""
    from colony.watch.serving import PageServer, user_token

    try:
        return PageServer(watched, port=port, token=user_token(os.environ))
    except OSError as problem:
        say(f"colony: error: --port: cannot listen on {port}: {problem.strerror}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None
