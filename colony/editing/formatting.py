"""The one style of `.colony` files: the same tokens in the same lines, with other blanks.

Kept are every token, every comment, the ends of lines (LF where they are mixed), and one of several blank
lines in a row.

- Declarations begin at the margin, clauses in their braces two spaces further. A declaration in braces that
  was written in one line stays in it if it fits. In all others each clause has its line.
- There is one space between words and around operators, none after `(` and `[` and before `)`, `]` and `,`,
  and one before a unit. The colon of a type has a space on both sides, that of a contract only behind it.
- In a robot the names of the frame, of sensors and actuators begin in one column; in a module those of
  inputs, params, lets and states, and so do the predicate and the command.
- Neighboring lines of one kind form a block. A blank line, a comment and a line of another kind end it. In a
  block these are aligned: expressions of contracts, `=` of wires, `->` and `when` of transitions, and
  `until`, `within` and `else` of tasks.
- `=` and `:` of other declarations, the braces and `do` of modules in a line, the braces, `to` and `idle` of
  actuators in a line are aligned where the author began to: lines belong together if theirs are in one
  column, and with a neighbor that has become too long for it.
- `bearing`, `range`, `default`, `from`, `within` and `idle` of robots, `given` and `expect` of tests, and
  trailing comments are aligned to the column that most lines of the author have, so that a long line moves
  no other. What has no room there follows after a space; `expect` and comments after two.
- Lines have at most 110 columns. A longer one is broken before a clause, after a comma or before the
  operator that binds least, outside of as many brackets as it can be. What follows is aligned with the
  beginning of the expression, of the value after its `=`, or of the content of its bracket. After a `=` it is
  indented by two spaces.

The result has the tokens of the text, so it means the same, and formatting it again changes nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest

from colony.collector import gc_paused
from colony.dsl.parse import parse_with_tokens
from colony.editing.columns import place
from colony.editing.layout import Row, rows_of
from colony.text.source import Source


def formatted(text: str, path: str) -> str:
    """Return the text of a `.colony` file in the one style.

    Args:
        text: the file, as `read_source` decodes it.
        path: its name in messages.

    Raises:
        DiagnosticError: the text has syntax errors.
    """
    with gc_paused():
        tree, tokens = parse_with_tokens(Source(path, text))
        rows = rows_of(text, tree, tokens)
        place(rows)
        result = "".join(_written(rows))
    ends_in_crlf = 0 < text.count("\n") == text.count("\r\n")
    return result.replace("\n", "\r\n") if ends_in_crlf else result


def _written(rows: list[Row]) -> Iterator[str]:
    """Yield the lines. A comment alone stands where its statement goes on, or begins."""
    for row in rows:
        column = row.indent
        for line, following in zip_longest(row.lines, row.lines[1:]):
            text = ""
            for piece in line.pieces:
                text = text.ljust(piece.column) + piece.text
            if line.comment:
                if following and following.pieces:
                    column = following.pieces[0].column
                text = text.ljust(line.comment_column if line.pieces else column) + line.comment
            yield text + "\n"
