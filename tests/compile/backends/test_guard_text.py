"""Guards as text: how they are written, and that the text means what the guard does."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.compile.backends.table import INLINE, OWN, GuardText
from colony.compile.guards import Always, And, Guard, ModuleActive, Never, Not, Or, Recently
from tests.case_files import table
from tests.compile.passes.as_text import guards

CASES = Path(__file__).parent / "cases"
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
def test_the_text_has_the_value_of_the_guard(drawn: list[Guard], own: str | None) -> None:
    text, known = GuardText(drawn), dict[str, str]()
    for ref in range(len(drawn)):
        written = text.text(ref, own)
        known.update(text.take_definitions())
        for chosen in product((False, True), repeat=len(NAMES)):
            active = dict(zip(NAMES, chosen, strict=True))
            assert read(written, known, active, own) is value(drawn, active)[ref], (written, known)


@pytest.mark.parametrize(("guard", "expected"), table(CASES / "guard_text.table"))
def test_writing(guard: str, expected: str) -> None:
    text, _, own = guard.partition(" @ ")
    whole = guards(text, *NAMES)
    assert GuardText(whole).text(len(whole) - 1, own or None) == expected


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


def test_a_negated_name_counts_as_two_terms() -> None:
    parts: list[Guard] = [ModuleActive(f"m{i}") for i in range(INLINE + 1)]
    long = len(parts)
    parts += [Or(tuple(range(INLINE + 1))), Not(long)]
    parts += [And((long + 1, *range(INLINE - 2))), Not(long + 2)]
    fits = " and ".join(f"m{i}" for i in range(INLINE - 2))
    assert GuardText(parts).text(long + 3) == f"not ({fits} and not $1)"
    parts[long + 2] = And((long + 1, *range(INLINE - 1)))
    assert GuardText(parts).text(long + 3) == "not $1"


def test_long_parts_have_names_and_the_whole_is_linear() -> None:
    parts: list[Guard] = [ModuleActive("m0")]
    for i in range(1, 400):
        parts += [ModuleActive(f"m{i}"), And((len(parts) - 1, len(parts)))]
    text = GuardText(parts)
    written = text.text(len(parts) - 1)
    definitions = text.take_definitions()
    assert written.startswith("$1") or "$1" in written
    assert 30 < len(definitions) < 70
    assert all(len(words) < 120 for _, words in definitions)
    assert text.take_definitions() == []


def test_definitions_up_to_a_limit() -> None:
    parts: list[Guard] = [ModuleActive("m0")]
    for i in range(1, 100):
        parts += [ModuleActive(f"m{i}"), And((len(parts) - 1, len(parts)))]
    text = GuardText(parts)
    text.text(len(parts) - 1)
    assert [name for name, _ in text.take_definitions(2)] == ["$1", "$2"]
    assert text.take_definitions(1)[0][0] == "$3"


def test_deep_nesting_does_not_recurse() -> None:
    parts: list[Guard] = [ModuleActive("a")]
    parts += [Not(at) for at in range(5_000)]
    text = GuardText(parts)
    assert text.text(5_000).startswith("not ")
    assert len(text.take_definitions()) > 100
