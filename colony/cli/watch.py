"""`colony watch`: a page in the browser that shows a recording, or a robot that runs."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.interruption import interruptible
from colony.cli.params_choice import choose_params, params_option
from colony.cli.recorded import program_for
from colony.cli.reporting import refuse, say
from colony.cli.robot_choice import description_option
from colony.cli.shipped_files import BEHAVIOR, map_option
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.ir.program import Program
    from colony.watch.scene import Scene
    from colony.watch.watched import Watched

POLL_S = 0.1


@click.command("watch", short_help="watch a recording or a running robot in the browser")
@click.argument("recording", metavar="[RECORDING]", required=False)
@click.option(
    "--behavior",
    metavar="FILE",
    type=BEHAVIOR,
    help="The behavior of the recording; an MCAP recording contains it.",
)
@description_option()
@params_option()
@map_option
@click.option(
    "--port", type=click.IntRange(0, 65535), help="The port of the page. [default: 7450, or any that is free]"
)
@click.option("--open", "opens", is_flag=True, help="Open the page in the browser.")
def command(
    recording: str | None, behavior: str | None, map_path: str | None, port: int | None, opens: bool
) -> None:
    """Show a run in the browser: the network with its live wires, every module and its state, sensors,
    commands against their limits, the map and the path, contracts, and late or lost clients.

    A recording can be played at any speed, and searched for the next change of winner, broken contract,
    fault, or late client.

    The page listens on this machine alone, and its address ends in a token, without which it shows nothing.
    The token stays the same, so that a page reconnects to the next `colony watch`.

    \b
    Example:
      colony watch run.mcap
      colony watch run.mcap --map loop --open
      colony watch run.jsonl --behavior wander
    """
    if recording is None:
        raise click.UsageError("give a RECORDING", click.get_current_context())
    expect_extras("watch")
    with ExitStack() as resources:
        watched = _recorded(recording, behavior, map_path, resources)
        serve_page(watched, port=port, opens=opens)


def _recorded(recording: str, behavior: str | None, map_path: str | None, resources: ExitStack) -> Watched:
    from colony.dsl.site_reading import params_of
    from colony.runtime.recordings.opening import open_recording, read_recording, recorded_site
    from colony.text.diagnostics import DiagnosticError
    from colony.watch.recorded import RecordingSource
    from colony.watch.store import SnapshotStore
    from colony.watch.watched import Watched

    choose_params(params_of(recorded_site(recording)))
    folder = Path(resources.enter_context(TemporaryDirectory(prefix="colony-watch-")))
    try:
        reader = read_recording(resources.enter_context(open_recording(recording)), recording)
        program = program_for(reader, recording, behavior, folder)
        scene = scene_for(program, Path(recording).name, map_path)
    except DiagnosticError as failure:
        refuse(failure.diagnostics)
    store = SnapshotStore(scene.modules)
    resources.callback(store.close)
    resources.enter_context(RecordingSource(reader, program, store))
    return Watched(scene=scene, store=store, is_live=False)


def scene_for(program: Program, title: str, map_path: str | None) -> Scene:
    """Return the scene of a program, with the footprint of its robot, on a map if there is one.

    Raises:
        DiagnosticError: the map, or the body of the robot, is invalid.
    """
    from colony.compile.pipeline import compile_program
    from colony.robots.described import described_robot
    from colony.watch.scene import scene_of
    from colony.watch.surroundings import footprint_of, map_scene

    if map_path is not None:
        expect_extras("sim")
    from colony.nav.maps.world_map import load_world

    world = None if map_path is None else map_scene(load_world(map_path))
    body = described_robot(program.robot).body
    clients = compile_program(program).compiled.clients
    return scene_of(program, title, clients, world, footprint_of(body))


def serve_page(watched: Watched, *, port: int | None, opens: bool) -> None:
    """Serve the page of a run until the command is interrupted; exit with 2 if the port is taken."""
    with interruptible("closing the page") as interrupted, page_of(watched, port) as url:
        click.echo(f"watch at {url}")
        if opens:
            import webbrowser

            webbrowser.open(url)
        while not interrupted():
            time.sleep(POLL_S)


@contextmanager
def page_of(watched: Watched, port: int | None) -> Iterator[str]:
    """Serve the page of a run; the context's value is its address. Exit with 2 if the port is taken."""
    from colony.watch.serving import PageServer
    from colony.watch.token import user_token

    try:
        server = PageServer(watched, port=port, token=user_token(os.environ))
    except OSError as problem:
        say(f"colony: error: --port: cannot listen on {port}: {problem.strerror}")
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    with server:
        yield server.url
