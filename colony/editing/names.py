"""The names that can be written at a place of an open file, from its last index."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from colony.editing.index import Declaration
from colony.editing.open_file import OpenFile
from colony.editing.text import Lexeme
from colony.ir.program import SENT

_BELOW = ("let", "function", "assume")
"""Kinds of declarations that are named below them alone."""


@dataclass(frozen=True)
class Names:
    """The names at an offset of the present text."""

    file: OpenFile
    offset: int

    @cached_property
    def module(self) -> int:
        """The module, sequence or machine around the offset; -1 if there is none."""
        return self.file.around(self.offset, "module", "sequence", "machine")

    @cached_property
    def local(self) -> list[int]:
        """The declarations of the module, of the function, and of the reductions around the offset."""
        found: list[int] = []
        if self.module >= 0 and self.file.declaration(self.module).kind == "module":
            found += [n for n in self.file.known.children(self.module) if self._is_above(n)]
        function = self.file.around(self.offset, "function")
        found += self.file.known.children(function) if function >= 0 else []
        variables = ((n, d) for n, d in self.file.own_declarations() if d.kind == "variable")
        return found + [n for n, d in variables if self._is_inside(d)]

    @cached_property
    def values(self) -> list[int]:
        """The values that an expression can name."""
        return [*self.local, *(n for n in self.file.file.values if self._is_above(n))]

    @cached_property
    def parts(self) -> list[int]:
        """The modules, wires and actuators."""
        return self.file.file.parts

    def _is_above(self, number: int) -> bool:
        declared = self.file.declaration(number)
        if declared.kind not in _BELOW or declared.file != self.file.number:
            return True
        last = self.file.drift.to_now(declared.last)
        return last is not None and last < self.offset

    def _is_inside(self, declared: Declaration) -> bool:
        first, last = self.file.drift.to_now(declared.first), self.file.drift.to_now(declared.last)
        return first is not None and last is not None and first <= self.offset <= last

    def of_kind(self, numbers: Sequence[int], *kinds: str) -> Iterator[int]:
        """Yield the declarations of these kinds."""
        return (n for n in numbers if self.file.declaration(n).kind in kinds)

    def resolve(self, path: Sequence[str]) -> list[int]:
        """Return the declarations that a dotted name may mean: a value and a part may share a name."""
        if not path:
            return []
        if path[0] == SENT and len(path) > 1:
            return self._members(self._named(self.parts, path[1]), path[2:])
        for alias, number in self.file.file.aliases:
            if self.file.declaration(alias).name == path[0] and len(path) > 1:
                inner = self.file.known.files[number]
                return self._members(self._named([*inner.values, *inner.parts], path[1]), path[2:])
        local = self._named(self.local, path[0])
        return self._members(local or self._named([*self.values, *self.parts], path[0]), path[1:])

    def _named(self, numbers: Sequence[int], name: str) -> list[int]:
        return [n for n in dict.fromkeys(numbers) if self.file.declaration(n).name == name]

    def _members(self, owners: list[int], path: Sequence[str]) -> list[int]:
        for name in path:
            owners = [
                n for owner in owners for n in self.members(owner) if self.file.declaration(n).name == name
            ]
        return owners

    def members(self, owner: int) -> list[int]:
        """Return the declarations that can follow a name and a dot."""
        return self.file.known.children(owner)

    def of_alias(self, name: str) -> list[int]:
        """Return what can follow an alias and a dot; the robot's names cannot."""
        for alias, number in self.file.file.aliases:
            if self.file.declaration(alias).name == name:
                inner = self.file.known.files[number]
                both = [*inner.values, *inner.parts]
                return [n for n in both if self.file.declaration(n).kind != "sensor"]
        return []


# --- what stands before a place -------------------------------------------------------------------------


def dotted(before: Sequence[Lexeme]) -> list[str]:
    """Return the dotted name that lexemes end with; nothing if they end with none."""
    path: list[str] = []
    for lexeme in reversed(before):
        if lexeme.kind != "word" if len(path) % 2 == 0 else lexeme.text != ".":
            break
        path.append(lexeme.text)
    return path[::-2] if len(path) % 2 else path[-2::-2]


def open_parenthesis(before: Sequence[Lexeme]) -> int:
    """Return the number of the innermost parenthesis that is open; -1 if a bracket, or nothing, is."""
    depth = 0
    for i in range(len(before) - 1, -1, -1):
        if before[i].text in ")]}":
            depth += 1
        elif before[i].text in "([{":
            depth -= 1
            if depth < 0:
                return i if before[i].text == "(" else -1
    return -1


def called(before: Sequence[Lexeme]) -> list[str]:
    """Return the dotted name that is being called; nothing where no call is open."""
    place = open_parenthesis(before)
    return dotted(before[:place]) if place >= 0 else []
