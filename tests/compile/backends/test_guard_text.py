from __future__ import annotations

import pytest

from colony.compile.backends.guard_text import INLINE, GuardText
from colony.compile.guards import Always, And, Guard, ModuleActive, Never, Not, Or, Recently

MS = 1_000_000
A, B, C = 0, 1, 2
MODULES = (ModuleActive("a"), ModuleActive("b"), ModuleActive("c"))


@pytest.mark.parametrize(
    ("guards", "expected"),
    [
        ((Always(),), "always"),
        ((Never(),), "never"),
        ((Or((A, B)), And((C, 3))), "c and (a or b)"),
        ((Or((A, B)), Not(3)), "not (a or b)"),
        ((Not(A), Not(B), And((3, 4)), Not(5)), "a or b"),
        ((Or((A, B)), Recently(3, 250 * MS), Not(4)), "not recently(a or b, 250 ms)"),
        ((And((B, C)), And((A, 3))), "a and b and c"),
    ],
)
def test_writing(guards: tuple[Guard, ...], expected: str) -> None:
    assert GuardText((*MODULES, *guards)).text(2 + len(guards)) == expected


def test_a_clients_own_activity_is_first_and_called_p() -> None:
    assert GuardText((*MODULES, Not(A), And((3, C)))).text(4, own="c") == "P and not a"


def test_its_activity_is_called_p_where_it_is_negated_too() -> None:
    text = GuardText((*MODULES, Not(A), Not(B), And((3, 4, C)), Not(5)))
    assert text.text(6, own="c") == "not P or a or b"


def test_a_negated_name_counts_as_two_terms() -> None:
    guards: list[Guard] = [ModuleActive(f"m{i}") for i in range(INLINE + 1)]
    long = len(guards)
    guards += [Or(tuple(range(INLINE + 1))), Not(long)]
    guards += [And((long + 1, *range(INLINE - 2))), Not(long + 2)]
    fits = " and ".join(f"m{i}" for i in range(INLINE - 2))
    assert GuardText(guards).text(long + 3) == f"not ({fits} and not $1)"
    guards[long + 2] = And((long + 1, *range(INLINE - 1)))
    assert GuardText(guards).text(long + 3) == "not $1"


def test_long_parts_have_names_and_the_whole_is_linear() -> None:
    guards: list[Guard] = [ModuleActive("m0")]
    for i in range(1, 400):
        guards += [ModuleActive(f"m{i}"), And((len(guards) - 1, len(guards)))]
    text = GuardText(guards)
    written = text.text(len(guards) - 1)
    definitions = text.take_definitions()
    assert written.startswith("$1") or "$1" in written
    assert 30 < len(definitions) < 70
    assert all(len(words) < 120 for _, words in definitions)
    assert text.take_definitions() == []


def test_definitions_up_to_a_limit() -> None:
    guards: list[Guard] = [ModuleActive("m0")]
    for i in range(1, 100):
        guards += [ModuleActive(f"m{i}"), And((len(guards) - 1, len(guards)))]
    text = GuardText(guards)
    text.text(len(guards) - 1)
    assert [name for name, _ in text.take_definitions(2)] == ["$1", "$2"]
    assert text.take_definitions(1)[0][0] == "$3"


def test_deep_nesting_does_not_recurse() -> None:
    guards: list[Guard] = [ModuleActive("a")]
    guards += [Not(at) for at in range(5_000)]
    text = GuardText(guards)
    assert text.text(5_000).startswith("not ")
    assert len(text.take_definitions()) > 100
