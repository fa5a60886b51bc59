"""Would agreement notice? Every known compiler bug, planted on purpose, must be caught.

The programs and traces are those of the seeds 0, 1, ...; a bug that none of them shows fails its test. The
seed that showed a bug last is tried first.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache, partial

import pytest

from colony.ir.frame import Outcome
from colony.verify.testing.agreement import EXECUTORS, Factory, disagreement, reference
from tests.drawn.strategies import Run, run_of_seed
from tests.found_seeds import find_seed
from tests.sampling import thorough
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


def disagree(network: bool, executors: Mapping[str, Factory], seed: int) -> bool:
    """Whether the run of a seed shows that executors disagree."""
    (program, trace), expected = drawn(network, seed)
    return disagreement(program, trace, executors, expected) is not None


def seeds(network: bool) -> range:
    return range(NETWORKS if network else PROGRAMS)


@pytest.mark.parametrize("network", [True, thorough(False)], ids=["networks", "programs"])
def test_without_a_bug_there_is_no_disagreement(network: bool) -> None:
    seed = next((s for s in seeds(network) if disagree(network, EXECUTORS, s)), None)
    assert seed is None, f"seed {seed}:\n{disagreement(*drawn(network, seed)[0])}"


@pytest.mark.parametrize("bug", BUGS, ids=[bug.name.replace(" ", "-") for bug in BUGS])
def test_caught(bug: Bug, monkeypatch: pytest.MonkeyPatch) -> None:
    bug.plant(monkeypatch)
    shows = partial(disagree, bug.network, GENERATED if bug.generated else BY_CLIENTS)
    seed = find_seed(bug.name, seeds(bug.network), shows)
    assert seed is not None, f"{bug.name}: not noticed in {NETWORKS if bug.network else PROGRAMS} runs"
    print(f"{bug.name}: noticed with seed {seed}")


def test_bugs_are_distinct() -> None:
    assert len({bug.name for bug in BUGS}) == len(BUGS) >= 20
