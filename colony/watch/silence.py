"""The silence of a robot that is watched, which pages must show."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager
from typing import Protocol

from colony.runtime.observe.repeating import repeating
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


def noting_silence(sink: Heard, store: SnapshotStore, text: str) -> AbstractContextManager[None]:
    """Return a context in which `text` stands in the store whenever the robot is silent."""
    said: str | None = None

    def check() -> None:
        nonlocal said
        is_silent = time.monotonic() - sink.heard_s > SILENCE_S
        if is_silent and store.problem is None:
            store.problem = said = text
        elif not is_silent and said is not None and store.problem == said:
            store.problem = said = None

    return repeating("silence", check, interval_s=CHECK_INTERVAL_S)
