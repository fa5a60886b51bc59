"""The silence of a robot that is watched, which pages must show."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from colony.watch.store import SnapshotStore

SILENCE_S = 2.0
"""Seconds without a frame after which a robot counts as silent."""

CHECK_INTERVAL_S = 0.5
"""Seconds between two checks for silence."""


class Heard(Protocol):
    """A sink that gets the frames of a robot."""

    @property
    def heard_s(self) -> float:
        """Time at which the last frame came, by this machine's monotonic clock."""
        ...


@contextmanager
def noting_silence(sink: Heard, store: SnapshotStore, text: str) -> Iterator[None]:
    """Say `text` in the store whenever a robot is silent, as long as the context lasts."""
    ended = threading.Event()

    def check() -> None:
        said = None
        while not ended.wait(CHECK_INTERVAL_S):
            is_silent = time.monotonic() - sink.heard_s > SILENCE_S
            if is_silent and store.problem is None:
                store.problem = said = text
            elif not is_silent and said is not None and store.problem == said:
                store.problem = said = None

    thread = threading.Thread(target=check, name="silence", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
