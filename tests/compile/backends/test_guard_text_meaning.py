"""The text of a guard means what the guard does."""

from __future__ import annotations

import re
from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.compile.backends.guard_text import INLINE, OWN, GuardText
from colony.compile.guards import Always, And, Guard, ModuleActive, Never, Not, Or, Recently

NAMES = ("a", "b", "c", "d")
LEAVES: tuple[Guard, ...] = (Always(), Never(), *map(ModuleActive, NAMES))


@st.composite
def tables(draw: st.DrawFn) -> list[Guard]:
    """Guards over four modules, each of operands before it; some of them long."""
    table = [*LEAVES]
    for _ in range(draw(st.integers(1, 25))):
        before = st.integers(0, len(table) - 1)
        kind = draw(st.sampled_from((Not, And, Or, And, Or)))
        operands = tuple(draw(st.lists(before, min_size=2, max_size=5)))
        table.append(Not(operands[0]) if kind is Not else kind(operands))
    return table


def value(table: list[Guard], active: dict[str, bool]) -> list[bool]:
    """Of every guard."""
    found: list[bool] = []
    for guard in table:
        match guard:
            case ModuleActive(module=module):
                found.append(active[module])
            case Not(operand=operand):
                found.append(not found[operand])
            case And(operands=parts):
                found.append(all(found[part] for part in parts))
            case Or(operands=parts):
                found.append(any(found[part] for part in parts))
            case _:
                found.append(isinstance(guard, Always))
    return found


def read(text: str, known: dict[str, str], active: dict[str, bool], own: str | None) -> bool:
    """The text as Python reads it, with the parts that have names put in."""
    names: dict[str, bool] = {**active, "always": True, "never": False}
    if own is not None:
        names[OWN] = active[own]
    for name in re.findall(r"\$\d+", text):
        names[f"part_{name[1:]}"] = read(known[name], known, active, None)
    return bool(eval(text.replace("$", "part_"), {}, names))


@given(tables(), st.sampled_from((None, *NAMES)))
def test_the_text_has_the_value_of_the_guard(table: list[Guard], own: str | None) -> None:
    text, known = GuardText(table), dict[str, str]()
    for ref in range(len(table)):
        written = text.text(ref, own)
        known.update(text.take_definitions())
        for chosen in product((False, True), repeat=len(NAMES)):
            active = dict(zip(NAMES, chosen, strict=True))
            assert read(written, known, active, own) is value(table, active)[ref], (written, known)


A, B, C, D = 2, 3, 4, 5


@pytest.mark.parametrize(
    ("guards", "own", "expected"),
    [
        ((Not(A), Not(B), And((6, 7)), Not(8)), "b", "a or P"),
        ((Not(A), Not(B), Or((6, 7)), Not(8)), "b", "a and P"),
        ((Not(A), Not(B), Or((6, 7, C)), Not(8)), None, "a and b and not c"),
        ((Not(A), Or((6, B)), Not(7)), None, "not (not a or b)"),
        ((Recently(A, 250_000_000),), "a", "recently(P, 250 ms)"),
        ((Or((A, B)), Recently(6, 10), Not(7), And((8, A))), "a", "P and not recently(P or b, 0.00001 ms)"),
        ((And((A, B)), Or((6, C)), And((7, D))), None, "d and (c or (a and b))"),
        ((Or((A, B)), Or((6, C)), And((7, D, A))), None, "a and d and (a or b or c)"),
        ((And((C, A)), And((6, A)), Not(7)), None, "not (a and c)"),
        (
            (
                Not(C),
                And((6, C, B, A)),
            ),
            "b",
            "P and a and not c and c",
        ),
    ],
)
def test_writing(guards: tuple[Guard, ...], own: str | None, expected: str) -> None:
    assert GuardText((*LEAVES, *guards)).text(5 + len(guards), own) == expected


def chain(length: int, *more: Guard) -> list[Guard]:
    """A conjunction of so many modules, and guards of it."""
    modules = [ModuleActive(f"m{i}") for i in range(length)]
    return [*modules, And(tuple(range(length))), *more]


def test_a_part_gets_a_name_if_it_is_longer_than_may_be() -> None:
    for length, named in ((INLINE, False), (INLINE + 1, True)):
        table = chain(length, Recently(length, 1_000_000_000), Not(length), Or((length, 0)))
        for ref, around in (
            (length + 1, "recently({}, 1 s)"),
            (length + 2, "not {}"),
            (length + 3, "m0 or {}"),
        ):
            text = GuardText(table)
            whole = " and ".join(f"m{i}" for i in range(length))
            inner = "$1" if named else whole if "recently" in around else f"({whole})"
            assert sorted(text.text(ref).split(" or ")) == sorted(around.format(inner).split(" or "))
            assert text.take_definitions() == ([("$1", whole)] if named else [])


def test_negations_and_windows_count_as_terms_unless_of_a_module() -> None:
    for extra, named in ((Not(INLINE - 1), True), (Recently(INLINE - 1, 5), True)):
        table = [*chain(INLINE - 1), extra, And((INLINE, 0)), Not(INLINE + 1)]
        text = GuardText(table)
        text.text(INLINE + 2)
        assert bool(text.take_definitions()) is named
    modules = [ModuleActive(f"m{i}") for i in range(INLINE)]
    table = [*modules, Not(0), And((INLINE, *range(1, INLINE))), Not(INLINE + 1)]
    text = GuardText(table)
    text.text(INLINE + 2)
    assert text.take_definitions() == []
