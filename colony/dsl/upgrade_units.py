"""Names of version 1 that have become units: where a text would be read differently now.

A number takes the unit behind it: what was `5` and the name `A`, or `2 m` divided by `N`, is one number now.
A person has to rename these before the file can be upgraded.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache

from colony.dsl import ast, parser
from colony.dsl.build import split_number
from colony.dsl.files import ParsedFile
from colony.text.diagnostics import Diagnostic, error
from colony.text.source import Span
from colony.text.units import BASE_UNITS, VERSION_1_UNITS

NEW_UNITS = BASE_UNITS.keys() - VERSION_1_UNITS

_UNIT_NAME = re.compile(r"[A-Za-z]+")


def names_as_units(file: ParsedFile) -> Iterator[Diagnostic]:
    """Yield an error at each place of a file of version 1 where a name is read as a unit now."""
    source = file.source
    for start, end in _numbers(source.text):
        digits, unit = split_number(source.text[start:end])
        names = [name for name in _UNIT_NAME.findall(unit or "") if name in NEW_UNITS]
        if names:
            message = f"`{names[0]}` is a unit now: this was a number and the name `{names[0]}`"
            hint = f"rename `{names[0]}`, or put `{digits}` and its unit in parentheses, before the upgrade"
            yield error("U006", Span(source, start, end), message, hint)
    for node in _named_by_units(file.tree):
        name = source.text[node.start : node.end]
        kind = "type" if isinstance(node, ast.TypeName) else "phase"
        message = f"`{name}` is a unit now, so no {kind} can have this name"
        yield error("U006", Span(source, node.start, node.end), message, "rename it before the upgrade")


@cache
def _tokens() -> re.Pattern[str]:
    [number] = [t.pattern.to_regexp() for t in parser._parser().terminals if t.name == "NUMBER"]
    return re.compile(rf'(?P<skipped>[A-Za-z_]\w*|"[^"\r\n]*"|#[^\r\n]*)|{number}')


def _numbers(text: str) -> Iterator[tuple[int, int]]:
    for token in _tokens().finditer(text):
        if token["skipped"] is None:
            yield token.span()


def _named_by_units(tree: ast.File) -> Iterator[ast.Name | ast.TypeName]:
    """Yield the types and the phases, each where it is named first, with names of new units."""
    for node in tree.declarations:
        match node:
            case ast.MachineDecl(initial=initial, transitions=transitions):
                named = (name for t in transitions for name in (t.source, t.target) if name is not None)
                phases = {name.text: name for name in reversed([initial, *named])}
                yield from (phases[name] for name in phases if name in NEW_UNITS)
            case ast.RobotDecl(items=items):
                for item in items:
                    yield from _types(item)
            case ast.StateDecl(type=ast.TypeName() as type_):
                yield from (type_,) if type_.path[0] in NEW_UNITS else ()
            case _:
                pass


def _types(item: ast.RobotItem) -> Iterator[ast.TypeName]:
    match item:
        case ast.SensorDecl(type=type_):
            types = [type_]
        case ast.ActuatorDecl(fields=fields):
            types = [field.type for field in fields]
        case _:
            types = []
    yield from (type_ for type_ in types if type_.path[0] in NEW_UNITS)
