"""What a syntax error says: what was found, what was expected there, and the usual slip behind it."""

from __future__ import annotations

import re
from typing import Any

from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from colony.diagnostics import Diagnostic, error
from colony.source import Source, Span
from colony.units import BASE_UNITS

RESERVED = frozenset(
    "and or not implies if then else in is by suppresses inhibits true false missing".split()
)

_OPERATORS = frozenset(
    "PLUS MINUS TIMES OVER LESS AT_MOST GREATER AT_LEAST EQUAL UNEQUAL AND OR IMPLIES IN BY IS "
    "LSQB DOT".split()
)
_EXPRESSION_STARTS = frozenset("NUMBER TRUE FALSE NAME LPAR MINUS NOT IF".split())
_DECLARATION_STARTS = frozenset(
    "ROBOT ENUM IMPORT PARAM LET STATE NEXT MACHINE MODULE NETWORK LIMIT CONTRACT TEST".split()
)
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
_SLIPS = {
    "&": "write `and`",
    "&&": "write `and`",
    "|": "write `or`",
    "||": "write `or`",
    "!": "write `not`",
    ";": "nothing ends a clause: leave the `;` out",
    "'": "texts stand in double quotes",
    "//": "comments begin with `#`",
    "/*": "comments begin with `#`",
    "**": "powers of numbers are written as products",
    "%": "write `mod(x, y)`",
    "^": "powers stand only in units, without blanks: `m/s^2`",
    "elif": "write `else if`",
    "elseif": "write `else if`",
    "==": "a single `=` declares; compare in an expression",
    "None": "write `missing`",
    "null": "write `missing`",
    "True": "write `true`",
    "False": "write `false`",
}
_WORD = re.compile(r"[A-Za-z_]\w*|\d[\w.]*|==|&&|\|\||//|/\*|\*\*|.", re.DOTALL)


def describe(source: Source, problem: UnexpectedInput, declaration: int) -> Diagnostic:
    """The diagnostic of one syntax error; `declaration` is where the declaration that failed begins."""
    text = source.text
    at_end = isinstance(problem, UnexpectedToken) and problem.token.type == "$END"
    at = len(text.rstrip()) if at_end else _offset(problem)
    accepted = _accepted(problem)
    found = "" if at_end else _found(text, at)
    span = Span(source, max(at - 1, 0), at) if at_end else Span(source, at, at + len(found))
    bracket = _open_bracket(text, declaration, at)
    if bracket is not None and (at_end or _begins_declaration(text, at, found)):
        return _unclosed(source, span, bracket, at_end, found)
    shown = "the end of the file" if at_end else _shown(found)
    message = f"found {shown}, expected {_expected(accepted)}"
    return error("E005", span, message, _hint(text, at, found, accepted))


def _offset(problem: UnexpectedInput) -> int:
    if isinstance(problem, UnexpectedToken):
        return int(problem.token.start_pos or 0)
    return int(problem.pos_in_stream or 0)


def _accepted(problem: UnexpectedInput) -> frozenset[str]:
    """The terminals that would have been accepted."""
    interactive: Any = getattr(problem, "interactive_parser", None)
    if interactive is not None:
        return frozenset(interactive.accepts())
    allowed = problem.allowed if isinstance(problem, UnexpectedCharacters) else ()
    return frozenset(allowed or ())


def _found(text: str, at: int) -> str:
    match = _WORD.match(text, at)
    return match[0][:60] if match else ""


def _shown(found: str) -> str:
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
        names -= _OPERATORS
    if len(names & _DECLARATION_STARTS) > 6:
        parts.append("a declaration (`robot`, `module`, `network`, ...)")
        names -= _DECLARATION_STARTS | {"$END"}
    parts += sorted({_spelled(name) for name in names if not name.startswith("__IGNORE")})
    if not parts:
        return "something else"
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " or " + parts[-1]


def _spelled(terminal: str) -> str:
    if terminal in _SPELLED:
        return _SPELLED[terminal]
    return f"`{terminal.lower()}`"


def _hint(text: str, at: int, found: str, accepted: frozenset[str]) -> str | None:
    before = text[:at].rstrip(" \t")[-40:]
    if re.search(r"(?<![\w.])\d[\d.eE+-]*$", before) and re.match(r"[A-Za-z_]", found) and "PLUS" in accepted:
        return f"`{found}` is not a unit; the units are {', '.join(BASE_UNITS)} and their products"
    if found == "=" and "EQUAL" in accepted:
        return "compare with `==`"
    if found in ("<", ">", "<=", ">=", "==", "!=") and "AND" in accepted:
        return "comparisons do not chain: write `a < b and b < c`, or `b in a .. c`"
    if found == "if" and "LPAR" in accepted:
        return "an `if` to the right of an operator needs parentheses"
    if found in _SLIPS:
        return _SLIPS[found]
    if found in RESERVED and "NAME" in accepted:
        return f"`{found}` is a reserved word and cannot be a name"
    if found == "." and "NUMBER" in accepted and re.match(r"\.\d", text[at : at + 2]):
        return "a number needs a digit before the point: `0.5`"
    if found in ("suppresses", "inhibits") and "RBRACE" in accepted and "AND" in accepted:
        return "modules are wired in a `network { ... }` block"
    return _did_you_mean(found, accepted)


def _did_you_mean(found: str, accepted: frozenset[str]) -> str | None:
    if not found.isidentifier():
        return None
    from difflib import get_close_matches

    words = [t.lower() for t in accepted if t.lower() not in _NOT_WORDS]
    close = get_close_matches(found.lower(), words, n=1, cutoff=0.7)
    return f"did you mean `{close[0]}`?" if close else None


_NOT_WORDS = frozenset(
    "name field number string unit plus minus times over less greater equal unequal comma dot colon "
    "dots arrow assign lbrace rbrace lpar rpar lsqb rsqb".split()
)


def _begins_declaration(text: str, at: int, found: str) -> bool:
    line = text.rfind("\n", 0, at) + 1
    return found.upper() in _DECLARATION_STARTS and not text[line:at].strip()


_BRACKET = re.compile(r'"[^"\n]*"|#[^\n]*|[(){}\[\]]')


def _open_bracket(text: str, start: int, end: int) -> int | None:
    """The innermost bracket opened in `text[start:end]` and not closed there."""
    opened: list[int] = []
    for match in _BRACKET.finditer(text, start, end):
        if match[0] in "([{":
            opened.append(match.start())
        elif match[0] in ")]}" and opened:
            opened.pop()
    return opened[-1] if opened else None


def _unclosed(source: Source, span: Span, bracket: int, at_end: bool, found: str) -> Diagnostic:
    line, column = source.position(bracket)
    closing = {"(": ")", "[": "]", "{": "}"}[source.text[bracket]]
    where = "the file ends" if at_end else f"`{found}` begins a declaration"
    message = f"{where} before the `{source.text[bracket]}` of line {line}, column {column} is closed"
    return error("E006", span, message, f"add the missing `{closing}`")
