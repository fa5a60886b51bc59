"""Messages for syntax errors: what was found, what was expected, and the likely mistake."""

from __future__ import annotations

import re

from colony.dsl.declaration_hints import declaration_hint
from colony.dsl.parser import Unexpected
from colony.dsl.recovery import expected_terminals, new_declaration
from colony.dsl.syntax_hints import DECLARATION_STARTS, hint_for, misspelled_relation
from colony.text.diagnostics import Diagnostic, Label, error
from colony.text.source import Source, Span
from colony.text.wording import listed

_OPERATORS = frozenset(
    "PLUS MINUS TIMES OVER LESS AT_MOST GREATER AT_LEAST EQUAL UNEQUAL AND OR IMPLIES IN BY IS "
    "LSQB DOT".split()
)
_EXPRESSION_STARTS = frozenset("NUMBER TRUE FALSE NAME LPAR MINUS NOT IF".split())
_SPELLED = {
    "NAME": "a name",
    "FIELD": "a name",
    "NUMBER": "a number",
    "STRING": "a text in double quotes",
    "UNIT": "a unit",
    "LBRACE": "`{`",
    "RBRACE": "`}`",
    "LPAR": "`(`",
    "RPAR": "`)`",
    "LSQB": "`[`",
    "RSQB": "`]`",
    "COLON": "`:`",
    "COMMA": "`,`",
    "DOT": "`.`",
    "EQUAL": "`==`",
    "AT_MOST": "`<=`",
    "AT_LEAST": "`>=`",
    "DOTS": "`..`",
    "ARROW": "`->`",
    "ASSIGN": "`=`",
    "PLUS": "`+`",
    "MINUS": "`-`",
    "TIMES": "`*`",
    "OVER": "`/`",
    "LESS": "`<`",
    "GREATER": "`>`",
    "UNEQUAL": "`!=`",
    "$END": "the end of the file",
}
_WORD = re.compile(
    r'"[^"\r\n]*"|[A-Za-z_]\w*|\d[\w.]*|==|<=|>=|!=|=>|->|\.\.|&&|\|\||//|/\*|\*\*|\+=|-=|.', re.DOTALL
)
_SPLITTABLE = ("==", "**", "=>", "->", "..", "<=", ">=", "//", "/*")
"""Punctuation whose first character may have been read as a token before the error was detected."""


def describe(source: Source, problem: Unexpected, declaration_start: int) -> Diagnostic:
    """Return the diagnostic of a syntax error in the declaration at `declaration_start`."""
    text, offset, at_end = source.text, problem.offset, problem.at_end
    accepted = expected_terminals(problem)
    if text[max(offset - 1, 0) : offset + 1] in _SPLITTABLE and not at_end:
        offset, accepted = offset - 1, _accepted_before(text[offset - 1], accepted)
    found = "" if at_end else _word_at(text, offset)
    span = Span(source, max(offset - 1, 0), offset) if at_end else Span(source, offset, offset + len(found))
    new_start = None if at_end else new_declaration(text, declaration_start, offset)
    bracket = _open_bracket(text, declaration_start, offset if new_start is None else new_start)
    if bracket is not None and (at_end or new_start is not None or _closes_another(text[bracket], found)):
        return _unclosed(source, span, bracket, found, new_start)
    if new_start is not None and new_start < offset:
        word = _word_at(text, new_start)
        message = f"`{word}` begins a declaration, and the one before it is not complete"
        return error("E005", Span(source, new_start, new_start + len(word)), message)
    if found == '"':
        hint = 'add the missing `"`; a text ends on the line on which it begins'
        return error("E006", span, "the text that begins here is not closed on its line", hint)
    node = misspelled_relation(text, offset, accepted)
    if node is not None:
        start, word, hint = node
        message = f"found `{word}`, expected `suppresses` or `inhibits`"
        return error("E005", Span(source, start, start + len(word)), message, hint)
    shown = "the end of the file" if at_end else _quoted(found)
    message = f"found {shown}, expected {_expected(accepted)}"
    form = declaration_hint(text, declaration_start, offset, found, accepted)
    return error("E005", span, message, form or hint_for(text, offset, found, accepted))


def _accepted_before(read: str, accepted: frozenset[str]) -> frozenset[str]:
    """Return the terminals accepted before `character`, which was taken for an operator."""
    accepted_before = {"=": {"ASSIGN"}, "*": _OPERATORS, "/": _OPERATORS, "<": _OPERATORS, ">": _OPERATORS}
    return frozenset(accepted_before.get(read, accepted))


def _word_at(text: str, offset: int) -> str:
    match = _WORD.match(text, offset)
    return match[0][:60] if match else ""


def _quoted(found: str) -> str:
    if found and not found.isprintable():
        return f"the character U+{ord(found[0]):04X}"
    return f"`{found}`"


def _expected(accepted: frozenset[str]) -> str:
    names = set(accepted)
    parts: list[str] = []
    if {"NUMBER", "NAME", "LPAR"} <= names:
        parts.append("an expression")
        names -= _EXPRESSION_STARTS
    if "PLUS" in names:
        parts.append("an operator")
        names -= _OPERATORS | {"LPAR"}
    elif {"SUPPRESSES", "INHIBITS"} <= names:
        names -= {"DOT", "LSQB"}
    if len(names & DECLARATION_STARTS) > 6:
        parts.append("a declaration (`robot`, `module`, `network`, ...)")
        names -= DECLARATION_STARTS | {"$END"}
    parts += sorted({_spell(name) for name in names if not name.startswith("__IGNORE")})
    if not parts:
        return "something else"
    return listed(parts, "or")


def _spell(terminal: str) -> str:
    if terminal in _SPELLED:
        return _SPELLED[terminal]
    return f"`{terminal.lower()}`"


_BRACKET = re.compile(r'"[^"\r\n]*"|#[^\r\n]*|[(){}\[\]]')


def _open_bracket(text: str, start: int, end: int) -> int | None:
    """Return the offset of the innermost bracket opened in `text[start:end]` and not closed there."""
    opened: list[int] = []
    for match in _BRACKET.finditer(text, start, end):
        if match[0] in "([{":
            opened.append(match.start())
        elif match[0] in ")]}" and opened:
            opened.pop()
    return opened[-1] if opened else None


_CLOSING = {"(": ")", "[": "]", "{": "}"}


def _closes_another(bracket: str, found: str) -> bool:
    return found in ")]}" and found != "" and _CLOSING[bracket] != found


def _unclosed(source: Source, span: Span, bracket: int, found: str, new_start: int | None) -> Diagnostic:
    """Report a bracket that is open where the file ends, another closes, or a declaration begins."""
    closing = _CLOSING[source.text[bracket]]
    event = f"found `{found}`" if found else "the file ends"
    if new_start is not None:
        word = _word_at(source.text, new_start)
        span, event = Span(source, new_start, new_start + len(word)), f"`{word}` begins a declaration"
    message = f"{event} before the `{source.text[bracket]}` is closed"
    opened = Label(Span(source, bracket, bracket + 1), "opened here")
    return error("E006", span, message, f"add the missing `{closing}`", opened)
