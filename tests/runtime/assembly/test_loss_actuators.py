"""The policy for losses with outside connections at every actuator, over some seeds; bugs are found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from colony.runtime.arbitration.ballot import Interventions
from colony.runtime.arbitration.frame_bounds import BoundedCommand, FrameBounds
from colony.runtime.servers.actuating import CommandedActuators
from colony.runtime.servers.outside_commands import OutsideCommands
from tests.found_seeds import find_seed
from tests.sampling import long, sampled
from tools.loss.actuators import VARIANTS, run
from tools.loss.actuators_stage import variant
from tools.loss.outside import proved
from tools.loss.seeds import fails

SEEDS = 120
GROUPS = 40


@pytest.mark.parametrize("group", sampled(range(GROUPS), every=GROUPS, thorough=True))
def test_actuators(group: int) -> None:
    totals = Counter[str]()
    for seed in range(group * SEEDS // GROUPS, (group + 1) * SEEDS // GROUPS):
        totals += run(seed)
    for actuator in ("drive", "lift", "lamp"):
        assert totals[f"commands from outside at {actuator}"] > 5


@pytest.mark.parametrize("number", sampled(range(VARIANTS), every=8, thorough=True))
def test_what_must_hold_is_proved_with_operators(number: int) -> None:
    assert {"safe_slow", "safe_bump", "safe_lift", "safe_lamp"} <= proved(variant(number, 100))


# --- would it notice? --------------------------------------------------------------------------------


def limits_ignored(patch: pytest.MonkeyPatch) -> None:
    """Commands from outside are not held to the limits."""
    patch.setattr(FrameBounds, "apply", lambda self, command: BoundedCommand(command.values))


def stops_ignored(patch: pytest.MonkeyPatch) -> None:
    """An emergency stop does not keep connections from commanding."""
    patch.setattr(OutsideCommands, "stop", lambda self: None)
    interventions = OutsideCommands.interventions

    def wrong(self: OutsideCommands, *arguments: Any) -> Interventions:
        with pytest.MonkeyPatch.context() as unnoticed:
            unnoticed.setattr(self._emergency, "stopped", None)
            return interventions(self, *arguments)

    patch.setattr(OutsideCommands, "interventions", wrong)


def never_made_safe(patch: pytest.MonkeyPatch) -> None:
    """A command of a connection just ends where there is no idle command."""
    patch.setattr(CommandedActuators, "_release", lambda self, commands: self._driven.clear())


def leases_without_end(patch: pytest.MonkeyPatch) -> None:
    """A command of a connection stays in force."""
    patch.setattr("colony.runtime.arbitration.outside.OutsideCommanders.expire", lambda self, now_ns: None)
    patch.setattr(OutsideCommands, "on_lost", lambda self, caller: None)


@pytest.mark.long
@pytest.mark.parametrize(
    "bug", [limits_ignored, never_made_safe, long(stops_ignored), long(leases_without_end)]
)
def test_known_bugs_are_found(
    bug: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    bug(monkeypatch)
    assert find_seed(f"loss actuators: {bug.__name__}", range(200), partial(fails, run)) is not None
