"""What the compiler says of wirings."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.compile.backends import explain as explaining
from colony.compile.backends.explain import MAX_DEPTH, MAX_LINES, explain, wiring_text
from colony.compile.backends.table import GuardText, definitions, legend, rows, wrapped
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


# --- What is large is cut, exactly where it should be, and it is said by how much ---


EXPECTED = Path(__file__).parent / "cases" / "explain_cut.txt"


def narrow(patch: pytest.MonkeyPatch) -> str:
    """The explanations of two large networks where few and short lines are shown."""
    patch.setattr(explaining, "MAX_LINES", 12)
    patch.setattr(explaining, "_WIDTH", 60)
    texts = []
    for size, seed, deepest in ((60, 1, 4), (300, 2, 40)):
        patch.setattr(explaining, "MAX_DEPTH", deepest)
        texts.append(explain(compile_program(random_program(size, seed))))
    return "\n\n\n".join(texts) + "\n"


def test_a_large_network_is_cut_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a change on purpose: `python -m tests.compile.backends.test_explain`, and read the diff."""
    assert narrow(monkeypatch) == EXPECTED.read_text()


def test_nothing_is_cut_up_to_the_limit() -> None:
    text = explain(compile_program(chain(MAX_LINES)))
    assert "more modules left out" not in text
    assert "more visits left out" not in text
    assert "more clients left out" not in text
    assert "(1 more modules left out)" in explain(compile_program(chain(MAX_LINES + 1)))
    assert "... (1 more visits left out)" in explain(compile_program(chain(MAX_LINES + 1)))
    assert "(1 more clients left out)" in explain(compile_program(chain(MAX_LINES + 1)))


def test_wires_are_counted() -> None:
    exact, more = (
        "\n".join(f"w{i:03} = a suppresses b" for i in range(n)) + "\ndrive = a"
        for n in (MAX_LINES - 1, MAX_LINES + 3)
    )
    assert "wires left out" not in explain(compile_program(program(exact)))
    text = explain(compile_program(program(more)))
    assert "(4 more wires left out)" in text
    assert f"  w{MAX_LINES - 1:03} = a suppresses b\n  (4 more" in text


def test_modules_in_guards_are_counted() -> None:
    for extra in (0, 2):
        inhibitors = " inhibits ".join(f"n{i}" for i in range(MAX_LINES + extra))
        text = " ".join(explain(compile_program(program(f"drive = {inhibitors} inhibits cruise"))).split())
        assert ("and 2 more" in text) is (extra > 0)
        assert "and 0 more" not in text


def test_words_stay_whole_however_long_they_are() -> None:
    long = "a_name_" + "x" * 120
    assert wrapped(f"b and {long} and c", 20) == ["b and", long, "and c"]
    text = explain(compile_program(program(f"drive = {long} suppresses b_{long}")))
    assert text.count(f" {long}") > 1
    assert f"b_{long}-" in text or f"-b_{long}" in text or f"\n  b_{long}\n" in text


def test_lines_are_as_long_as_the_page_and_no_shorter_than_forty() -> None:
    text = explain(compile_program(chain(100)))
    visits = text[text.index("The forward traversal") : text.index("The clients")].splitlines()[1:]
    assert 90 < max(map(len, visits)) <= 102
    head = "x" * 80
    assert explaining._hanging(head, "a " * 30) == [head + "a " * 19 + "a", " " * 80 + "a " * 9 + "a"]


def test_chains_in_chains_are_cut_alike() -> None:
    inner = Chain(relation="inhibits", operands=tuple(Use(name=n) for n in "bcd"), windows_ns=(0, 0))
    outer = Chain(relation="suppresses", operands=(Use(name="a"), inner, Use(name="e")), windows_ns=(0, 0))
    text = "a suppresses (b inhibits c inhibits ... (1 more)) suppresses ... (1 more)"
    assert wiring_text(outer, max_operands=2) == text


def test_short_columns_keep_their_width() -> None:
    text = explain(compile_program(program("a_wire = a suppresses b\ndrive = a_wire")))
    assert "  a_wire = a suppresses b\n  drive  = a_wire" in text


def test_the_parts_of_guards_up_to_a_limit() -> None:
    clients = compile_program(chain(60)).clients
    (one,) = clients.actuators
    whole = GuardText(clients.guards)
    rows(one, whole)
    every = definitions(whole)
    assert len(every) > 3
    for limit in (0, 1, 2):
        guards = GuardText(clients.guards)
        rows(one, guards)
        assert definitions(guards, limit)[-1] == "(more parts of guards left out)"
        assert len(guards.take_definitions()) > 0
    guards = GuardText(clients.guards)
    table = rows(one, guards, 2)
    assert table.endswith(f"({len(one.clients) - 2} more clients left out)")
    assert table.count("\n") >= 3
    rows(one, guards)
    assert legend(guards, 1).splitlines()[-1] == "(more parts of guards left out)"


if __name__ == "__main__":
    with pytest.MonkeyPatch.context() as patch:
        EXPECTED.write_text(narrow(patch))
