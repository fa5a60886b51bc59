"""What calls of functions add, and which of them are refused."""

from __future__ import annotations

from colony.dsl.check.scope import MAX_NODES, Excess, ProgramSize
from colony.ir.expression import NESTING_LIMIT


def call(size: ProgramSize, nodes: int, depth: int = 1, *, in_declaration: bool = False) -> Excess | None:
    """An outermost call of a function, all of whose nodes are beside each other."""
    assert size.begin_outermost_call(in_declaration=in_declaration)
    if size.admits(nodes, depth):
        for _ in range(nodes):
            size.enter_node()
            size.leave_node()
    return size.end_outermost_call()


def test_calls_in_the_program_share_a_budget() -> None:
    size = ProgramSize()
    assert call(size, 60_000) is None
    assert size.budget == MAX_NODES - 60_000
    assert call(size, 60_000) is Excess.SIZE
    assert size.nodes == 60_000  # the second body was not checked
    assert not size.begin_outermost_call(in_declaration=False)


def test_what_a_template_adds_is_given_back_unless_it_is_too_much() -> None:
    size = ProgramSize()
    before = size.budget
    assert call(size, 60_000) is None
    size.refund(before)
    assert size.budget == MAX_NODES
    assert call(size, MAX_NODES + 1) is Excess.SIZE
    size.refund(before)
    assert size.budget < 0


def test_calls_in_declarations_take_nothing_from_the_program() -> None:
    size = ProgramSize()
    size.begin_declaration()
    assert call(size, 15_000, in_declaration=True) is None
    assert call(size, 15_000, in_declaration=True) is None
    assert size.budget == MAX_NODES
    assert size.begin_outermost_call(in_declaration=True)
    assert size.admits(10, 3)
    assert size.count_unchecked(10, 3)
    assert (size.nodes, size.deepest) == (30_010, 3)


def test_a_call_that_nests_too_deep_is_refused_and_breaks_its_declaration() -> None:
    size = ProgramSize()
    size.begin_declaration()
    assert call(size, 1, NESTING_LIMIT, in_declaration=True) is None
    assert not size.is_broken
    assert call(size, 1, NESTING_LIMIT + 1, in_declaration=True) is Excess.DEPTH
    assert size.is_broken
    assert not size.begin_outermost_call(in_declaration=True)


def test_arguments_count_wherever_they_are_read() -> None:
    size = ProgramSize()
    assert size.begin_outermost_call(in_declaration=False)
    assert size.enter_node()
    assert size.add_argument(MAX_NODES - 1, 2)
    assert not size.add_argument(3, 2)
    size.leave_node()
    assert size.end_outermost_call() is Excess.SIZE
