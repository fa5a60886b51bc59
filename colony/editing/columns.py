"""Alignment: the columns of the pieces of a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import groupby, pairwise

from colony.editing.breaking import break_long, place_row
from colony.editing.layout import WIDTH, Line, Piece, Row, set_stops

_PASSES = 8
"""Passes over a file at most. The second one changes something only where blocks have grown together."""

_AS_BEGUN = {"colon": 1, "assign": 1, "brace": 1, "do": 1, "to": 1, "idle_in_line": 1}
_IN_BLOCKS = {
    "wire": 1,
    "arrow": 1,
    "when": 1,
    "until": 2,
    "time": 2,
    "else": 1,
    "promise": 1,
    "brace": 1,
}
_KEPT = {"attribute": 1, "from": 1, "within": 1, "idle": 1}
_STEPS = {"given": 1, "expect": 2}
"""Stops that are aligned where the author began to, in each block, and to the column that most have; with the
blanks before them at least.
"""

_SPACES = _IN_BLOCKS | _AS_BEGUN | _KEPT | _STEPS

_WIDEST = {"given": 14, "expect": 55}
"""The last columns to which parts of steps are aligned where the author has not chosen one."""

_COMMENT_SPACE = 2

_NAMED_TOGETHER = (
    frozenset({"frame", "sensor", "actuator"}),
    frozenset({"input", "param", "let", "state", "next"}),
    frozenset({"when", "do"}),
)
"""Clauses of a declaration with their second words in one column."""

_Member = tuple[Row, Piece]
_Groups = dict[str, list[list[_Member]]]
"""Pieces that may be aligned with each other, by the name of their stop."""


def place(rows: list[Row]) -> None:
    """Give each piece its column, and break the lines that are too long."""
    placement = _Placement(rows)
    for _ in range(_PASSES):
        placement.align()
        while broken := [row for row in rows if break_long(row)]:
            for row in broken:
                set_stops(row)
            placement = _Placement(rows)
            placement.align()
        _place_comments(rows)
        if not _take_as_written(rows):
            break


def _take_as_written(rows: list[Row]) -> bool:
    """Take the columns for those of the text; return False if they are."""
    changed = False
    for row in rows:
        for line in row.lines:
            end = -1
            for piece in line.pieces:
                padding = piece.column - end if end >= 0 else -1
                changed = changed or (piece.source_column, piece.padding) != (piece.column, padding)
                piece.source_column, piece.padding, end = piece.column, padding, piece.end
    return changed


class _Placement:
    """The rows of a file, with the pieces that may be aligned in blocks and in declarations."""

    def __init__(self, rows: list[Row]) -> None:
        for row in rows:
            for piece in row.pieces:
                piece.space = _SPACES.get(piece.stop, piece.space)
        self._rows = rows
        self._names = _name_columns(rows)
        self._blocks = _groups(
            groupby(rows, lambda row: (row.kind, row.level, row.block if row.level else 0))
        )
        self._declarations = _groups(groupby((r for r in rows if r.level), lambda row: row.block))

    def align(self) -> None:
        """Place all pieces. The lines are given."""
        for row in self._rows:
            for piece in row.pieces:
                piece.fixed = -1
            self._place(row)
        for stop in _SPACES:
            blocks, declarations = self._blocks.get(stop, []), self._declarations.get(stop, [])
            if stop in _STEPS:
                _align_steps(stop, declarations)
            elif stop in _KEPT:
                _align_clauses(stop, blocks, declarations)
            else:
                for members in blocks:
                    for together in _stretches(members) if stop in _AS_BEGUN else [members]:
                        _align(together)
            for members in blocks:
                for row, _ in members:
                    self._place(row)

    def _place(self, row: Row) -> None:
        place_row(row, self._names.get(id(row), 0))


def _groups(blocks: Iterable[tuple[object, Iterable[Row]]]) -> _Groups:
    found: _Groups = {}
    for _, block in blocks:
        of_block: dict[str, list[_Member]] = {}
        for row in block:
            for piece in row.pieces:
                if piece.stop:
                    of_block.setdefault(piece.stop, []).append((row, piece))
        for stop, members in of_block.items():
            found.setdefault(stop, []).append(members)
    return found


def _name_columns(rows: list[Row]) -> dict[int, int]:
    """Return the columns of the second words of clauses, by the identity of the row."""
    found = {}
    for _, block in groupby((row for row in rows if row.level), lambda row: row.block):
        members = list(block)
        for kinds in _NAMED_TOGETHER:
            together = [row for row in members if row.kind in kinds]
            longest = max([len(row.kind) for row in together], default=0)
            if "let" in kinds and any(row.kind == "when" for row in members):
                longest = max(longest, len("when"))
            found.update({id(row): row.indent + longest + 1 for row in together})
    return found


def _align(members: Sequence[_Member]) -> None:
    """Align pieces to the one that is farthest to the right; a declaration in a line stays in it."""
    column = max([piece.column for _, piece in members])
    for row, piece in members:
        if piece.stop != "brace" or row.lines[0].end + column - piece.column <= WIDTH:
            piece.fixed = column


def _stretches(members: list[_Member]) -> list[list[_Member]]:
    """Return the members that the author aligned with each other, or began to."""
    found = [members[:1]]
    for (_, above), member in pairwise(members):
        if _is_begun(above, member[1]):
            found[-1].append(member)
        else:
            found.append([member])
    return [stretch for stretch in found if any(piece.padding > 1 for _, piece in stretch)]


def _is_begun(above: Piece, below: Piece) -> bool:
    """Return True for pieces in one column, or if one has blanks that no longer suffice for the other."""
    if above.source_column == below.source_column:
        return True
    short, long = sorted((above, below), key=lambda piece: piece.source_column)
    return short.padding > 1 and long.padding == 1


def _usual_column(stop: str, members: list[_Member], other_than: int = -1) -> int:
    """Return the column in which most of the members stand, -1 for none, or if most have no room there."""
    columns = Counter(piece.source_column for _, piece in members if piece.padding >= 0)
    chosen = {piece.source_column for _, piece in members if piece.padding > _SPACES[stop]} - {other_than}
    usual = max(((columns[c], c) for c in chosen if columns[c] > 1), default=(0, -1))[1]
    return usual if _fits_most(usual, members) else -1


def _fits_most(column: int, members: list[_Member]) -> bool:
    return 2 * sum(piece.column <= column for _, piece in members) >= len(members)


def _align_clauses(stop: str, blocks: list[list[_Member]], declarations: list[list[_Member]]) -> None:
    """Align clauses of a robot to the usual column of their block, or else of the robot.

    Without one of its block, a clause keeps its column if it shares it with others of the robot.
    """
    of_robots: dict[int, tuple[int, set[int]]] = {}
    for members in declarations:
        column = _usual_column(stop, members)
        widest = max([piece.column for _, piece in members])
        columns = Counter(piece.source_column for _, piece in members)
        shared = {column for column, count in columns.items() if count > 1}
        of_robots[members[0][0].block] = (column if column >= 0 else widest, shared)
    for members in blocks:
        usual = _usual_column(stop, members)
        for row, piece in members:
            of_robot, shared = of_robots.get(row.block, (-1, set()))
            column = of_robot if piece.source_column not in shared else piece.source_column
            column = usual if usual >= 0 else column
            if _has_room(_line_of(row, piece), column - piece.column):
                piece.fixed = column


def _align_steps(stop: str, tests: list[list[_Member]]) -> None:
    """Align `given` or `expect` of tests to the usual column of the test, or else of the file.

    One that begins a line stands where `given` does, and so does an `expect` without room further right.
    """
    inner = {id(piece): (row, piece) for test in tests for row, piece in test if _is_aligned_step(row, piece)}
    of_file = _usual_column(stop, list(inner.values()))
    for test in tests:
        members = [inner[id(piece)] for _, piece in test if id(piece) in inner]
        given = max(
            (piece.fixed for row, _ in test for piece in row.pieces if piece.stop == "given"), default=-1
        )
        column = _usual_column(stop, members, given)
        column = of_file if column < 0 and _fits_most(of_file, members) else column
        if column < 0:
            narrow = [piece.column for _, piece in members if piece.column <= _WIDEST[stop]]
            column = max(narrow, default=-1) + (stop == "given")
        for row, piece in test:
            line = _line_of(row, piece)
            if stop == "given":
                piece.fixed = column
            elif line.pieces[0] is piece:
                piece.fixed = given
            elif _has_room(line, column - piece.column):
                piece.fixed = column
            elif all(other.stop != "given" for other in row.pieces):
                piece.fixed = given


def _line_of(row: Row, piece: Piece) -> Line:
    return next(line for line in row.lines if any(other is piece for other in line.pieces))


def _has_room(line: Line, shift: int) -> bool:
    """Return True if a line may be shifted, and its comment with it unless that has no room at all."""
    comment = len(line.comment) + _COMMENT_SPACE if line.comment else 0
    return line.end + shift + (comment if line.end + comment <= WIDTH else 0) <= WIDTH


def _is_aligned_step(row: Row, piece: Piece) -> bool:
    """Return True unless the piece begins a line, or is the `given` of a step of many frames."""
    if piece.stop == "given" and row.lines[0].pieces[0].kind == "FROM":
        return False
    return all(line.pieces[0] is not piece for line in row.lines if line.pieces)


# --- comments -----------------------------------------------------------------------------------------


def _place_comments(rows: list[Row]) -> None:
    """Place the comments behind lines: those of neighboring lines in the column of most of them.

    A comment without neighbors keeps its distance.
    """
    lines = [(row, line) for row in rows for line in row.lines]
    for has_comment, group in groupby(lines, lambda member: bool(member[1].pieces and member[1].comment)):
        together = [line for _, line in group] if has_comment else []
        if len(together) > 1:
            columns = Counter(line.comment_column for line in together)
            column = max((count, column) for column, count in columns.items())[1]
            if any(line.end + _COMMENT_SPACE > column for line in together):
                column = max([line.end for line in together]) + _COMMENT_SPACE
        for line in together:
            if len(together) == 1:
                last = line.pieces[-1]
                column = line.comment_column - last.source_column + last.column
            room = WIDTH - len(line.comment)
            line.comment_column = max(line.end + _COMMENT_SPACE, min(column, room))
