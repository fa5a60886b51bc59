"""The search finds shortest traces, and says how far there are none."""

from __future__ import annotations

import pytest
import z3

from colony.verify.contracts.results import ProofOptions
from colony.verify.contracts.search import Search
from colony.verify.contracts.slicing import cone_of
from colony.verify.contracts.solver import Budget
from colony.verify.symbolic.system import System
from tests.verify.contracts.systems import NOW, counter, delay, system


def search(made: System) -> Search:
    [claim] = made.claims
    return Search(cone_of(made, claim), claim, Budget(ProofOptions()))


def shortest(made: System, most: int) -> int | None:
    """How many frames the shortest trace that breaks the only contract has."""
    searching = search(made)
    while searching.length < most:
        for candidate in searching.search_next_length():
            assert candidate.frames == searching.length
            return candidate.frames
        assert searching.safe_length == searching.length
    return None


@pytest.mark.parametrize("limit", [0, 1, 4])
def test_a_counter_passes_its_limit_one_frame_after_as_many_ticks(limit: int) -> None:
    made = system([counter()], {"low": z3.Int("count") <= limit})
    assert shortest(made, 10) == limit + 2


def test_a_counter_that_begins_anew_never_passes_it() -> None:
    assert shortest(system([counter(3)], {"low": z3.Int("count") < 3}), 8) is None


def test_frames_are_a_period_apart_where_that_breaks_it_as_well() -> None:
    made = system(delay("a"), {"never": z3.Not(z3.Bool("a"))})
    searching = search(made)
    assert not list(searching.search_next_length())
    candidate = next(iter(searching.search_next_length()))
    assert candidate.model.eval(searching.frames.at(1, NOW)).as_long() == made.program.robot.frame_ns


def test_frames_are_at_other_times_where_only_that_breaks_it() -> None:
    searching = search(system([], {"soon": NOW <= 50_000_000}))
    assert not list(searching.search_next_length())
    candidate = next(iter(searching.search_next_length()))
    assert candidate.model.eval(searching.frames.at(1, NOW)).as_long() > 50_000_000


def test_a_search_that_is_left_early_goes_on_with_longer_traces() -> None:
    searching = search(system(delay("a"), {"never": z3.Not(z3.Bool("a"))}))
    for _ in range(4):
        for _candidate in searching.search_next_length():
            break
    assert searching.length == 4
    assert searching.safe_length == 1
