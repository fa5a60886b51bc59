"""Reading files and following imports: paths to syntax trees, imported files first."""

from __future__ import annotations

import stat
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from colony.diagnostics import Diagnostic, error
from colony.dsl import ast
from colony.dsl.parse import parse
from colony.record import Record, record
from colony.source import Source, Span

MAX_BYTES = 64 * 1024 * 1024
MAX_FILES = 1000


@record
class Import(Record):
    """An import of a file, resolved: `target` is the key of the file it brings in."""

    declaration: ast.ImportDecl
    target: str


@record
class SourceFile(Record):
    """One file of a program; in it, the file's names begin with `prefix` (`brooks.` or nothing)."""

    key: str
    source: Source
    tree: ast.File
    imports: tuple[Import, ...] = ()
    lost_names: frozenset[str] = frozenset()
    prefix: str = ""
    is_root: bool = False

    @property
    def stem(self) -> str:
        return Path(self.source.name).stem


@record
class SourceTree(Record):
    """All files of a program, each after those that it imports; the last is the one that was asked for."""

    files: tuple[SourceFile, ...]
    diagnostics: tuple[Diagnostic, ...]


Report = Callable[[str, str, str | None], None]
"""Called with a code, a message and a hint; the caller knows where."""


def read_source(path: Path, name: str, report: Report) -> Source | None:
    """The text of a regular file in UTF-8, or None after `report` was told why not."""
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            report("E001", f"cannot read `{name}`: it is a directory", "name a file that ends in .colony")
            return None
        if not stat.S_ISREG(status.st_mode):
            report("E001", f"cannot read `{name}`: it is not a regular file", None)
            return None
        if status.st_size > MAX_BYTES:
            size, limit = status.st_size >> 20, MAX_BYTES >> 20
            report("E003", f"`{name}` has {size} MiB; at most {limit} MiB are read", None)
            return None
        data = path.read_bytes()
    except (OSError, ValueError) as problem:
        reason = problem.strerror if isinstance(problem, OSError) and problem.strerror else str(problem)
        report("E001", f"cannot read `{name}`: {reason}", None)
        return None
    return decode(data, name, report)


def decode(data: bytes, name: str, report: Report) -> Source | None:
    """The source of these bytes, or None after `report` was told of the first that is no text."""
    try:
        text = data.decode("utf-8-sig")
        bad = text.find("\0")
        byte, what = (len(text[:bad].encode()), "a NUL byte") if bad >= 0 else (-1, "")
    except UnicodeDecodeError as problem:
        byte, what = problem.start, "a byte that is not UTF-8"
    if byte < 0:
        return Source(name, text)
    line = data.count(b"\n", 0, byte) + 1
    column = byte - (data.rfind(b"\n", 0, byte) + 1) + 1
    report("E002", f"{what} in line {line}, column {column} of `{name}`", "save the file as UTF-8 text")
    return None


def load_tree(path: Path, name: str, text: str | None = None) -> SourceTree:
    """The file at `path` (or `text` in its place) and everything that it imports, however far.

    Nothing is raised: what cannot be read, and cycles, are among the diagnostics.
    """
    loader = _Loader()
    key = str(path.resolve())
    source = Source(name, text) if text is not None else None
    if source is None:
        at = Span(Source(name, ""), 0, 0)
        source = read_source(path, name, lambda c, m, h: loader.diagnostics.append(error(c, at, m, h)))
    if source is None:
        return SourceTree(files=(), diagnostics=tuple(loader.diagnostics))
    loader.load(key, path, source)
    return SourceTree(files=loader.in_order(key), diagnostics=tuple(loader.diagnostics))


class _Loader:
    """Files found so far. Iterative, so that a long chain of imports is no deep recursion."""

    def __init__(self) -> None:
        self.files: dict[str, SourceFile] = {}
        self.diagnostics: list[Diagnostic] = []

    def load(self, key: str, path: Path, source: Source) -> None:
        waiting = [(key, path, source)]
        seen = {key}
        while waiting:
            key, path, source = waiting.pop()
            parsed = parse(source)
            self.diagnostics += parsed.diagnostics
            imports = []
            for declaration in parsed.file.declarations:
                if not isinstance(declaration, ast.ImportDecl):
                    continue
                target = (path.parent / declaration.path).resolve()
                imports.append(Import(declaration=declaration, target=str(target)))
                if str(target) in seen:
                    continue
                seen.add(str(target))
                found = self._read(source, path, declaration, len(seen))
                if found is not None:
                    waiting.append((str(target), target, found))
            self.files[key] = SourceFile(
                key=key,
                source=source,
                tree=parsed.file,
                imports=tuple(imports),
                lost_names=parsed.lost_names,
            )

    def _read(self, source: Source, path: Path, declaration: ast.ImportDecl, count: int) -> Source | None:
        span = Span(source, declaration.start, declaration.end)

        def report(code: str, message: str, hint: str | None) -> None:
            self.diagnostics.append(error("E103" if code == "E001" else code, span, message, hint))

        if count > MAX_FILES:
            report("E103", f"more than {MAX_FILES} files are imported", None)
            return None
        shown = str(Path(source.name).parent / declaration.path)
        return read_source(path.parent / declaration.path, shown, report)

    def in_order(self, root: str) -> tuple[SourceFile, ...]:
        """Depth first, imports before importers; a cycle is reported where it closes, and cut there."""
        order: list[str] = []
        done: set[str] = set()
        trail: dict[str, None] = {root: None}
        stack = [(root, iter(self.files[root].imports))]
        while stack:
            key, imports = stack[-1]
            one = next(imports, None)
            if one is None:
                stack.pop()
                trail.pop(key)
                done.add(key)
                order.append(key)
            elif one.target in trail:
                self._report_cycle(key, one, list(trail))
            elif one.target in self.files and one.target not in done:
                trail[one.target] = None
                stack.append((one.target, iter(self.files[one.target].imports)))
        prefixes = self._prefixes(root)
        return tuple(replace(self.files[key], prefix=prefixes[key], is_root=key == root) for key in order)

    def _report_cycle(self, key: str, closing: Import, trail: list[str]) -> None:
        cycle = [Path(k).name for k in trail[trail.index(closing.target) :]]
        names = " imports ".join(f"`{name}`" for name in [*cycle, cycle[0]])
        span = Span(self.files[key].source, closing.declaration.start, closing.declaration.end)
        hint = "move what both need into a third file"
        self.diagnostics.append(error("E104", span, f"imports go round in a cycle: {names}", hint))

    def _prefixes(self, root: str) -> dict[str, str]:
        """What each file's names are called by: over the way with the fewest aliases, the first of equals."""
        prefixes = {root: ""}
        layer = [root]
        while layer:
            later: list[str] = []
            for key in layer:  # grows while it runs: plain imports stay on this layer
                for one in self.files[key].imports:
                    if one.target in prefixes or one.target not in self.files:
                        continue
                    alias = one.declaration.alias
                    if alias is None:
                        prefixes[one.target] = prefixes[key]
                        layer.append(one.target)
                    else:
                        later.append(key)
            layer = []
            for key in later:
                for one in self.files[key].imports:
                    alias = one.declaration.alias
                    if alias is not None and one.target in self.files and one.target not in prefixes:
                        prefixes[one.target] = f"{prefixes[key]}{alias.text}."
                        layer.append(one.target)
        return prefixes
