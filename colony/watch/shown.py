"""The run that pages show, and its successors."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from colony.watch.watched import Watched


class Shown:
    """The run that all pages show. Mutable; threads may share it.

    Args:
        watched: the first run.
    """

    def __init__(self, watched: Watched) -> None:
        self._changed = threading.Condition()
        self._watched = watched
        self._pages = Counter[int]()

    @contextmanager
    def page(self) -> Iterator[Watched]:
        """Count a page as long as the context lasts; its value is the run that it shows."""
        with self._changed:
            watched = self._watched
            self._pages[id(watched)] += 1
        try:
            yield watched
        finally:
            with self._changed:
                self._pages[id(watched)] -= 1
                self._changed.notify_all()

    def is_shown(self, watched: Watched) -> bool:
        """Return False if another run has taken the place of this one."""
        return self._watched is watched

    def show(self, watched: Watched) -> None:
        """Show another run; wait until no page shows the one before, which may be closed then."""
        with self._changed:
            before, self._watched = self._watched, watched
            self._changed.wait_for(lambda: not self._pages[id(before)])
