"""Reading files and following imports: paths to syntax trees, imported files first."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from pathlib import Path

from colony.dsl import ast
from colony.dsl.parse import parse
from colony.files import COMPILED, read_file, reason, size_text
from colony.record import Record, record
from colony.shipped import Shipped
from colony.text.diagnostics import Diagnostic, error
from colony.text.source import Source, Span

MAX_BYTES = 4 * 1024 * 1024
MAX_FILES = 1000
SHIPPED = "colony.shipped"
"""The folder next to a recorded program with the files that are shipped with colony."""
_MAX_CYCLE_FILES = 6


@record
class Import(Record):
    """An import of a file, resolved.

    Attributes:
        declaration: the import as written.
        target: the key of the imported file.
        path: its path relative to the importing file; None for a file shipped with colony.
    """

    declaration: ast.ImportDecl
    target: str
    path: str | None


@record
class ParsedFile(Record):
    """A file of a program, in which the file's names begin with `prefix` (such as `brooks.`, or nothing)."""

    key: str
    source: Source
    tree: ast.File
    imports: tuple[Import, ...] = ()
    lost_names: frozenset[str] = frozenset()
    prefix: str = ""
    is_root: bool = False

    @property
    def stem(self) -> str:
        """Return the file's name without directory and suffix."""
        return Path(self.source.name).stem


@record
class SourceTree(Record):
    """All files of a program, each after those that it imports; the main file is the last."""

    files: tuple[ParsedFile, ...]
    diagnostics: tuple[Diagnostic, ...]


class UnreadableFileError(Exception):
    """A file that cannot be read, with the parts of a diagnostic.

    `span` is the place in the file itself, if one of its bytes is invalid.
    """

    def __init__(self, code: str, message: str, hint: str | None = None, span: Span | None = None) -> None:
        super().__init__(message)
        self.code, self.message, self.hint, self.span = code, message, hint, span

    def diagnostic(self, at: Span) -> Diagnostic:
        """Return the diagnostic to report; `at` is the place that asked for the file."""
        return error(self.code, self.span or at, self.message, self.hint)


def read_source(path: Path, name: str) -> Source:
    """Return the text of a regular file in UTF-8.

    Raises:
        UnreadableFileError: there is no such file, it is not a regular one, too large, or not text.
    """
    try:
        data = read_file(path, MAX_BYTES)
    except OSError as problem:
        if problem.errno == errno.EFBIG:
            raise UnreadableFileError("E003", f"`{name}` is larger than {size_text(MAX_BYTES)}") from problem
        if problem.errno == errno.EISDIR:
            named = "name a file that ends in .colony"
            raise UnreadableFileError("E001", f"cannot read `{name}`: it is a directory", named) from problem
        hint = Shipped.BEHAVIOR.hint(name) if problem.errno == errno.ENOENT else None
        raise UnreadableFileError("E001", f"cannot read `{name}`: {reason(problem)}", hint) from problem
    if data.startswith(COMPILED):
        hint = "name the file that it was compiled from; `colony run` takes both"
        raise UnreadableFileError(
            "E001", f"cannot read `{name}`: it is a compiled program, and its source is needed here", hint
        )
    return decode(data, name)


def decode(data: bytes, name: str) -> Source:
    """Return the source of these bytes.

    Raises:
        UnreadableFileError: they are not UTF-8 text; its span is the first byte that is none.
    """
    try:
        text = data.decode("utf-8-sig")
        bad, what = text.find("\0"), "a NUL byte"
    except UnicodeDecodeError as problem:
        text, what = data.decode("utf-8-sig", errors="replace"), "a byte that is not UTF-8"
        bad = len(problem.object[: problem.start].decode())
    source = Source(name, text)
    if bad >= 0:
        hint = "save the file as UTF-8 text"
        raise UnreadableFileError("E002", f"found {what}, expected text", hint, Span(source, bad, bad + 1))
    return source


def real_path(path: Path) -> str:
    """Return the absolute name of a file with links resolved; an invalid name is returned as it is."""
    try:
        return os.path.realpath(path)
    except (OSError, ValueError):
        return str(path)


