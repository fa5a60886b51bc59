"""The drivers that a body names, held to the sources of their modules, none of which is imported or run."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from colony.body.model import Hardware
from colony.body.reader import BodyFile
from colony.files import read_file
from colony.text.diagnostics import Diagnostic, error, warning
from colony.text.suggestions import did_you_mean
from colony.text.wording import quoted

MAX_BYTES = 4 << 20
"""Maximum size of a module that is read."""

GIVEN = "frame_ns"
"""The parameter that a driver is given without an option."""

_Definition = ast.FunctionDef | ast.ClassDef


def driver_misfits(file: BodyFile) -> Iterator[Diagnostic]:
    """Yield what is wrong with the names and options of drivers, as far as their sources are at hand."""
    for name, server in () if file.body is None else file.body.servers.items():
        if server.hardware is not None:
            yield from _misfits(name, server.hardware, file)


def _misfits(server: str, hardware: Hardware, file: BodyFile) -> Iterator[Diagnostic]:
    module, _, name = hardware.driver.partition(":")
    place = file.value("server", server, "hardware", "driver")
    folders = (Path(file.source.name).resolve().parent, Path.cwd(), *map(Path, sys.path))
    path = next((found for folder in folders if (found := _file_of(folder, module)) is not None), None)
    if path is None:
        if not _is_installed(module):
            hint = "it is looked for beside the body, in the current folder, and among installed packages"
            yield warning("B020", place, f"there is no module `{module}`", hint)
        return
    try:
        tree = ast.parse(read_file(path, MAX_BYTES))
    except (OSError, SyntaxError, ValueError) as problem:
        yield error("B020", place, f"`{module}` cannot be read: {problem}")
        return
    names = dict(_names(tree.body))
    if name not in names and "*" not in names:
        yield error("B020", place, f"`{module}` has no class `{name}`", did_you_mean(name, list(names)))
    elif (accepted := _parameters(names.get(name))) is not None:
        yield from _option_misfits(server, hardware, file, accepted)


def _option_misfits(
    server: str, hardware: Hardware, file: BodyFile, accepted: ast.arguments
) -> Iterator[Diagnostic]:
    parameters = [a.arg for a in (*accepted.posonlyargs, *accepted.args, *accepted.kwonlyargs)]
    positional = parameters[: len(accepted.posonlyargs) + len(accepted.args)]
    required = positional[: len(positional) - len(accepted.defaults)]
    required += [a.arg for a, x in zip(accepted.kwonlyargs, accepted.kw_defaults, strict=True) if x is None]
    for option in hardware.options:
        if option not in parameters and accepted.kwarg is None:
            place = file.key("server", server, "hardware", option)
            others = [parameter for parameter in parameters if parameter != GIVEN]
            hint = did_you_mean(option, others) or (f"it has {quoted(others)}" if others else "it has none")
            yield error("B020", place, f"`{hardware.driver}` has no option `{option}`", hint)
    missing = [name for name in required if name not in hardware.options and name != GIVEN]
    if missing:
        place = file.value("server", server, "hardware", "driver")
        yield error("B020", place, f"`{hardware.driver}` requires {quoted(missing)}")


def _file_of(folder: Path, module: str) -> Path | None:
    base = folder.joinpath(*module.split("."))
    return next((path for path in (base / "__init__.py", base.with_suffix(".py")) if path.is_file()), None)


def _is_installed(module: str) -> bool:
    """Return True if the module may be found in another way; only its first name is looked up."""
    try:
        return find_spec(module.partition(".")[0]) is not None
    except (ImportError, ValueError):
        return False


def _names(body: list[ast.stmt]) -> Iterator[tuple[str, _Definition | None]]:
    """Yield the names that a module has, with the definitions of functions and classes."""
    for node in body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield name, node
            case ast.Import(names=aliases) | ast.ImportFrom(names=aliases):
                yield from (((a.asname or a.name).partition(".")[0], None) for a in aliases)
            case ast.If() | ast.Try() | ast.With():
                yield from _names([n for n in ast.iter_child_nodes(node) if isinstance(n, ast.stmt)])
                for handler in getattr(node, "handlers", ()):
                    yield from _names(handler.body)
            case _:
                stored = (n for n in ast.walk(node) if isinstance(n, ast.Name))
                yield from ((n.id, None) for n in stored if isinstance(n.ctx, ast.Store))


def _parameters(definition: _Definition | None) -> ast.arguments | None:
    """Return what a function, or the constructor of a class, takes; None if that is not plain to see."""
    if definition is None or definition.decorator_list:
        return None
    if isinstance(definition, ast.FunctionDef):
        return definition.args
    for node in definition.body:
        if isinstance(node, ast.FunctionDef) and node.name == "__init__" and not node.decorator_list:
            takes = node.args
            if takes.posonlyargs or not takes.args:
                return None
            del takes.args[0]  # self
            return takes
    return None
