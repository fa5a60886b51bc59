"""Compiled programs with all that they need elsewhere: the robot's body, and the files of Python modules.

Installed modules (the standard library, packages) are left out. No module is imported in the search for
files.
"""

from __future__ import annotations

import ast
import sysconfig
from collections.abc import Callable, Iterable, Iterator
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path, PurePosixPath

from colony.body.reader import MAX_BYTES
from colony.compile.pipeline import Compilation, compile_program
from colony.dsl.descriptions import find_body
from colony.execute.colonyc import read, unusable
from colony.execute.compiled import Compiled, SourceFile
from colony.files import StrPath, read_file, reason
from colony.ir.program import Program, PythonModule
from colony.text.diagnostics import DiagnosticError


def compiled_with_sources(program: Program, report: Callable[[str], None]) -> Compilation:
    """Compile a program with all its sources, so that a recording can be audited on its own.

    The robot's body is the one beside its interface, and Python modules are found on `sys.path`. `report`
    takes a warning about each file that cannot be read, which is left out.
    """
    modules = (module.module_path for module in program.modules if isinstance(module, PythonModule))
    return compile_program(program, (*_body(program, report), *python_sources(modules, report)))


def _body(program: Program, report: Callable[[str], None]) -> Iterator[SourceFile]:
    """Yield the file of the robot's body, if it has one and the program has the file of its interface."""
    interfaces = [path for path, source in program.files if source == program.robot.span.source]
    file = find_body(program.robot) if interfaces else None
    if file is None:
        return
    try:
        data = read_file(file, MAX_BYTES)
    except OSError as problem:
        report(f"{file}: warning: cannot be included in the recording: {reason(problem)}")
        return
    yield SourceFile(kind="body", path=str(PurePosixPath(interfaces[0]).with_name(file.name)), data=data)


def read_compiled(path: StrPath) -> Compiled:
    """Read a compiled program, and check that its Python modules on `sys.path` have not changed.

    Raises:
        DiagnosticError: C001, the file cannot be read, contains no executable program, or a Python module has
            changed.
    """
    compiled = read(path)
    changed = changed_sources(compiled)
    if changed:
        raise DiagnosticError([unusable(str(path), f"`{changed[0]}` has changed since it was compiled")])
    return compiled


SOURCE_BYTES = 4 * 1024 * 1024
"""Size limit in bytes of a Python module's file in a recording."""

_INSTALLED = tuple(
    Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib", "purelib", "platlib")
)


def python_sources(names: Iterable[str], report: Callable[[str], None]) -> tuple[SourceFile, ...]:
    """Return the sources of these modules (dotted names) and of all their imports, found on `sys.path`.

    `report` takes a warning about each file that cannot be read, which is left out.
    """
    sources: dict[str, SourceFile] = {}
    pending, visited = list(names), set[str]()
    while pending:
        name = pending.pop()
        if name in visited or name.partition(".")[0] == "colony":
            continue
        visited.add(name)
        if "." in name:
            pending.append(name.rpartition(".")[0])
        spec = _find(name)
        source = None if spec is None else _user_source(spec, report)
        if spec is not None and source is not None:
            sources[source.path] = source
            pending += _imports(source.data, name, is_package=spec.submodule_search_locations is not None)
    return tuple(sources[path] for path in sorted(sources))


def changed_sources(compiled: Compiled) -> tuple[str, ...]:
    """Return the paths of Python modules that have changed since a program was compiled."""
    now = python_sources((call.module_path for call in compiled.code.python), lambda _: None)
    then = {source.path: source.data for source in compiled.sources if source.kind == "python"}
    return tuple(source.path for source in now if then.get(source.path, source.data) != source.data)


def _find(name: str) -> ModuleSpec | None:
    """Return the spec of a module, found package by package as an import would."""
    spec, path = None, None
    parts = name.split(".")
    for i in range(len(parts)):
        try:
            spec = PathFinder.find_spec(".".join(parts[: i + 1]), path)
        except (ImportError, ValueError):
            return None
        if spec is None:
            return None
        path = spec.submodule_search_locations or []
    return spec


def _user_source(spec: ModuleSpec, report: Callable[[str], None]) -> SourceFile | None:
    """Return the source of a module if it is a user's file; report one that cannot be read."""
    origin = Path(spec.origin) if spec.origin else None
    if origin is None or origin.suffix != ".py" or any(map(origin.resolve().is_relative_to, _INSTALLED)):
        return None
    path = spec.name.replace(".", "/")
    path += ".py" if spec.submodule_search_locations is None else "/__init__.py"
    try:
        return SourceFile(kind="python", path=path, data=read_file(origin, SOURCE_BYTES))
    except OSError as problem:
        report(f"{origin}: warning: cannot be included in the recording: {reason(problem)}")
        return None


def _imports(data: bytes, name: str, *, is_package: bool) -> Iterator[str]:
    """Yield the names that a module may import; some may not be modules."""
    try:
        tree = ast.parse(data)
    except (SyntaxError, ValueError):
        return
    package = name.split(".") if is_package else name.split(".")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join([*base, *([node.module] if node.module else [])])
            yield from [origin] if origin else []
            yield from (f"{origin}.{alias.name}" if origin else alias.name for alias in node.names)
