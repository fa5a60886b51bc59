"""What is proved holds in runs of drawn programs (`make loss` is for many); what is not proved breaks."""

from __future__ import annotations

import re
from collections import Counter
from functools import partial

import pytest

from colony.runtime.arbitration.ballot import BoundedCommand, FrameBounds
from tests.found_seeds import find_seed
from tests.sampling import sampled
from tools.loss import proved
from tools.loss.proved import run

SEEDS = 40
GROUPS = 40


@pytest.mark.parametrize("group", sampled(range(GROUPS), every=GROUPS, thorough=True))
def test_drawn_programs(group: int) -> None:
    totals = Counter[str]()
    for seed in range(group * SEEDS // GROUPS, (group + 1) * SEEDS // GROUPS):
        totals += run(seed)
    assert totals


def test_commands_that_ignore_limits_break_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FrameBounds, "apply", lambda self, command: BoundedCommand(command.values))
    assert find_seed("proved in runs: limits ignored", range(40), partial(breaks, "operators")) is not None


@pytest.mark.parametrize("kind", ["late", "operators"])
def test_what_is_not_proved_is_broken(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where contracts that hold undisturbed alone are held against disturbed runs, some are broken."""
    monkeypatch.setattr(proved.Proofs, "holding", lambda self, k: self.proved.always if k == kind else set())
    assert find_seed(f"proved in runs: {kind}", range(200), partial(breaks, kind)) is not None


def breaks(kind: str, seed: int) -> bool:
    """Whether a run of a kind breaks what is proved."""
    try:
        run(seed)
    except AssertionError as problem:
        if not re.match(rf"seed {seed}, {kind}, .* broken, although proved", str(problem)):
            raise
        return True
    return False
