"""`colony run --watch`: the page of a run, as long as the run lasts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from colony.cli.reporting import say
from colony.cli.watch import page_server, scene_for

if TYPE_CHECKING:
    from colony.execute.compiled import Compiled
    from colony.runtime.observe.observer import Sink


@contextmanager
def shown_in_browser(compiled: Compiled, map_path: str | None, robot: str | None) -> Iterator[Sink]:
    """Serve the page of a run of a robot; the context's value is the sink of its frames.

    `robot` is its name; None for that of its description.

    Raises:
        DiagnosticError: the program cannot be rebuilt from its source files, or the map is invalid.
    """
    from colony.analysis.recording import unpacked_program
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
