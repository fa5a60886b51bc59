"""Rows of a file: its tokens as statements in lines, with the comments and blank lines between them."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from colony.dsl import ast

if TYPE_CHECKING:
    from lark import Token

WIDTH = 110
"""Columns of a line at most."""

INDENT = 2

BLANK, COMMENT, HEAD, END, INLINE = "blank", "comment", "head", "end", "inline"
"""Kinds of rows: a blank line, a comment, the ends of a declaration in braces, and one in a line."""

OPENING, CLOSING = frozenset({"LPAR", "LSQB", "LBRACE"}), frozenset({"RPAR", "RSQB", "RBRACE"})


@dataclass(slots=True)
class Piece:
    """A token to be placed.

    Attributes:
        kind: its terminal in the grammar.
        text: the token as it is written.
        start: its offset in the text.
        source_column: its column in the text.
        padding: blanks before it in the text, -1 at the beginning of a line.
        space: blanks before it if nothing aligns it.
        stop: the name of what it is aligned by, or "".
        fixed: the column to which it is aligned, or -1.
        column: where it is placed.
    """

    kind: str
    text: str
    start: int
    source_column: int
    padding: int
    space: int = 0
    stop: str = ""
    fixed: int = -1
    column: int = 0

    @property
    def end(self) -> int:
        """Return the column behind it."""
        return self.column + len(self.text)


@dataclass(slots=True)
class Line:
    """A line: its pieces, and the comment behind them with its column in the text. A comment may be alone."""

    pieces: list[Piece] = field(default_factory=list)
    comment: str = ""
    comment_column: int = 0

    @property
    def end(self) -> int:
        """Return the column behind the last piece."""
        return self.pieces[-1].end if self.pieces else 0


@dataclass(slots=True)
class Row:
    """A statement, or what stands between statements.

    Attributes:
        kind: one of the kinds above; of other statements the word that says what they are, such as `let`.
        level: 1 in the braces of a declaration, else 0.
        block: the number of its declaration.
        lines: its lines, at least one.
    """

    kind: str
    level: int
    block: int
    lines: list[Line]

    @property
    def indent(self) -> int:
        """Return the column in which it begins."""
        return self.level * INDENT

    @property
    def pieces(self) -> Iterator[Piece]:
        """Yield the pieces of all lines."""
        return (piece for line in self.lines for piece in line.pieces)


def rows_of(text: str, tree: ast.File, tokens: Sequence[Token]) -> list[Row]:
    """Return the rows of a file. Nothing is placed yet."""
    pieces = _pieces(text, tokens)
    _set_spaces(pieces, {d.start for d in tree.declarations if isinstance(d, ast.ContractDecl)})
    begins = _beginnings(text, tree, pieces)
    ends = [token.end_pos or 0 for token in tokens]
    rows = _assembled(text, pieces, ends, begins)
    for row in rows:
        set_stops(row)
    return rows


# --- pieces -------------------------------------------------------------------------------------------

_NUMBER = re.compile(r"([0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)[ \t\r\n\f]*(.*)", re.DOTALL)
_OPERAND_ENDS = frozenset({"NAME", "FIELD", "NUMBER", "TRUE", "FALSE", "RPAR", "RSQB", "UNIT"})
_TIGHT_AFTER = frozenset({"LPAR", "LSQB", "DOT", "PREFIX"})
_TIGHT_BEFORE = frozenset({"RPAR", "RSQB", "COMMA", "DOT"})
_CALLED = frozenset({"NAME", "FIELD"})
_INDEXED = frozenset({"NAME", "FIELD", "RPAR", "RSQB", "SUPPRESSES", "INHIBITS"})


def _pieces(text: str, tokens: Sequence[Token]) -> list[Piece]:
    found: list[Piece] = []
    line_start = end = 0
    for token in tokens:
        start = token.start_pos or 0
        newline = text.rfind("\n", end, start)
        if newline >= 0:
            line_start = newline + 1
        kind, value = token.type, str(token)
        if kind == "NUMBER" and (parts := _NUMBER.fullmatch(value)):
            value = " ".join(part for part in parts.groups() if part)
        elif kind == "MINUS" and not (found and found[-1].kind in _OPERAND_ENDS):
            kind = "PREFIX"
        is_first = newline >= 0 or not found
        found.append(Piece(kind, value, start, start - line_start, -1 if is_first else start - end))
        end = token.end_pos or 0
    return found


def _set_spaces(pieces: list[Piece], promises: set[int]) -> None:
    """Set the blanks before each piece; before the colon of a promise there are none."""
    before = "DOT"
    in_promise = False
    for piece in pieces:
        kind = piece.kind
        in_promise = (in_promise and kind != "ASSIGN") or piece.start in promises
        tight = before in _TIGHT_AFTER or kind in _TIGHT_BEFORE
        tight = tight or (kind == "LPAR" and before in _CALLED) or (kind == "LSQB" and before in _INDEXED)
        if kind == "COLON" and in_promise:
            tight, in_promise = True, False
        piece.space = 0 if tight else 1
        before = kind


# --- beginnings of rows -------------------------------------------------------------------------------

_CLAUSES: dict[type, frozenset[str]] = {
    ast.RobotDecl: frozenset({"FRAME", "SENSOR", "ACTUATOR"}),
    ast.ModuleDecl: frozenset({"INPUT", "PARAM", "TUNABLE", "LET", "STATE", "NEXT", "WHEN", "DO"}),
    ast.PythonModuleDecl: frozenset({"INPUT", "PARAM", "TUNABLE", "READS", "COMMANDS", "RATE"}),
    ast.TestDecl: frozenset({"AT", "FROM"}),
}
"""The terminals that begin a clause, where they are outside of brackets."""

_KINDS: dict[type, str] = {
    ast.DerivedModuleDecl: "derived",
    ast.FunctionDecl: "function",
    ast.NetworkDecl: "wire",
    ast.MachineDecl: "transition",
    ast.SequenceDecl: "task",
    ast.TestDecl: "step",
    ast.SensorDecl: "sensor",
}

_Begins = dict[int, tuple[str, int, int]]
"""Kind, level and block of the rows by the indices of the pieces with which they begin."""


def _beginnings(text: str, tree: ast.File, pieces: list[Piece]) -> _Begins:
    starts = [piece.start for piece in pieces]
    found: _Begins = {0: ("language", 0, -1)} if tree.language is not None else {}
    firsts = [bisect_left(starts, d.start) for d in tree.declarations]
    for block, (declaration, first) in enumerate(zip(tree.declarations, firsts, strict=True)):
        end = firsts[block + 1] if block + 1 < len(firsts) else len(pieces)
        items = _items(declaration, pieces, starts, first, end)
        is_braced = items is not None
        kind = _KINDS.get(type(declaration), pieces[first].text)
        for item in (items or [])[1:]:
            pieces[item].space = 1 if pieces[item].kind == "DO" else 2
        if items is None or _fits_in_line(text, pieces, first, end):
            found[first] = (INLINE if is_braced else kind, 0, block)
            continue
        found[first] = (HEAD, 0, block)
        for item in items:
            found[item] = (kind if type(declaration) in _KINDS else pieces[item].text, 1, block)
        found[end - 1] = (END, 0, block)
    return found


def _items(
    declaration: ast.Declaration, pieces: list[Piece], starts: list[int], first: int, end: int
) -> list[int] | None:
    """Return the indices with which the clauses in the braces of a declaration begin; None if it has none."""
    match declaration:
        case ast.NetworkDecl(wires=nodes) | ast.SequenceDecl(tasks=nodes):
            return [bisect_left(starts, node.start) for node in nodes]
        case ast.MachineDecl(transitions=nodes):
            opening = next(i for i in range(first, end) if pieces[i].kind == "LBRACE")
            return [opening + 1, *(bisect_left(starts, node.start) for node in nodes)]
        case _:
            pass
    clauses = _CLAUSES.get(type(declaration))
    if clauses is None:
        return None
    depth, found = 0, []
    for index in range(first, end):
        kind = pieces[index].kind
        depth += (kind in OPENING) - (kind in CLOSING)
        if depth == 1 and kind in clauses and pieces[index - 1].kind != "TUNABLE":
            found.append(index)
    return found


def _fits_in_line(text: str, pieces: list[Piece], first: int, end: int) -> bool:
    """Return True if a declaration was written in a line, and has room in one."""
    if any(piece.padding < 0 for piece in pieces[first + 1 : end]):
        return False
    return sum(piece.space + len(piece.text) for piece in pieces[first:end]) - pieces[first].space <= WIDTH


# --- rows ---------------------------------------------------------------------------------------------

_HUGGING = frozenset({"COMMA", "RPAR", "RSQB"})
_LINE_BREAK = re.compile(r"\r\n|\r|\n")


def _assembled(text: str, pieces: list[Piece], ends: list[int], begins: _Begins) -> list[Row]:
    rows: list[Row] = []
    end = 0
    for index, piece in enumerate(pieces):
        gap = text[end : piece.start]
        begin = begins.get(index)
        if piece.padding >= 0 and "#" not in gap and begin is None:
            rows[-1].lines[-1].pieces.append(piece)
        else:
            trailing, between = _comments(gap, is_first=index == 0)
            if trailing:
                _add_comment(rows[-1].lines[-1], trailing, text, end)
            if begin is not None:
                kind, level, block = begin
                _add_between(rows, between, 1 if kind == END else level, block)
                if kind == END and rows[-1].kind == BLANK:
                    rows.pop()
                rows.append(Row(kind, level, block, [Line()]))
            else:
                lines = rows[-1].lines
                lines += [Line(comment=comment) for comment in between if comment]
                hugs = piece.kind in _HUGGING or (piece.kind == "LBRACE" and rows[-1].kind == HEAD)
                if not hugs or lines[-1].comment:
                    lines.append(Line())
                elif piece.padding < 0:
                    piece.padding = 0
            rows[-1].lines[-1].pieces.append(piece)
        end = ends[index]
    trailing, between = _comments(text[end:], is_first=not pieces)
    if trailing:
        _add_comment(rows[-1].lines[-1], trailing, text, end)
    _add_between(rows, between, 0, -1)
    if rows and rows[-1].kind == BLANK:
        rows.pop()
    return rows


def _comments(gap: str, *, is_first: bool) -> tuple[str, list[str]]:
    """Return the comment behind the last token, or "", and the lines after it: comments, or "" if blank."""
    first, *others = _LINE_BREAK.split(gap)
    if is_first:
        others.insert(0, first)
        first = ""
    between = [line.strip() for line in others[:-1]]
    last = others[-1].strip() if others else ""
    return first.strip(), [*between, last] if last else between


def _add_comment(line: Line, comment: str, text: str, end: int) -> None:
    at = text.index("#", end)
    line.comment, line.comment_column = comment, at - (text.rfind("\n", 0, at) + 1)


def _add_between(rows: list[Row], between: list[str], level: int, block: int) -> None:
    for comment in between:
        if comment:
            rows.append(Row(COMMENT, level, block, [Line(comment=comment)]))
        elif rows and rows[-1].kind not in (BLANK, HEAD):
            rows.append(Row(BLANK, 0, block, [Line()]))


# --- stops --------------------------------------------------------------------------------------------

_PROMISES = frozenset({"contract", "reach", "assume"})
_ATTRIBUTES = frozenset({"BEARING", "RANGE", "DEFAULT"})
_STOPS: dict[str, dict[str, str]] = {
    "sensor": {"COLON": "colon", "FROM": "from", "WITHIN": "within"},
    "input": {"COLON": "colon"},
    "state": {"COLON": "colon", "ASSIGN": "assign"},
    **{kind: {"ASSIGN": "assign"} for kind in ("let", "function", "param", "tunable", "next", "derived")},
    "actuator": {"LBRACE": "brace", "TO": "to", "IDLE": "idle_in_line"},
    "wire": {"ASSIGN": "wire"},
    "transition": {"ARROW": "arrow", "WHEN": "when"},
    "task": {"ASSIGN": "wire", "UNTIL": "until", "WITHIN": "time"},
    "step": {"GIVEN": "given", "EXPECT": "expect"},
    **{kind: {"COLON": "promise"} for kind in sorted(_PROMISES)},
}
"""Stops of each kind of row, which its pieces are aligned by: by terminal, outside of brackets."""


def set_stops(row: Row) -> None:
    """Name what the pieces of a row are aligned by."""
    stops = dict(_STOPS.get(row.kind, {}))
    if row.kind == INLINE and "MODULE" in (piece.kind for piece in row.lines[0].pieces[:2]):
        stops = {"LBRACE": "brace"}
    depth, before = 0, ""
    for line in row.lines:
        for piece in line.pieces:
            kind = piece.kind
            depth -= kind in CLOSING
            if row.kind == INLINE and depth == 1 and kind == "DO":
                piece.stop = "do"
            elif depth == 0 and before:
                piece.stop = stops.pop(kind, "")
                if line.pieces[0].kind == "TO":
                    piece.stop = "idle" if kind == "IDLE" else ""
                elif piece.stop == "promise":
                    piece.stop, stops = "", {}
                elif before == "COLON" and row.kind in _PROMISES:
                    piece.stop = "promise"
                elif kind == "WITHIN" and row.kind == "task":
                    stops["ELSE"] = "else"
                elif kind in _ATTRIBUTES and row.kind == "sensor":
                    is_first = "attribute" not in stops
                    stops["attribute"] = ""
                    piece.stop = "attribute" if is_first or piece is line.pieces[0] else ""
                    piece.space = 2
            depth += kind in OPENING
            before = kind
