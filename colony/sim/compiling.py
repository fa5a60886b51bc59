"""A notice that the simulator is being compiled, which takes long enough to surprise a user."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

COMPILING = "compiling the simulator: some 20 s, once where the result can be kept (see NUMBA_CACHE_DIR)"


@contextmanager
def told_when_compiling(tell: Callable[[str], None]) -> Iterator[None]:
    """Call `tell` with `COMPILING` once, when numba begins to compile; not when it loads from the cache."""
    from numba.core import event

    class Listener(event.Listener):
        def __init__(self) -> None:
            self.told = False

        def on_start(self, event: object) -> None:
            if not self.told:
                self.told = True
                tell(COMPILING)

        def on_end(self, event: object) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield
