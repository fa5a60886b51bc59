"""The user interface of a run: reports and progress on standard error, Ctrl-C, and the page of `--watch`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

from colony.cli.interruption import interruptible
from colony.cli.progress import RunProgress
from colony.cli.reporting import say
from colony.runs.spec import UserInterface

if TYPE_CHECKING:
    from colony.execute.compiled import Compiled
    from colony.nav.maps.building import Building
    from colony.runs.spec import RunSpec
    from colony.runtime.kit.script import Script
    from colony.runtime.observe.observer import Sink

# --- the terminal --------------------------------------------------------------------------------


def _operator(building: Building) -> Script:
    """Return a script that asks the user at the terminal to press elevator buttons."""
    from colony.cli.terminal import Terminal
    from colony.nav.missions.elevator_calls import elevator_prompt

    return elevator_prompt(building, Terminal(sys.__stdin__), say=say)


TERMINAL_INTERFACE = UserInterface(
    report=say, interruptible=interruptible, progress=RunProgress, operator=_operator, stands=say
)
"""The interface at the terminal: events go to standard error, and Ctrl-C ends the run."""


# --- the page ------------------------------------------------------------------------------------


@contextmanager
def user_interface(compiled: Compiled, spec: RunSpec, *, watch: bool) -> Iterator[UserInterface]:
    """Lend the interface at the terminal to a run; with `watch` the run has a page, too.

    Raises:
        DiagnosticError: the program cannot be rebuilt for the page from its source files, or the map is
            invalid.
    """
    if not watch:
        yield TERMINAL_INTERFACE
        return
    with _shown_in_browser(compiled, spec.world.map_path, spec.robot) as sink:
        yield replace(TERMINAL_INTERFACE, sinks=(sink,))


@contextmanager
def _shown_in_browser(compiled: Compiled, map_path: str | None, robot: str | None) -> Iterator[Sink]:
    """Serve the page of a run of a robot; the context's value is the sink of its frames.

    `robot` is its name; None for that of its description.

    Raises:
        DiagnosticError: the program cannot be rebuilt from its source files, or the map is invalid.
    """
    from colony.analysis.recording import unpacked_program
    from colony.cli.watch import page_server, scene_for
    from colony.watch.sources import STORE_BYTES, LiveSource
    from colony.watch.store import SnapshotStore
    from colony.watch.trail import RunTrail
    from colony.watch.watched import Watched

    with ExitStack() as resources:
        program = resources.enter_context(
            unpacked_program(compiled.root, compiled.sources, compiled.site, compiled.name)
        )
        scene = scene_for(program, compiled.root, map_path, robot)
        store, trail = SnapshotStore(scene.modules, max_bytes=STORE_BYTES), RunTrail(program)
        resources.callback(store.close)
        source = LiveSource(program, store, trail)
        resources.callback(source.close)
        watched = Watched(scene=scene, store=store, is_live=True, explain=trail.explain)
        say(f"watch at {resources.enter_context(page_server(watched, None)).url}")
        yield source
