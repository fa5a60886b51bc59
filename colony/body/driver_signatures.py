"""The drivers that a body names, held to the sources of their modules, none of which is imported or run."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from colony.body.devices import BaseSpec
from colony.body.model import HardwareTable
from colony.body.reader import BodyFile
from colony.files import read_file
from colony.ir.program import Actuator
from colony.text.diagnostics import Diagnostic, error, warning
from colony.text.wording import did_you_mean, listed, quoted

MAX_BYTES = 4 << 20
"""Maximum size of a module that is read."""

GIVEN = frozenset({"frame_ns", "robot_address"})
"""The parameters that a driver is given without an option."""

_Definition = ast.FunctionDef | ast.ClassDef


def driver_misfits(file: BodyFile, actuators: Sequence[Actuator] = ()) -> Iterator[Diagnostic]:
    """Yield what is wrong with the names, options and commands of drivers, as far as sources show it."""
    for name, server in () if file.body is None else file.body.servers.items():
        if server.hardware is not None:
            commands = [actuator.command for actuator in actuators if actuator.server == name]
            yield from _misfits(name, server.hardware, file, commands)


def _misfits(
    server: str, hardware: HardwareTable, file: BodyFile, commands: Sequence[str]
) -> Iterator[Diagnostic]:
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
    assert file.body is not None
    method = "drive" if isinstance(file.body.device(server), BaseSpec) else "command"
    missing = _missing_commands(names.get(name), method, commands)
    if missing:
        yield error("B020", place, f"`{hardware.driver}` has no {missing}")


def _missing_commands(definition: _Definition | None, method: str, commands: Sequence[str]) -> str:
    """Return which of the commands a driver lacks, or the method for them; "" if that is not plain to see."""
    if not commands or definition is None or definition.decorator_list:
        return ""
    if isinstance(definition, ast.ClassDef):
        stored = {n.attr for n in ast.walk(definition) if isinstance(n, ast.Attribute)}
        known = {*dict(_names(definition.body)), *stored}
        return "" if definition.bases or known & {method, "__getattr__"} else f"method `{method}`"
    match [node.value for node in ast.walk(definition) if isinstance(node, ast.Return)]:
        case [ast.Call(func=ast.Name(id="SerialFields"))]:
            offered: set[object] = set()
        case [ast.Call(func=ast.Name(id="SerialActuators"), args=[_, _, _, ast.Dict(keys=keys), *_])]:
            if not all(isinstance(key, ast.Constant) for key in keys):
                return ""
            offered = {key.value for key in keys if isinstance(key, ast.Constant)}
        case _:
            return ""
    lacking = [name for name in commands if name not in offered]
    return "command " + listed([f"`{name}`" for name in lacking], "or") if lacking else ""


_TYPES: Mapping[str, tuple[type, ...]] = {
    "int": (int, float),
    "float": (int, float),
    "str": (str,),
    "bool": (bool,),
}


def _is_of_type(value: object, annotation: ast.expr | None) -> bool:
    """Return False if an option is plainly not of the type of its parameter."""
    name = annotation.id if isinstance(annotation, ast.Name) else ""
    if name not in _TYPES:
        return True
    is_whole = name != "int" or not isinstance(value, float) or value.is_integer()
    return isinstance(value, _TYPES[name]) and is_whole and (isinstance(value, bool) == (name == "bool"))


def _option_misfits(
    server: str, hardware: HardwareTable, file: BodyFile, accepted: ast.arguments
) -> Iterator[Diagnostic]:
    declared = (*accepted.posonlyargs, *accepted.args, *accepted.kwonlyargs)
    parameters = [a.arg for a in declared]
    annotations = {a.arg: a.annotation for a in declared}
    positional = parameters[: len(accepted.posonlyargs) + len(accepted.args)]
    required = positional[: len(positional) - len(accepted.defaults)]
    required += [a.arg for a, x in zip(accepted.kwonlyargs, accepted.kw_defaults, strict=True) if x is None]
    for option, value in hardware.options.items():
        annotation = annotations.get(option, None if accepted.kwarg is None else accepted.kwarg.annotation)
        if annotation is not None and not _is_of_type(value, annotation):
            place = file.value("server", server, "hardware", option)
            message = f"`{option}` of `{hardware.driver}` takes `{ast.unparse(annotation)}`, not {value!r}"
            yield error("B020", place, message)
        if option not in parameters and accepted.kwarg is None:
            place = file.key("server", server, "hardware", option)
            others = [parameter for parameter in parameters if parameter not in GIVEN]
            hint = did_you_mean(option, others) or (f"it has {quoted(others)}" if others else "it has none")
            yield error("B020", place, f"`{hardware.driver}` has no option `{option}`", hint)
    missing = [name for name in required if name not in hardware.options and name not in GIVEN]
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
