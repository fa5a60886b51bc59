"""Walks over the expressions of a whole program."""

from __future__ import annotations

from collections.abc import Iterator
from typing import assert_never

from colony.ir.expression import Expression, subexpressions
from colony.ir.program import AnyModule, Derived, Let, Machine, Module, Program, PythonModule, State


def all_subexpressions(program: Program) -> Iterator[Expression]:
    """Yield the expressions of a program and all their subexpressions, in the order of `expressions`."""
    for root in expressions(program):
        yield from subexpressions(root)


def expressions(program: Program) -> Iterator[Expression]:
    """Yield all expressions of a program that are evaluated every frame."""
    for derived in program.derived:
        yield from expressions_of_derived(derived)
    for module in program.modules:
        yield from expressions_of(module)
    for limit in program.limits:
        yield from (limit.bound,) if limit.condition is None else (limit.bound, limit.condition)
    yield from (contract.expression for contract in program.contracts)


def expressions_of_derived(derived: Derived) -> Iterator[Expression]:
    """Yield all expressions of a derived value."""
    match derived:
        case Let(expression=expression):
            yield expression
        case State(next=next_value):
            yield from () if next_value is None else (next_value,)
        case Machine(transitions=transitions):
            yield from (t.condition for t in transitions)
        case _:
            assert_never(derived)


def expressions_of(module: AnyModule) -> tuple[Expression, ...]:
    """Return all expressions of a module; it is silent if any of them reads something missing."""
    match module:
        case Module(lets=lets, when=when, command=command, states=states):
            fields = command.fields if command else ()
            next_value = (s.next for s in states if s.next is not None)
            return (*(let.expression for let in lets), when, *fields, *next_value)
        case PythonModule(reads=reads):
            return tuple(r.expression for r in reads)
        case _:
            assert_never(module)
