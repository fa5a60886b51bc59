"""Lines of a statement: where a piece stands that nothing aligns, and where a long line is broken."""

from __future__ import annotations

from colony.editing.layout import CLOSING, INDENT, OPENING, WIDTH, Line, Row
from colony.ir.expression import NESTING_LIMIT

_CLAUSE_WORDS = frozenset(
    "BEARING RANGE DEFAULT FROM WITHIN TO IDLE ON_LOSS WHEN KEEP RESTART UNTIL REQUIREMENT GIVEN".split()
) | {"EXPECT"}
"""Terminals that begin a part of a statement, outside of brackets."""

_CLAUSE, _COMMA = -2, -1
_LOOSENESS = {
    **dict.fromkeys(_CLAUSE_WORDS - {"GIVEN"}, _CLAUSE),
    **dict.fromkeys(("ELSE", "FOR"), 0),
    "IMPLIES": 1,
    **dict.fromkeys(("OR", "SUPPRESSES", "INHIBITS"), 2),
    "AND": 3,
    **dict.fromkeys(("LESS", "AT_MOST", "GREATER", "AT_LEAST", "EQUAL", "UNEQUAL", "IN"), 4),
    **dict.fromkeys(("PLUS", "MINUS"), 5),
    **dict.fromkeys(("TIMES", "OVER"), 6),
    "THEN": 7,
}
"""Terminals before which a line may be broken: the lower the number, the looser they bind."""


class _Level:
    """Where lines go on in a bracket, or outside of all: under its content, or the value after a `=`."""

    __slots__ = ("base", "content", "value")

    def __init__(self, base: int) -> None:
        self.base = base
        self.content = self.value = -1

    def continuation(self, before: str) -> int:
        """Return the column of a line that goes on after a token."""
        if before in OPENING or before in ("ASSIGN", "COLON") or self.content < 0:
            return self.base + INDENT
        return self.content if before == "COMMA" or self.value < 0 else self.value


def place_row(row: Row, name_column: int) -> None:
    """Give each piece of a row its column: what is not `fixed` follows the piece before it, or begins a line.

    Args:
        row: the row, divided into lines.
        name_column: the column of its second word, at least.
    """
    levels = [_Level(row.indent)]
    before, count = "", 0
    for line in row.lines:
        column = -1
        for piece in line.pieces:
            kind, level = piece.kind, levels[-1]
            is_clause = len(levels) == 1 and kind in _CLAUSE_WORDS and before != "IS"
            if column >= 0:
                column += piece.space
            elif count == 0:
                column = row.indent
            else:
                column = name_column if is_clause and name_column else level.continuation(before)
            if count == 1:
                name_column = column = max(column, name_column)
            column = piece.column = max(column, piece.fixed)
            if piece is line.pieces[0]:
                begin = column
            if count and level.content < 0:
                level.content = column
            if before == "ASSIGN":
                level.value = column
                if len(levels) == 1 and row.kind != "step":
                    level.content = column
            if kind in OPENING:
                levels.append(_Level(begin))
            elif kind in CLOSING:
                levels.pop()
            elif kind == "COMMA":
                level.value = -1
            elif len(levels) == 1 and (is_clause or kind == "COLON"):
                level.content = level.value = -1
            column += len(piece.text)
            before, count = kind, count + 1


def break_long(row: Row) -> bool:
    """Break the first line of a row that is too long, if it can be broken; return True if it was."""
    depth = 0
    for number, line in enumerate(row.lines):
        if line.end > WIDTH:
            at = _break_in(line, depth)
            if at:
                following = row.lines[number + 1 :]
                rest = Line(line.pieces[at:], line.comment, line.comment_column)
                is_list = line.pieces[at - 1].kind == rest.pieces[-1].kind == "COMMA"
                if following and is_list and not rest.comment:
                    rest.pieces += following[0].pieces
                    rest.comment, rest.comment_column = following[0].comment, following[0].comment_column
                    del following[0]
                row.lines[number:] = [Line(line.pieces[:at]), rest, *following]
                return True
        for piece in line.pieces:
            depth += (piece.kind in OPENING) - (piece.kind in CLOSING)
    return False


def _break_in(line: Line, depth: int) -> int:
    """Return the index of the piece before which to break a line, 0 for none.

    Of the places in the fewest brackets, and of these that bind least, it is the last up to which it fits.
    """
    best, found = (NESTING_LIMIT, 0), 0
    before, in_names = "", False
    for index, piece in enumerate(line.pieces):
        kind = piece.kind
        depth -= kind in CLOSING
        place = None if in_names or kind in CLOSING else _binding(kind, before, depth)
        if place is not None and index > 1 and line.pieces[index - 1].end <= WIDTH and place <= best:
            best, found = place, index
        depth += kind in OPENING
        in_names = kind == "FOR" or (in_names and before != "IN")
        before = kind
    return found


def _binding(kind: str, before: str, depth: int) -> tuple[int, int] | None:
    """Return how much holds a piece to the one before it: brackets around, then binding; None for a pair."""
    if before == "COMMA":
        return depth, _COMMA
    if before == "ASSIGN":
        return (NESTING_LIMIT, 0) if depth == 0 else None
    looseness = None if before == "IS" or (kind == "TO" and before != "RBRACE") else _LOOSENESS.get(kind)
    return None if looseness is None else (depth, looseness)
