"""Reading files and following imports: paths to syntax trees, imported files first."""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from colony.dsl import ast
from colony.dsl.descriptions import shown as shown_path
from colony.dsl.parse import parse, version_error
from colony.dsl.robot_import import (
    ProgramContext,
    ProgramFile,
    chosen_description,
    conflicting_choice,
    declaring_file,
    robot_import_span,
)
from colony.files import COMPILED, read_file, reason, size_text
from colony.record import Record, record
from colony.shipped import Shipped
from colony.text.diagnostics import Diagnostic, error
from colony.text.source import Source, Span

MAX_BYTES = 4 * 1024 * 1024
MAX_FILES = 1000
SHIPPED = "colony.shipped"
"""The directory, next to a recorded program, for the files shipped with colony."""
_MAX_CYCLE_FILES = 6


@record
class Import(Record):
    """An import of a file, resolved.

    Attributes:
        declaration: the import as written.
        target: the key of the imported file; of `import robot`, that of its description, "" for none.
        path: its path relative to the importing file; None for a file shipped with colony. That of a
            robot's description, which the program does not import by path, is absolute.
    """

    declaration: ast.ImportDecl | ast.RobotImportDecl
    target: str
    path: str | None


@record
class ParsedFile(Record):
    """A file of a program; in the program, its names begin with `prefix` (such as `brooks.`, or nothing)."""

    key: str
    source: Source
    tree: ast.File
    imports: tuple[Import, ...] = ()
    lost_names: frozenset[str] = frozenset()
    prefix: str = ""
    is_root: bool = False

    @property
    def stem(self) -> str:
        """Return the file name without directory and suffix."""
        return Path(self.source.name).stem


@record
class SourceTree(Record):
    """All files of a program, each after those that it imports; the main file is the last."""

    files: tuple[ParsedFile, ...]
    diagnostics: tuple[Diagnostic, ...]


