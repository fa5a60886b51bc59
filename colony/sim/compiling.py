"""A notice that the simulator is being compiled, which takes several seconds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

COMPILING = (
    "compiling the simulator, once if the result can be cached (see NUMBA_CACHE_DIR): a minute or two on an "
    "idle machine; its cameras by themselves, when a command first loads them"
)


@contextmanager
def announcing_compilation(report: Callable[[str], None]) -> Iterator[None]:
    """Call `report` with `COMPILING` when numba begins to compile; not when it loads from its cache."""
    from numba.core import event

    class Listener(event.Listener):
        def __init__(self) -> None:
            self.reported = False

        def on_start(self, event: object) -> None:
            if not self.reported:
                self.reported = True
                report(COMPILING)

        def on_end(self, event: object) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield
