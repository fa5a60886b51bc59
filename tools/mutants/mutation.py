"""The mutants of a module: those of mutmut's operators, each as the whole text of the module.

mutmut's own runner puts every function behind a trampoline. That changes the text of modules that the Python
backend copies into what it generates, and it leaves out what stands outside of functions (the table of the
operators, say) and properties. So the operators are mutmut's, and the mutants are planted by `planting`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import libcst as cst
from libcst.metadata import ByteSpanPositionProvider, CodeSpan, MetadataWrapper, PositionProvider
from mutmut.mutation.file_mutation import Mutation, MutationVisitor, deep_replace
from mutmut.mutation.mutators import mutation_operators
from mutmut.mutation.pragma_handling import IgnoredCode


@dataclass(frozen=True, slots=True, kw_only=True)
class Mutant:
    """A module with one change, on `line`; `source` is the whole text.

    `was` and `now` are the changed lines, `place` the function or class around them. Where a function has the
    same change several times, `nth` tells them apart, from 1.
    """

    path: str
    place: str
    line: int
    was: str
    now: str
    nth: int
    source: str

    @property
    def key(self) -> str:
        """What it is called in the cache and in the list of survivors, whatever its line."""
        nth = f" #{self.nth}" if self.nth > 1 else ""
        return f"{self.place}: {self.was} => {self.now}{nth}"


def mutants_of(root: Path, path: str) -> list[Mutant]:
    """All mutants of a module, in the order of its text."""
    source = (root / path).read_text()
    visitor = _Visitor()
    module = MetadataWrapper(cst.parse_module(source)).visit(visitor)
    old = source.splitlines()
    found, seen = [], Counter[tuple[str, str, str]]()
    for line, place, span, mutation in visitor.found():
        text = _spliced(source, module, span, mutation) or _rendered(module, mutation)
        was, now = _difference(old, text.splitlines())
        if was != now:
            seen[place, was, now] += 1
            nth = seen[place, was, now]
            found.append(Mutant(path=path, place=place, line=line, was=was, now=now, nth=nth, source=text))
    return found


def _spliced(source: str, module: cst.Module, span: CodeSpan, mutation: Mutation) -> str | None:
    """The text with the node's own part replaced; None where a node's text depends on what is around it."""
    whole, first, last = source.encode(), span.start, span.start + span.length
    if whole[first:last] != module.code_for_node(mutation.original_node).encode():
        return None
    now = module.code_for_node(mutation.mutated_node)
    return None if "\n" in now else (whole[:first] + now.encode() + whole[last:]).decode()


def _rendered(module: cst.Module, mutation: Mutation) -> str:
    """The text of the whole module, made anew."""
    changed = deep_replace(module, mutation.original_node, mutation.mutated_node)
    assert isinstance(changed, cst.Module)
    return changed.code


class _Visitor(MutationVisitor):
    """mutmut's, and what its trampolines cannot do: decorated functions and properties."""

    METADATA_DEPENDENCIES = (  # type: ignore[assignment]  # mutmut's has the type of its two
        *MutationVisitor.METADATA_DEPENDENCIES,
        ByteSpanPositionProvider,
    )

    def __init__(self) -> None:
        super().__init__(mutation_operators, IgnoredCode(set(), set(), set()))
        self._around: list[str] = []
        self._where: list[tuple[int, str, CodeSpan]] = []

    def on_visit(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.FunctionDef | cst.ClassDef):
            self._around.append(node.name.value)
        known = len(self.mutations)
        into = super().on_visit(node)
        if len(self.mutations) > known:
            line = self.get_metadata(PositionProvider, node).start.line
            span = self.get_metadata(ByteSpanPositionProvider, node)
            where = (line, ".".join(self._around) or "module", span)
            self._where += [where] * (len(self.mutations) - known)
        return into

    def on_leave(self, original_node: cst.CSTNode) -> None:
        if isinstance(original_node, cst.FunctionDef | cst.ClassDef):
            self._around.pop()
        super().on_leave(original_node)

    def _skip_node_and_children(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.FunctionDef) and node.decorators:
            return False
        return bool(super()._skip_node_and_children(node))

    def found(self) -> Iterator[tuple[int, str, CodeSpan, Mutation]]:
        """Every mutation, with its line, the name of the place, and where the node stands."""
        for (line, place, span), mutation in zip(self._where, self.mutations, strict=True):
            yield line, place, span, mutation


def _difference(old: list[str], new: list[str]) -> tuple[str, str]:
    """The lines from the first to the last that differ, without indentation, each side joined by a space."""
    first, shorter = 0, min(len(old), len(new))
    while first < shorter and old[first] == new[first]:
        first += 1
    same = 0
    while same < shorter - first and old[-1 - same] == new[-1 - same]:
        same += 1
    was, now = old[first : len(old) - same], new[first : len(new) - same]
    return " ".join(line.strip() for line in was), " ".join(line.strip() for line in now)