class UnreadableFileError(Exception):
    """A file cannot be read; holds the contents of a diagnostic.

    `span` is the invalid byte, if the file has one.
    """

    def __init__(self, code: str, message: str, hint: str | None = None, span: Span | None = None) -> None:
        super().__init__(message)
        self.code, self.message, self.hint, self.span = code, message, hint, span

    def diagnostic(self, requested_by: Span) -> Diagnostic:
        """Return the diagnostic to report; `requested_by` is the span that named the file."""
        return error(self.code, self.span or requested_by, self.message, self.hint)


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
            behavior_hint = "name a file that ends in .colony"
            raise UnreadableFileError(
                "E001", f"cannot read `{name}`: it is a directory", behavior_hint
            ) from problem
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
        UnreadableFileError: they are not UTF-8 text; its span is the first invalid byte.
    """
    try:
        text = data.decode("utf-8-sig")
        invalid_offset, what = text.find("\0"), "a NUL byte"
    except UnicodeDecodeError as problem:
        text, what = data.decode("utf-8-sig", errors="replace"), "a byte that is not UTF-8"
        invalid_offset = len(problem.object[: problem.start].decode())
    source = Source(name, text)
    if invalid_offset >= 0:
        hint = "save the file as UTF-8 text"
        raise UnreadableFileError(
            "E002", f"found {what}, expected text", hint, Span(source, invalid_offset, invalid_offset + 1)
        )
    return source


def real_path(path: Path) -> str:
    """Return the absolute path of a file with links resolved; an invalid path is returned unchanged."""
    try:
        return os.path.realpath(path)
    except (OSError, ValueError):
        return str(path)


def load_tree(
    path: Path,
    name: str,
    text: str | None = None,
    *,
    shipped: Path | None = None,
    context: ProgramContext | None = None,
    within: Path | None = None,
    open_texts: Mapping[str, str] | None = None,
) -> SourceTree:
    """Load the file at `path` (or `text` in its place) and everything that it imports, transitively.

    Imports by name are looked up in `shipped`, if given, instead of the files shipped with colony; `import
    robot` is the robot that the program declares, or else that of `context`. With `within`, no file outside
    this folder is opened. `open_texts` stand in for files, by real path: those that an editor has open.
    Unreadable files and cycles are reported as diagnostics; nothing is raised.
    """
    loader = _Loader(shipped, None if within is None else real_path(within), open_texts or {})
    key = real_path(path)
    try:
        source = read_source(path, name) if text is None else Source(name, text)
    except UnreadableFileError as problem:
        span = Span(Source(name, ""), 0, 0)
        return SourceTree(files=(), diagnostics=(problem.diagnostic(span),))
    loader.load(key, path, source)
    loader.bind_robot(context or ProgramContext())
    return SourceTree(files=loader.in_order(key), diagnostics=tuple(loader.diagnostics))


def relative_sources(tree: SourceTree, path: Path) -> tuple[tuple[str, Source], ...]:
    """Return the texts of a tree with their relative paths (see `Program.files`); the main file is at `path`.

    Paths are relative to the common directory of all files. Symbolic links are not resolved: imports find the
    files by these paths.
    """
    paths: dict[str, str] = {}
    shipped = os.path.join(os.path.dirname(os.path.abspath(path)), SHIPPED)
    robots = {i.target: i for file in tree.files for i in file.imports if _is_of_robot(i)}
    for file in reversed(tree.files):  # importers before what they import
        robot = robots.get(file.key)
        if (
            file.key not in paths and robot is not None and not file.is_root
        ):  # no import by path has placed it
            paths[file.key] = robot.path or os.path.join(shipped, os.path.basename(robot.target))
        file_path = paths.setdefault(file.key, os.path.abspath(path))
        for import_ in file.imports:
            if _is_of_robot(import_):
                continue
            own = os.path.join(os.path.dirname(file_path), import_.path) if import_.path is not None else None
            target = own or os.path.join(shipped, os.path.basename(import_.target))
            paths.setdefault(import_.target, os.path.normpath(target))
    base = os.path.commonpath([os.path.dirname(paths[file.key]) for file in tree.files])
    return tuple(
        (Path(os.path.relpath(paths[file.key], base)).as_posix(), file.source) for file in tree.files
    )


def _is_of_robot(import_: Import) -> bool:
    return isinstance(import_.declaration, ast.RobotImportDecl)


class _Loader:
    """Loads files, iteratively, so that import chains do not recurse. Mutable."""

    def __init__(self, shipped: Path | None, within: str | None, open_texts: Mapping[str, str]) -> None:
        self.shipped, self.within, self.open_texts = shipped, within, open_texts
        self.files: dict[str, ParsedFile] = {}
        self.diagnostics: list[Diagnostic] = []

    def load(self, key: str, path: Path, source: Source) -> None:
        queue = [(key, path, source)]
        seen = {key}
        while queue:
            key, path, source = queue.pop()
            parsed = parse(source)
            wrong_version = version_error(source, parsed.file.language)
            self.diagnostics += parsed.diagnostics if wrong_version is None else (wrong_version,)
            imports = []
            for declaration in parsed.file.declarations:
                if not isinstance(declaration, ast.ImportDecl):
                    continue
                target, relative_path = self._find(path, declaration.path)
                target_key = real_path(target)
                imports.append(Import(declaration=declaration, target=target_key, path=relative_path))
                if target_key in seen:
                    continue
                seen.add(target_key)
                shown = target if relative_path is None else Path(source.name).parent / relative_path
                found = self._read(source, target, os.path.normpath(shown), declaration, len(seen))
                if found is not None:
                    queue.append((target_key, Path(target_key), found))
            self.files[key] = ParsedFile(
                key=key,
                source=source,
                tree=parsed.file,
                imports=tuple(imports),
                lost_names=parsed.lost_names,
            )

    def bind_robot(self, context: ProgramContext) -> None:
        """Resolve `import robot` in all files; load the robot's description if no file declares a robot."""
        declared, import_span = (
            declaring_file(self._program_files()),
            robot_import_span(self._program_files()),
        )
        if declared is not None:
            found = conflicting_choice(declared, self.files, context)
            self.diagnostics += [] if found is None else [found]
            self._import_robot(declared[0].key, None)
        elif import_span is not None:
            chosen = chosen_description(import_span, context)
            if isinstance(chosen, Diagnostic):
                self.diagnostics.append(chosen)
                self._import_robot("", None)
            else:
                self._load_description(chosen, import_span)
                self._import_robot(real_path(chosen), os.path.abspath(chosen))

    def _program_files(self) -> list[ProgramFile]:
        return [ProgramFile(file.key, file.source, file.tree) for file in self.files.values()]

    def _load_description(self, path: Path, import_span: Span) -> None:
        """Load a description; report one that cannot be read, or that declares no robot."""
        key, errors = real_path(path), len(self.diagnostics)
        try:
            source = self._source(path, shown_path(path))
        except UnreadableFileError as problem:
            problem.code = "E321" if problem.code in ("E001", "E003") else problem.code
            self.diagnostics.append(problem.diagnostic(import_span))
            return
        self.load(key, path, source)
        if declaring_file(self._program_files()) is None and len(self.diagnostics) == errors:
            message = f"`{shown_path(path)}` declares no robot"
            hint = "a description has a declaration `robot NAME { ... }`"
            self.diagnostics.append(error("E321", import_span, message, hint))

    def _import_robot(self, target: str, path: str | None) -> None:
        """Add `import robot` to the files that say it, but for those that the robot's own file imports.

        Args:
            target: the key of that file; "" if there is none.
            path: its path; None if it is one of the program's files anyway.
        """
        below = self._imported_by(target)
        is_shipped = path is not None and Shipped.ROBOT.contains(Path(path))
        for key, file in self.files.items():
            found = [d for d in file.tree.declarations if isinstance(d, ast.RobotImportDecl)]
            is_cycle = path is not None and key == next(
                iter(self.files)
            )  # a description of its own main file
            if found and (key not in below or is_cycle):
                own = Import(declaration=found[0], target=target, path=None if is_shipped else path)
                self.files[key] = replace(file, imports=(*file.imports, own))

    def _imported_by(self, key: str) -> set[str]:
        """Return a file and all that it imports, transitively."""
        found, work = {key}, [key]
        while work:
            file = self.files.get(work.pop())
            new = set() if file is None else {i.target for i in file.imports} - found
            found |= new
            work += new
        return found

    def _find(self, importer: Path, name: str) -> tuple[Path, str | None]:
        """Return the path of an imported file, and its relative path as in `Import`."""
        own_path = os.path.join(importer.parent, name)
        own = Shipped.BEHAVIOR.user_file(own_path)
        if own is not None and real_path(Path(own)) == real_path(importer):
            own = None  # a file may extend the shipped file of the same name
        shipped_path = Shipped.BEHAVIOR.file_named(name, self.shipped) if own is None else None
        if shipped_path is not None:
            return shipped_path, None
        relative_path = name + (own or own_path).removeprefix(own_path)
        return importer.parent / relative_path, relative_path

    def _read(
        self, source: Source, path: Path, shown: str, declaration: ast.ImportDecl, count: int
    ) -> Source | None:
        """Return the text of an imported file, or None after reporting the reason at the import."""
        span = Span(source, declaration.start, declaration.end)
        if self.within is not None and not Path(real_path(path)).is_relative_to(self.within):
            message = f"`{declaration.path}` is not part of the recorded program"
            self.diagnostics.append(error("E103", span, message))
            return None
        if count > MAX_FILES:
            message = f"more than {MAX_FILES} files are imported"
            self.diagnostics.append(error("E103", span, message))
            return None
        try:
            return self._source(path, shown)
        except UnreadableFileError as problem:
            if problem.code in ("E001", "E003"):
                problem.code = "E103"
            self.diagnostics.append(problem.diagnostic(span))
            return None

    def _source(self, path: Path, name: str) -> Source:
        """Return the text of a file, or the one that is open in its place."""
        text = self.open_texts.get(real_path(path)) if self.open_texts else None
        return read_source(path, name) if text is None else Source(name, text)

    def in_order(self, root: str) -> tuple[ParsedFile, ...]:
        """Return the files depth first, imports before importers; report imports that close a cycle."""
        order: list[str] = []
        visited: set[str] = set()
        path_to_file: dict[str, None] = {root: None}
        stack = [(root, iter(self.files[root].imports))]
        while stack:
            key, imports = stack[-1]
            import_ = next(imports, None)
            if import_ is None:
                stack.pop()
                path_to_file.pop(key)
                visited.add(key)
                order.append(key)
            elif import_.target in path_to_file:
                self._report_cycle(key, import_, list(path_to_file))
            elif import_.target in self.files and import_.target not in visited:
                path_to_file[import_.target] = None
                stack.append((import_.target, iter(self.files[import_.target].imports)))
        prefixes = self._prefixes(root)
        return tuple(replace(self.files[key], prefix=prefixes[key], is_root=key == root) for key in order)

    def _report_cycle(self, key: str, closing: Import, path_to_file: list[str]) -> None:
        cycle = [Path(k).name for k in path_to_file[path_to_file.index(closing.target) :]]
        left_out = [] if len(cycle) <= _MAX_CYCLE_FILES else [f"... {len(cycle) - _MAX_CYCLE_FILES} more ..."]
        shown = [f"`{name}`" for name in cycle[:_MAX_CYCLE_FILES]]
        names = " imports ".join([*shown, *left_out, f"`{cycle[0]}`"])
        span = Span(self.files[key].source, closing.declaration.start, closing.declaration.end)
        hint = "move what both need into a third file"
        self.diagnostics.append(error("E104", span, f"files import each other in a cycle: {names}", hint))

    def _prefixes(self, root: str) -> dict[str, str]:
        """Return the prefix of each file's names: that of the first path with the fewest aliases."""
        prefixes = {root: ""}
        layer = [root]
        while layer:
            next_layer_importers: list[str] = []
            for key in layer:  # it grows in the loop: plain imports stay in this layer
                for import_ in self.files[key].imports:
                    if import_.target in prefixes or import_.target not in self.files:
                        continue
                    alias = import_.declaration.alias
                    if alias is None:
                        prefixes[import_.target] = prefixes[key]
                        layer.append(import_.target)
                    else:
                        next_layer_importers.append(key)
            layer = []
            for key in next_layer_importers:
                for import_ in self.files[key].imports:
                    alias = import_.declaration.alias
                    if alias is not None and import_.target in self.files and import_.target not in prefixes:
                        prefixes[import_.target] = f"{prefixes[key]}{alias.text}."
                        layer.append(import_.target)
        return prefixes
