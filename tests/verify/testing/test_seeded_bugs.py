"""Would agreement notice? Every known compiler bug, planted on purpose, must be caught.

The programs and traces are those of the seeds 0, 1, ...; a bug that none of them shows fails its test.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import pytest

from colony.ir.frame import Outcome
from colony.verify.testing.agreement import EXECUTORS, Factory, disagreement, reference
from colony.verify.testing.strategies import Run, run_of_seed
from tests.sampling import long
from tests.verify.testing.seeded_bugs import BUGS, Bug

NETWORKS = 200
PROGRAMS = 900


BY_CLIENTS = {name: make for name, make in EXECUTORS.items() if name.startswith("clients")}
GENERATED = {name: make for name, make in EXECUTORS.items() if name not in BY_CLIENTS}


@cache
def drawn(network: bool, seed: int) -> tuple[Run, tuple[Outcome, ...]]:
    """A run and what should come of it, once for all bugs."""
    run = run_of_seed(seed, network=network)
    return run, reference(*run)


def caught(network: bool, executors: Mapping[str, Factory]) -> int | None:
    """The first seed whose run shows that executors disagree; None if none does."""
    for seed in range(NETWORKS if network else PROGRAMS):
        (program, trace), expected = drawn(network, seed)
        if disagreement(program, trace, executors, expected) is not None:
            return seed
    return None


@pytest.mark.parametrize("network", [True, long(False)], ids=["networks", "programs"])
def test_without_a_bug_there_is_no_disagreement(network: bool) -> None:
    seed = caught(network, EXECUTORS)
    assert seed is None, f"seed {seed}:\n{disagreement(*drawn(network, seed)[0])}"


@pytest.mark.parametrize("bug", BUGS, ids=[bug.name.replace(" ", "-") for bug in BUGS])
def test_caught(bug: Bug, monkeypatch: pytest.MonkeyPatch) -> None:
    bug.plant(monkeypatch)
    seed = caught(bug.network, GENERATED if bug.generated else BY_CLIENTS)
    assert seed is not None, f"{bug.name}: not noticed in {NETWORKS if bug.network else PROGRAMS} runs"
    print(f"{bug.name}: noticed with seed {seed}")


def test_bugs_are_distinct() -> None:
    assert len({bug.name for bug in BUGS}) == len(BUGS) >= 20
