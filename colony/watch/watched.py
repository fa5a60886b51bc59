"""What a server shows: a run, recorded or live."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from colony.watch.asking import Asker
from colony.watch.scene import PageScene
from colony.watch.store import SnapshotStore


@dataclass(frozen=True, slots=True, kw_only=True)
class StopAnswer:
    """The result of an emergency stop: True if it is kept, and a sentence."""

    is_kept: bool
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Watched:
    """A run.

    Attributes:
        scene: what is shown of the program.
        store: the snapshots.
        is_live: True if the run goes on.
        explain: function that returns the reason why a module did or did not command in frame k, as lines;
            it may block. None if nobody can answer.
        stop: function that stops the robot in an emergency; it may block. None without the right to.
        tune: function that gives tunable params values in their declared units, by name, and returns a
            sentence about them; it may block. None without the right to.
        asker: asks the robot for what frames do not have while a page is open; None without such a robot.
    """

    scene: PageScene
    store: SnapshotStore
    is_live: bool
    explain: Callable[[int, str], tuple[str, ...]] | None = None
    stop: Callable[[], StopAnswer] | None = None
    tune: Callable[[Mapping[str, float]], str] | None = None
    asker: Asker | None = None
