"""What the compiler says of wirings."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.compile.backends.explain import MAX_DEPTH, MAX_LINES, explain, wiring_text
from colony.compile.pipeline import compile_program
from colony.ir.program import Chain, Use
from tests.case_files import Case, cases
from tests.networks import chain, ladder, random_program
from tests.sampling import long
from tests.wiring import program

CASES = cases(Path(__file__).parent / "cases" / "explain.txt")


@pytest.mark.parametrize("case", CASES)
def test_case(case: Case) -> None:
    case.check(explain(compile_program(program(case.given))))


def test_both_networks_of_figure_4_14_are_visited_alike() -> None:
    texts = [case.expected for (case,) in (one.values for one in CASES) if "figure 4 14" in case.title]
    one, other = (text[text.index("The forward traversal") :] for text in texts)
    assert "D-C-B-A" in one
    assert one == other


@pytest.mark.parametrize("large", [chain(5_000), ladder(5_000), long(random_program(5_000, seed=1))])
def test_large_programs_are_cut(large) -> None:
    text = explain(compile_program(large))
    assert "left out" in text
    assert len(text.splitlines()) < 12 * MAX_LINES
    assert max(map(len, text.splitlines())) < 120 + 3 * MAX_DEPTH


def test_nothing_wired() -> None:
    assert "(nothing is wired)" in explain(compile_program(program("")))


def test_wiring_reads_as_in_the_language() -> None:
    inner = Chain(relation="inhibits", operands=(Use(name="b"), Use(name="c")), windows_ns=(2_000_000_000,))
    outer = Chain(relation="suppresses", operands=(Use(name="a"), inner, Use(name="d")), windows_ns=(0, 0))
    assert wiring_text(outer) == "a suppresses (b inhibits[2 s] c) suppresses d"
    assert wiring_text(outer, max_operands=2) == "a suppresses (b inhibits[2 s] c) suppresses ... (1 more)"
