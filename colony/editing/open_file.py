"""A document that is open, beside what was known about it when it was analyzed last."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit

from colony.editing.index import Declaration, Index, IndexedFile, QuickFix
from colony.editing.text import Drift, Lines, TextPosition, TextRange


def path_of(uri: str) -> str:
    """Return the path that a `file:` URI names; any other URI is its own path."""
    parts = urlsplit(uri)
    return unquote(parts.path) if parts.scheme == "file" else uri


def uri_of(path: str) -> str:
    """Return the URI of a path."""
    return f"file://{quote(path)}" if Path(path).is_absolute() else path


@dataclass(slots=True)
class OpenFile:
    """A document with its last index. Mutable: it changes with each key.

    Attributes:
        uri: Its name, as the editor writes it.
        path: Its real path.
        version: Version of its text.
        lines: Its text now.
        index: The last index of the program of which it is the main file; None before the first.
        drift: What changed since that index.
        pending: What changed since the text that is being analyzed.
        others: All open documents, by path.
    """

    uri: str
    path: str
    version: int
    lines: Lines
    others: Mapping[str, OpenFile]
    index: Index | None = None
    drift: Drift = field(default_factory=Drift)
    pending: Drift = field(default_factory=Drift)

    @property
    def text(self) -> str:
        """The text now."""
        return self.lines.text

    def replace(self, start: int, end: int, text: str) -> None:
        """Replace characters of the text; those that are as before do not count as changed."""
        changed = Drift.between(self.text[start:end], text)
        self.lines = Lines(f"{self.text[:start]}{text}{self.text[end:]}")
        if changed.start >= 0:
            first, last = start + changed.start, start + changed.then
            for drift in (self.drift, self.pending):
                drift.change(first, last, changed.now - changed.start)

    # --- what was analyzed

    @property
    def known(self) -> Index:
        """The last index, an empty one before the first."""
        return Index() if self.index is None else self.index

    @property
    def file(self) -> IndexedFile:
        """What is known about this file."""
        return self.known.root if self.known.files else IndexedFile(self.path, "")

    @property
    def number(self) -> int:
        """The number of this file in its index."""
        return len(self.known.files) - 1

    def use_at(self, position: TextPosition) -> tuple[TextRange, int] | None:
        """Return the range and the declaration of the name at a position, if it was there when analyzed."""
        offset = self.drift.to_then(self.lines.offset(position))
        use = None if offset is None else self.known.use_at(self.file, offset)
        place = None if use is None else self.place(use[0], use[1])
        return None if use is None or place is None else (place, use[2])

    def place(self, start: int, end: int) -> TextRange | None:
        """Return where analyzed characters are now; None if they were changed."""
        first, last = self.drift.to_now(start), self.drift.to_now(end)
        return None if first is None or last is None or last < first else self.lines.range(first, last)

    def place_in(self, number: int, start: int, end: int) -> tuple[str, TextRange] | None:
        """Return the document and range of characters of a file of the program."""
        file = self.known.files[number]
        other = self.others.get(file.path)
        if other is self:
            own = self.place(start, end)
            return None if own is None else (self.uri, own)
        if other is None:
            return uri_of(file.path), Lines(file.text).range(start, end)
        drift = Drift.between(file.text, other.text)
        first, last = drift.to_now(start), drift.to_now(end)
        return None if first is None or last is None else (other.uri, other.lines.range(first, last))

    def own_declarations(self) -> Iterator[tuple[int, Declaration]]:
        """Yield the declarations of this file that stand in its text, with their numbers."""
        for number, declared in enumerate(self.known.declarations):
            if declared.file == self.number and declared.end > declared.start:
                yield number, declared

    def declaration(self, number: int) -> Declaration:
        """Return a declaration of the program."""
        return self.known.declarations[number]

    def text_of(self, declared: Declaration) -> str:
        """Return the text in which a declaration was analyzed."""
        return self.known.files[declared.file].text

    def around(self, offset: int, *kinds: str) -> int:
        """Return the declaration of these kinds around an offset of the present text; -1 if there is none."""
        found, size = -1, len(self.text) + 1
        for number, declared in self.own_declarations():
            if declared.kind not in kinds:
                continue
            first, last = self.drift.to_now(declared.first), self.drift.to_now(declared.last)
            if first is not None and last is not None and first <= offset <= last and last - first < size:
                found, size = number, last - first
        return found

    def edits(self, fix: QuickFix) -> list[dict[str, object]] | None:
        """Return the changes of a quick fix as edits of the present text; None if that was changed there."""
        found: list[dict[str, object]] = []
        for change in fix.changes:
            place = self.place(change.start, change.end)
            if place is None:
                return None
            found.append({"range": place, "newText": change.text})
        return found
