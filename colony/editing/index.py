"""What is known about a program while it is edited: declarations, uses and findings, as plain data.

The process that analyzes makes an `Index` of the text that it was given; the server answers from the last
one, and maps its offsets to the text that is open now. Offsets are in characters of `IndexedFile.text`.
"""

from __future__ import annotations

from bisect import bisect_right
from typing import Literal

from msgspec import Struct

KINDS = (
    *("actuator", "alias", "assume", "contract", "enum", "field", "file", "function", "input", "let"),
    *("machine", "member", "module", "param", "parameter", "phase", "reach", "robot", "sensor"),
    *("sequence", "state", "task", "test", "variable", "wire"),
)
"""The kinds of declarations."""


class Declaration(Struct, frozen=True, array_like=True, gc=False):
    """A name that a program declares.

    Attributes:
        kind: Its kind, one of `KINDS`.
        name: Its name, as written where it is declared.
        file: Number of its file.
        start: Where its name begins.
        end: Where its name ends.
        first: Where the declaration begins.
        last: Where it ends.
        parent: Number of the declaration that it stands in; -1 for none.
        base: Number of the module that it is derived from; -1 for none.
        type: Its type as the language writes it; "" if it has none, or has errors.
        facts: What is known besides, one sentence an entry.
    """

    kind: str
    name: str
    file: int
    start: int
    end: int
    first: int
    last: int
    parent: int = -1
    base: int = -1
    type: str = ""
    facts: tuple[str, ...] = ()


class TextChange(Struct, frozen=True, array_like=True, gc=False):
    """A replacement of characters `start` up to `end`."""

    start: int
    end: int
    text: str


class QuickFix(Struct, frozen=True, array_like=True):
    """Changes that mend a finding in the same file."""

    title: str
    changes: tuple[TextChange, ...]


class FindingLabel(Struct, frozen=True, array_like=True):
    """Another place that a finding refers to."""

    path: str
    start: int
    end: int
    text: str


class EditorFinding(Struct, frozen=True, array_like=True):
    """An error, a warning or a note at characters of a file."""

    start: int
    end: int
    severity: Literal["error", "warning", "note"]
    code: str
    message: str
    labels: tuple[FindingLabel, ...] = ()
    fixes: tuple[QuickFix, ...] = ()


class IndexedFile(Struct, array_like=True):
    """A file of a program.

    Attributes:
        path: Its real path.
        text: The text that was analyzed.
        uses: Start, end and declaration of each name, declarations included, in order.
        findings: What is wrong in it.
        hints: Offsets, and what an editor shows there between the characters.
        values: The declarations that expressions of the file can name, sensors included.
        parts: The declarations that its network can name.
        aliases: The declarations of aliases, each with the number of the file that it leads to.
    """

    path: str
    text: str
    uses: list[tuple[int, int, int]] = []
    findings: list[EditorFinding] = []
    hints: list[tuple[int, str]] = []
    values: list[int] = []
    parts: list[int] = []
    aliases: list[tuple[int, int]] = []


class Index(Struct, array_like=True):
    """A program; the file that was asked for is the last one. `is_valid` if it has no errors."""

    files: list[IndexedFile] = []
    declarations: list[Declaration] = []
    is_valid: bool = False

    @property
    def root(self) -> IndexedFile:
        """The file that was asked for."""
        return self.files[-1]

    def file(self, path: str) -> tuple[int, IndexedFile] | None:
        """Return a file of the program by its real path, with its number."""
        return next(((i, f) for i, f in enumerate(self.files) if f.path == path), None)

    def use_at(self, file: IndexedFile, offset: int) -> tuple[int, int, int] | None:
        """Return the use of a name that `offset` is in, or at the end of."""
        at = bisect_right(file.uses, (offset, len(file.text) + 1, 0)) - 1
        if at < 0 or not file.uses[at][0] <= offset <= file.uses[at][1]:
            return None
        return file.uses[at]

    def children(self, parent: int) -> list[int]:
        """Return the declarations inside a declaration; those of a module are those of its base, too."""
        seen, found = set[int](), list[int]()
        while parent >= 0 and parent not in seen:
            seen.add(parent)
            found += [i for i, d in enumerate(self.declarations) if d.parent == parent]
            parent = self.declarations[parent].base
        return found