def load_tree(path: Path, name: str, text: str | None = None, *, shipped: Path | None = None) -> SourceTree:
    """Load the file at `path` (or `text` in its place) and everything that it imports, transitively.

    Imports by name are looked up in `shipped`, if given, instead of the files shipped with colony. Unreadable
    files and cycles are reported as diagnostics; nothing is raised.
    """
    loader = _Loader(shipped)
    key = real_path(path)
    try:
        source = read_source(path, name) if text is None else Source(name, text)
    except UnreadableFileError as problem:
        at = Span(Source(name, ""), 0, 0)
        return SourceTree(files=(), diagnostics=(problem.diagnostic(at),))
    loader.load(key, path, source)
    return SourceTree(files=loader.in_order(key), diagnostics=tuple(loader.diagnostics))


def relative_sources(tree: SourceTree, path: Path) -> tuple[tuple[str, Source], ...]:
    """Return the texts of a tree with their relative paths (see `Program.files`); the main file is at `path`.

    Paths are relative to the folder that contains all files. They are those by which imports find the files,
    even if these are symbolic links.
    """
    places: dict[str, str] = {}
    shipped = os.path.join(os.path.dirname(os.path.abspath(path)), SHIPPED)
    for file in reversed(tree.files):  # importers before what they import
        place = places.setdefault(file.key, os.path.abspath(path))
        for one in file.imports:
            found = os.path.join(os.path.dirname(place), one.path) if one.path is not None else None
            target = found or os.path.join(shipped, os.path.basename(one.target))
            places.setdefault(one.target, os.path.normpath(target))
    base = os.path.commonpath([os.path.dirname(places[file.key]) for file in tree.files])
    return tuple(
        (Path(os.path.relpath(places[file.key], base)).as_posix(), file.source) for file in tree.files
    )


class _Loader:
    """A loader of files. Mutable: the files so far. Iterative, so that import chains do not recurse."""

    def __init__(self, shipped: Path | None) -> None:
        self.shipped = shipped
        self.files: dict[str, ParsedFile] = {}
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
                target, relative = self._find(path, declaration.path)
                target_key = real_path(target)
                imports.append(Import(declaration=declaration, target=target_key, path=relative))
                if target_key in seen:
                    continue
                seen.add(target_key)
                shown = target if relative is None else Path(source.name).parent / relative
                found = self._read(source, target, os.path.normpath(shown), declaration, len(seen))
                if found is not None:
                    waiting.append((target_key, Path(target_key), found))
            self.files[key] = ParsedFile(
                key=key,
                source=source,
                tree=parsed.file,
                imports=tuple(imports),
                lost_names=parsed.lost_names,
            )

    def _find(self, importer: Path, name: str) -> tuple[Path, str | None]:
        """Return the location of an imported file, and its path as in `Import`."""
        given = os.path.join(importer.parent, name)
        own = Shipped.BEHAVIOR.own(given)
        if own is not None and real_path(Path(own)) == real_path(importer):
            own = None  # a file may extend the shipped file of the same name
        named = Shipped.BEHAVIOR.named(name, self.shipped) if own is None else None
        if named is not None:
            return named, None
        relative = name + (own or given).removeprefix(given)
        return importer.parent / relative, relative

    def _read(
        self, source: Source, path: Path, shown: str, declaration: ast.ImportDecl, count: int
    ) -> Source | None:
        """Return the text of an imported file, or None after reporting the reason at the import."""
        span = Span(source, declaration.start, declaration.end)
        if count > MAX_FILES:
            message = f"more than {MAX_FILES} files are imported"
            self.diagnostics.append(error("E103", span, message))
            return None
        try:
            return read_source(path, shown)
        except UnreadableFileError as problem:
            if problem.code in ("E001", "E003"):
                problem.code = "E103"
            self.diagnostics.append(problem.diagnostic(span))
            return None

    def in_order(self, root: str) -> tuple[ParsedFile, ...]:
        """Return the files depth first, imports before importers; report and cut cycles where they close."""
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
        left_out = [] if len(cycle) <= _MAX_CYCLE_FILES else [f"... {len(cycle) - _MAX_CYCLE_FILES} more ..."]
        shown = [f"`{name}`" for name in cycle[:_MAX_CYCLE_FILES]]
        names = " imports ".join([*shown, *left_out, f"`{cycle[0]}`"])
        span = Span(self.files[key].source, closing.declaration.start, closing.declaration.end)
        hint = "move what both need into a third file"
        self.diagnostics.append(error("E104", span, f"files import each other in a cycle: {names}", hint))

    def _prefixes(self, root: str) -> dict[str, str]:
        """Return the prefix of each file's names: the path with the fewest aliases, the first of equals."""
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
