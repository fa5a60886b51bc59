"""The policy for losses where others drive too, over some seeds (`make loss` is for many); bugs are found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial

import pytest

from colony.runtime.arbitration.frame_bounds import BoundedCommand, FrameBounds
from colony.runtime.servers.commanding import CommandDispatcher
from tests.found_seeds import find_seed
from tests.sampling import sampled, thorough
from tools.loss.outside import VARIANTS, proved, run
from tools.loss.outside_stage import variant
from tools.loss.seeds import fails

SEEDS = 120
GROUPS = 40


@pytest.mark.parametrize("group", sampled(range(GROUPS), every=GROUPS, thorough=True))
def test_outside(group: int) -> None:
    totals = Counter[str]()
    for seed in range(group * SEEDS // GROUPS, (group + 1) * SEEDS // GROUPS):
        totals += run(seed)
    assert totals["commands from outside"] > 5


@pytest.mark.parametrize("number", sampled(range(VARIANTS), every=4))
def test_what_must_hold_is_proved_with_operators(number: int) -> None:
    program = variant(number, 100)
    safe = {c.name for c in program.contracts if c.name.startswith("safe")}
    assert len(safe) == 5
    assert safe <= proved(program)


# --- would it notice? --------------------------------------------------------------------------------


def limits_ignored(patch: pytest.MonkeyPatch) -> None:
    """Commands from outside are not held to the limits."""
    patch.setattr(FrameBounds, "apply", lambda self, command: BoundedCommand(command.values))


def bounds_of_another_frame(patch: pytest.MonkeyPatch) -> None:
    """A command is held to the bounds of the last frame whose bounds came."""
    begin = FrameBounds.begin

    def wrong(self: FrameBounds, k: int, *, lost: bool) -> None:
        before = self._bounds
        begin(self, k, lost=lost)
        self._bounds = self._bounds or before

    patch.setattr(FrameBounds, "begin", wrong)


def sent_after_the_frame(patch: pytest.MonkeyPatch) -> None:
    """A tick that comes late is answered with what was sent after its frame."""
    fields = CommandDispatcher.fields

    def wrong(self: CommandDispatcher, tick: object) -> object:
        self._k = -1
        return fields(self, tick)  # type: ignore[arg-type]

    patch.setattr(CommandDispatcher, "fields", wrong)


def halts_unnoticed(patch: pytest.MonkeyPatch) -> None:
    """What was given before a stop counts as what was given last."""
    patch.setattr(CommandDispatcher, "note_halted", lambda self: None)


@pytest.mark.parametrize(
    "bug",
    [limits_ignored, bounds_of_another_frame, thorough(sent_after_the_frame), thorough(halts_unnoticed)],
)
def test_known_bugs_are_found(
    bug: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    bug(monkeypatch)
    assert find_seed(f"loss outside: {bug.__name__}", range(200), partial(fails, run)) is not None
