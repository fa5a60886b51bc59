"""What is proved holds in runs of drawn programs (`make loss` is for many); what is not proved breaks."""

from __future__ import annotations

from collections import Counter

import pytest

from colony.runtime.arbitration.frame_bounds import BoundedCommand, FrameBounds
from tests.runtime.assembly import proved_in_runs
from tests.runtime.assembly.proved_in_runs import run
from tests.sampling import sampled

SEEDS = 40
GROUPS = 10


@pytest.mark.parametrize("group", sampled(range(GROUPS), every=GROUPS))
def test_drawn_programs(group: int) -> None:
    totals = Counter[str]()
    for seed in range(group * SEEDS // GROUPS, (group + 1) * SEEDS // GROUPS):
        totals += run(seed)
    assert totals["programs"]


def test_commands_that_ignore_limits_break_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FrameBounds, "apply", lambda self, command: BoundedCommand(command.values))
    with pytest.raises(AssertionError, match=r"^seed \d+, operators, .* broken, although proved"):
        run_many(40)


@pytest.mark.parametrize("kind", ["late", "operators"])
def test_what_is_not_proved_is_broken(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where contracts that hold undisturbed alone are held against disturbed runs, some are broken."""
    monkeypatch.setattr(
        proved_in_runs.Proofs, "holding", lambda self, k: self.proved.always if k == kind else set()
    )
    with pytest.raises(AssertionError, match=rf"^seed \d+, {kind}, .* broken, although proved"):
        run_many(200)


def run_many(seeds: int) -> None:
    for seed in range(seeds):
        run(seed)
