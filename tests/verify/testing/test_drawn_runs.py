"""Runs of fixed seeds, a test each: all executors, and clients alone, do what the reference does."""

from __future__ import annotations

from functools import cache

import pytest

from colony.ir.frame import Outcome
from colony.verify.testing.agreement import EXECUTORS, client_disagreement, disagreement, reference
from tests.drawn.strategies import Run, run_of_seed

SEEDS = [*((True, seed) for seed in range(30)), *((False, seed) for seed in range(90))]


@cache
def drawn(network: bool, seed: int) -> tuple[Run, tuple[Outcome, ...]]:
    """A run (of a network only, or of a whole program) and what should come of it."""
    run = run_of_seed(seed, network=network)
    return run, reference(*run)


def draw_all() -> None:
    """All at once, ahead of the tests."""
    for network, seed in SEEDS:
        drawn(network, seed)


@pytest.mark.parametrize(("network", "seed"), SEEDS)
def test_all_do_what_the_reference_does(network: bool, seed: int) -> None:
    (program, trace), expected = drawn(network, seed)
    found = disagreement(program, trace, EXECUTORS, expected) or client_disagreement(program, trace)
    assert found is None, f"seed {seed}:\n{found}"
