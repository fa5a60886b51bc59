"""Text to syntax tree: precedence, places, and reading on after errors."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl import ast
from colony.dsl.parse import parse
from colony.text.source import Source
from tests.case_files import table


def tree(text: str) -> ast.File:
    parsed = parse(Source("<text>", text))
    assert not parsed.diagnostics, parsed.diagnostics
    return parsed.file


def expression(text: str) -> ast.Expression:
    [let] = tree(f"let x = {text}").declarations
    assert isinstance(let, ast.LetDecl)
    return let.value


def wiring(text: str) -> ast.Wiring:
    [network] = tree(f"network {{ x = {text} }}").declarations
    assert isinstance(network, ast.NetworkDecl)
    return network.wires[0].wiring


@pytest.mark.parametrize(("text", "same"), table(Path(__file__).parent / "cases" / "precedence.table"))
def test_precedence(text: str, same: str) -> None:
    assert expression(text) == expression(same)


@pytest.mark.parametrize(
    "text", ["a < b < c", "a == b == c", "a in b .. c in d .. f", "a by b by c", "a is idle is idle"]
)
def test_comparisons_do_not_chain(text: str) -> None:
    assert parse(Source("<text>", f"let x = {text}")).diagnostics


@pytest.mark.parametrize(
    "text",
    ["1 + if a then b else c", "not if a then b else c", "a and if b then c else d", "-if a then b else c"],
)
def test_an_if_to_the_right_of_an_operator_needs_parentheses(text: str) -> None:
    [found] = parse(Source("<text>", f"let x = {text}")).diagnostics
    assert found.hint == "an `if` to the right of an operator needs parentheses"


def test_an_if_stands_without_parentheses_inside_brackets() -> None:
    expression("f(if a then b else c, if d then e else g)")
    expression("a[if b then 1 else 2]")


def test_wiring_is_kept_flat() -> None:
    chain = wiring("a suppresses[1 s] b suppresses c")
    assert isinstance(chain, ast.ChainNode)
    assert chain.operands == tuple(ast.Reference(path=(n,)) for n in "abc")
    assert [link.relation for link in chain.links] == ["suppresses", "suppresses"]
    assert chain.links[0].window == ast.NumberNode(digits="1", unit="s")
    assert chain.links[1].window is None
    assert wiring("((a)) suppresses (b) suppresses c") == wiring("a suppresses b suppresses c")
    assert wiring("(a suppresses b) suppresses c") != wiring("a suppresses b suppresses c")


def test_parentheses_leave_no_trace() -> None:
    assert expression("((a + (b)))") == expression("a + b")


def test_line_breaks_mean_nothing() -> None:
    text = 'module m { let a = 1 when a > 3 do d(v = 1 mm, w = 2) } test "t" { at 1 s given a = 2 expect b }'
    broken = text.replace(" ", "\n")
    assert (
        tree(text) == tree(broken) == tree(broken.replace("\n", "\r\n")) == tree(broken.replace("\n", "\f\t"))
    )


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_comments_end_with_the_line(end: str) -> None:
    text = f'# a comment{end}let a = 1 # another " ( {{{end}let b = 2{end}#'
    assert tree(text) == tree("let a = 1 let b = 2")


@pytest.mark.parametrize("text", ["", " ", "\n\n", "# only a comment", "#", "\ufeff"[1:]])
def test_nothing_is_a_file(text: str) -> None:
    assert tree(text) == ast.File(declarations=())


def test_places() -> None:
    text = "let abc = 12 mm + min(a.b, -c)\n"
    [let] = tree(text).declarations
    assert isinstance(let, ast.LetDecl)

    def shown(node: ast.SyntaxNode) -> str:
        return text[node.start : node.end]

    assert shown(let) == "let abc = 12 mm + min(a.b, -c)"
    assert shown(let.name) == "abc"
    assert isinstance(let.value, ast.Infix)
    assert shown(let.value) == "12 mm + min(a.b, -c)"
    assert shown(let.value.left) == "12 mm"
    assert isinstance(let.value.right, ast.CallNode)
    assert [shown(a) for a in let.value.right.arguments] == ["a.b", "-c"]


def test_trailing_commas() -> None:
    tree(
        "enum e { a = 1, b = 2, } module m { when true do d(v = 1, w = 2,) } module n = m(p = 3,)"
        ' test "t" { at 0 s given a = [1, 2,] expect f(1, 2,) }'
        " robot r { actuator d { v : mm, } to A.b idle d(v = 0,) }"
    )


# --- errors --------------------------------------------------------------------------------------


def places(text: str) -> list[str]:
    source = Source("<text>", text)
    at = [source.position(d.span.start) for d in parse(source).diagnostics]
    return [f"{line}:{column}" for line, column in at]


def test_what_was_read_before_an_error_is_kept() -> None:
    parsed = parse(Source("<text>", "let a = 1\nlet b = 2\nlet c = = 3\nlet d = 4\nlet e"))
    names = [d.name.text for d in parsed.file.declarations if isinstance(d, ast.LetDecl)]
    assert names == ["a", "b", "d"]
    assert parsed.lost_names == {"c", "e"}
    assert len(parsed.diagnostics) == 2


def test_reading_goes_on_at_the_next_declaration_that_is_not_inside_the_bad_one() -> None:
    text = """module a {
  let b = = 3
  let c = = 4
  state d = 5
  when true
}
module e {
  when (=
}
"""
    assert places(text) == ["2:11", "8:9"]
    parsed = parse(Source("<text>", text))
    assert parsed.file.declarations == ()
    assert parsed.lost_names == {"a", "b", "c", "d", "e"}


def test_the_names_of_a_robot_that_could_not_be_read_are_remembered() -> None:
    text = "robot r {\n  sensor a : mm from A.b\n  sensr b\n  actuator c { v : mm } to A.b idle hold\n}"
    assert {"r", "a", "c"} <= parse(Source("<text>", text)).lost_names


def test_errors_are_told_up_to_a_number() -> None:
    parsed = parse(Source("<text>", "let a = = 1\n" * 100))
    assert [d.code for d in parsed.diagnostics] == ["E005"] * 20 + ["E007"]
    few = parse(Source("<text>", "let a = = 1\n" * 20))
    assert [d.code for d in few.diagnostics] == ["E005"] * 20


def test_the_end_of_the_file_is_after_the_last_word() -> None:
    source = Source("<text>", "let a =   \n\n  # nothing more\n")
    [found] = parse(source).diagnostics
    assert found.message == "found the end of the file, expected an expression"
    assert source.position(found.span.start) == (1, 7)


def test_indented_files_recover_too() -> None:
    assert places("  let a = = 3\n  let b = 4\n  let c = = 5") == ["1:11", "3:11"]
