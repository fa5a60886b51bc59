"""A program as an `Index`: the front end run over the text that is open, and what it found as data."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from colony.collector import gc_paused
from colony.dsl import ast
from colony.dsl.check.program import Examined, examine
from colony.dsl.check.scope import (
    FunctionSymbol,
    LetSymbol,
    MachineSymbol,
    ModuleSymbol,
    ParamSymbol,
    SensorSymbol,
    StateSymbol,
    TypedParameter,
    ValueSymbol,
)
from colony.dsl.descriptions import RobotChoice
from colony.dsl.files import SourceTree, load_tree, relative_sources
from colony.dsl.parse import SYNTAX_CODES, UNVERSIONED, VERSION_LINE, version_note
from colony.dsl.robot_import import context_of_file
from colony.editing.index import (
    Declaration,
    EditorFinding,
    FindingLabel,
    Index,
    IndexedFile,
    QuickFix,
    TextChange,
)
from colony.editing.network import NetworkFacts, network_facts
from colony.editing.occurrences import Occurrences
from colony.ir import program as ir
from colony.ir.types import Array, Bool, Enum, ScalarValue, Type, element_type, type_text, unit_shown
from colony.text.diagnostics import Diagnostic, in_order
from colony.text.source import Source
from colony.text.wording import Remedy, duration_text


@dataclass(frozen=True, slots=True)
class Analyzed:
    """The index of a program, the program if it has no errors, and its main file's tree."""

    index: Index
    program: ir.Program | None
    tree: ast.File


class Analyzer:
    """Makes indexes. Stateful: remembers what the network of each program was when it had no errors last."""

    def __init__(self) -> None:
        self._networks: dict[str, NetworkFacts] = {}

    def analyze(self, path: str, texts: Mapping[str, str], robot: str = "") -> Analyzed:
        """Return what is known about the program of a file.

        Args:
            path: The real path of the file.
            texts: The texts that are open in an editor, by real path.
            robot: The description for `import robot`; "" for that of the file's project.
        """
        with gc_paused():
            choice = RobotChoice(text=robot, origin="the editor's setting `robot`") if robot else None
            context = context_of_file(Path(path), choice)
            tree = load_tree(Path(path), path, texts.get(path), context=context, open_texts=texts)
            examined = examine(tree)
            found = Occurrences(tree, examined.scopes)
            if examined.scopes:
                found.find()
            if examined.program is not None:
                self._networks[path] = network_facts(examined.program)
            facts = self._networks.get(path, NetworkFacts({}, {}))
            main = tree.files[-1].tree if tree.files else ast.File(declarations=())
            program = examined.program
            if program is not None:
                program = replace(program, files=relative_sources(tree, Path(path)))
            return Analyzed(_index(tree, examined, found, facts), program, main)


def _index(tree: SourceTree, examined: Examined, found: Occurrences, network: NetworkFacts) -> Index:
    declarations = [_with_facts(found, i, network) for i in range(len(found.declarations))]
    files = [
        IndexedFile(file.key, file.source.text, uses)
        for file, uses in zip(tree.files, found.uses, strict=True)
    ]
    for number, file in enumerate(files if examined.scopes else ()):
        _add_visible(found, number, file)
        file.hints = list(_hints(file, declarations, number, network))
    _add_findings(tree, examined, files)
    return Index(files, declarations, examined.program is not None)


def _add_visible(found: Occurrences, number: int, file: IndexedFile) -> None:
    """Fill in what a file can name."""
    scope = found.scopes[file.path]
    sensors = [n for n in found.robot.values() if found.declarations[n].kind == "sensor"]
    actuators = [n for n in found.robot.values() if found.declarations[n].kind == "actuator"]
    for visible, tables, robot, numbers in (
        (scope.visible_values, found.values, sensors, file.values),
        (scope.visible_network_symbols, found.parts, actuators, file.parts),
    ):
        owned = (tables[found.numbers[owner.file.key]].get(name) for name, owner in visible.items())
        numbers += [*robot, *(n for n in owned if n is not None)]
    for name, target in scope.aliases.items():
        declared = found.aliases[number].get(name)
        if declared is not None:
            file.aliases.append((declared, found.numbers[target.file.key]))


# --- types and facts ----------------------------------------------------------------------------------


def _with_facts(found: Occurrences, number: int, network: NetworkFacts) -> Declaration:
    """Return a declaration with its type and what is known about it."""
    declared = found.declarations[number]
    symbol = _symbol(found, number)
    type_, facts = ("", ()) if symbol is None else _of_symbol(symbol)
    values = {name: getattr(declared, name) for name in declared.__struct_fields__}
    node = found.nodes[number]
    if declared.kind == "field" and isinstance(node, ast.FieldDecl):
        type_ = ".".join(node.type.path)
    if isinstance(node, ast.ParameterNode) and not type_:
        shape = f"[{'' if node.size is None else '...'}]" if node.is_array else ""
        type_ = ".".join(node.type.path) + shape
    if (
        declared.kind == "member"
        and isinstance(node, ast.Argument)
        and isinstance(node.value, ast.NumberNode)
    ):
        type_ = node.value.digits
    full_name = _full_name(found, number)
    facts = (
        (*facts, *network.facts.get(full_name, ()))
        if declared.kind in ("module", "task", "actuator")
        else facts
    )
    return Declaration(**(values | {"type": type_, "facts": tuple(facts)}))


def _full_name(found: Occurrences, number: int) -> str:
    declared = found.declarations[number]
    scope = found.scopes[found.tree.files[declared.file].key]
    if declared.kind == "actuator":
        return declared.name
    if declared.parent >= 0:
        return f"{_full_name(found, declared.parent)}.{declared.name}"
    return scope.full_name(declared.name)


def _symbol(found: Occurrences, number: int) -> ValueSymbol | None:
    """Return the checked symbol of a value, None if it has none or its text has errors."""
    declared = found.declarations[number]
    scope = found.scopes[found.tree.files[declared.file].key]
    if declared.parent < 0:
        return None if declared.kind in ("module", "wire") else scope.values.get(declared.name)
    owner = found.declarations[declared.parent]
    if owner.kind == "robot":
        return scope.robot.values.get(declared.name)
    part = scope.network_symbols.get(owner.name) if owner.kind == "module" else None
    return part.members.get(declared.name) if isinstance(part, ModuleSymbol) else None


def _of_symbol(symbol: ValueSymbol) -> tuple[str, tuple[str, ...]]:
    """Return the type of a value, and what is known about it."""
    match symbol:
        case SensorSymbol(sensor=sensor):
            return _shown_type(sensor.type, sensor.unit), tuple(_sensor_facts(sensor))
        case ParamSymbol(type=type_, value=value):
            shown = "" if isinstance(value, tuple) else value_text(value, type_)
            return _shown_type(type_), (f"`{shown}`",) if shown else ()
        case LetSymbol(type=type_) | StateSymbol(type=type_):
            return _shown_type(type_), ()
        case MachineSymbol(type=type_):
            return "machine", ()
        case FunctionSymbol(parameters=parameters, result=result):
            result_text = "" if result is None else f" -> {_shown_type(result)}"
            return f"({', '.join(map(_parameter_text, parameters))}){result_text}", ()
        case _:
            return "", ()


def _parameter_text(parameter: TypedParameter) -> str:
    shape = f"[{'' if parameter.size is None else parameter.size}]" if parameter.is_array else ""
    type_ = parameter.unit or _shown_type(parameter.element)
    default = parameter.default
    value = (
        ""
        if default is None or isinstance(default.value, tuple)
        else f" = {value_text(default.value, default.type)}"
    )
    return f"{parameter.name}{shape} : {type_}{value}"


def _shown_type(type_: Type, unit: str = "") -> str:
    """Return a type as a declaration writes it, by its declared unit if it has one."""
    if not unit:
        return type_text(type_)
    return f"{unit}[{type_.size}]" if isinstance(type_, Array) else unit


def value_text(value: ScalarValue, type_: Type) -> str:
    """Return a constant in base units as the language writes it, in a readable unit.

    Example:
        >>> from colony.ir.types import DISTANCE
        >>> value_text(900.0, DISTANCE)
        '900 mm'
    """
    element = element_type(type_)
    if isinstance(element, Bool) or isinstance(value, bool):
        return str(bool(value)).lower()
    if isinstance(element, Enum):
        return next((f"{element.name}.{name}" for name, n in element.members if n == value), str(value))
    unit = unit_shown(element)
    number = f"{value / float(unit.factor):.10g}"
    return number if unit.text == "number" else f"{number} {unit.text}"


def _sensor_facts(sensor: ir.Sensor) -> Iterator[str]:
    if sensor.low is not None and sensor.high is not None:
        low, high = (_declared_number(x, sensor) for x in (sensor.low, sensor.high))
        yield f"range {low} .. {high} {sensor.unit}".rstrip()
    if sensor.tunable:
        yield "may change while the program runs"
        return
    yield f"from {sensor.server}.{sensor.field}"
    if sensor.within_ns is None:
        yield "readings do not age"
    else:
        yield f"missing when older than {duration_text(sensor.within_ns)}"
    if sensor.default is not None:
        shown = (
            sensor.default if isinstance(sensor.default, bool) else _declared_number(sensor.default, sensor)
        )
        unit = f" {sensor.unit}" if sensor.unit and not isinstance(sensor.default, bool) else ""
        yield f"where it is missing, {str(shown).lower()}{unit}"


def _declared_number(value: float, sensor: ir.Sensor) -> str:
    return f"{value / sensor.factor:.10g}"


# --- hints ----------------------------------------------------------------------------------------------

_PLAIN = re.compile(r"\s*(?:-\s*)?[\d.]+(?:[eE][+-]?\d+)?[ \t]*[\w/*^-]*\s*(?:#.*)?$", re.MULTILINE)


def _hints(
    file: IndexedFile, declarations: list[Declaration], number: int, network: NetworkFacts
) -> Iterator[tuple[int, str]]:
    """Yield priorities of modules, values of constants that are computed, and units of lets."""
    for declared in declarations:
        if declared.file != number or declared.end == declared.start:
            continue
        if declared.kind in ("module", "task") and declared.facts:
            if declared.facts[0].startswith("priority"):
                yield declared.end, f" {declared.facts[0]}"
        elif declared.kind in ("let", "state") and declared.type and declared.type != "number":
            after = file.text[declared.end : declared.end + 40].lstrip()
            if not after.startswith(":"):
                yield declared.end, f" : {declared.type}"
        elif declared.kind == "param" and declared.facts and declared.facts[0].startswith("`"):
            value = file.text[file.text.find("=", declared.end) + 1 : declared.last]
            if not _PLAIN.match(value):
                yield declared.last, f" = {declared.facts[0].strip('`')}"


# --- findings -------------------------------------------------------------------------------------------


def _add_findings(tree: SourceTree, examined: Examined, files: list[IndexedFile]) -> None:
    """Add what was found to the files that it is in; what is in none stands at the start of the last one."""
    misread = {id(d.span.source) for d in examined.diagnostics if d.code in SYNTAX_CODES}
    notes = [
        version_note(file.source)
        for file in tree.files
        if file.is_root and file.tree.language is None and id(file.source) not in misread
    ]
    if not files:  # the file cannot be read
        return
    by_source = {id(file.source): i for i, file in enumerate(tree.files)}
    paths = {id(file.source): file.key for file in tree.files}
    for diagnostic in in_order((*examined.diagnostics, *notes)):
        number = by_source.get(id(diagnostic.span.source))
        if number is None:
            number = len(files) - 1
        fixes = fixes_of(diagnostic, tree.files[number].tree)
        files[number].findings.append(finding_of(diagnostic, paths, fixes))


def finding_of(
    diagnostic: Diagnostic, paths: Mapping[int, str], fixes: tuple[QuickFix, ...] = ()
) -> EditorFinding:
    """Return a diagnostic as data; `paths` are those of sources, by their identity."""
    is_known = id(diagnostic.span.source) in paths
    start, end = (diagnostic.span.start, diagnostic.span.end) if is_known else (0, 0)
    labels = tuple(
        FindingLabel(path, label.span.start, label.span.end, label.text)
        for label in diagnostic.labels
        if (path := paths.get(id(label.span.source))) is not None
    )
    hint = f"\nhint: {diagnostic.hint}" if diagnostic.hint else ""
    message = f"{diagnostic.message}{hint}"
    return EditorFinding(start, end, diagnostic.severity, diagnostic.code, message, labels, fixes)


def fixes_of(diagnostic: Diagnostic, file: ast.File) -> tuple[QuickFix, ...]:
    """Return the changes that mend a finding: those that its hint names, and declarations that lack."""
    start = file.declarations[0].start if file.declarations else 0
    if diagnostic.code == UNVERSIONED:
        return (QuickFix(f"write `{VERSION_LINE}`", (TextChange(start, start, f"{VERSION_LINE}\n\n"),)),)
    if diagnostic.code == "E301" and diagnostic.span.source.text.strip():
        return (QuickFix("write `import robot`", (TextChange(start, start, "import robot\n\n"),)),)
    hint = diagnostic.hint
    if not isinstance(hint, Remedy):
        return ()
    place = _found(diagnostic.span.source, hint.found, diagnostic.span.start, diagnostic.span.end)
    if place is None:
        return ()
    text, (first, last) = diagnostic.span.source.text, place
    before = " " if _joins(text[first - 1 : first], hint.written[0][:1]) else ""
    after = " " if _joins(hint.written[0][-1:], text[last : last + 1]) else ""
    return tuple(
        QuickFix(f"write `{new}`", (TextChange(first, last, f"{before}{new}{after}"),))
        for new in hint.written
    )


def _joins(left: str, right: str) -> bool:
    """Return True if two characters would be one word."""
    return bool(re.fullmatch(r"\w\w", left + right))


def _found(source: Source, text: str, start: int, end: int) -> tuple[int, int] | None:
    """Return where a text stands last in a span, or else first in the file, as whole words."""
    if not text:
        return start, start
    left, right = (r"\b" if edge.isalnum() or edge == "_" else "" for edge in (text[0], text[-1]))
    pattern = re.compile(left + re.escape(text) + right)
    inside = [*pattern.finditer(source.text, start, max(end, start + len(text)))]
    match = inside[-1] if inside else pattern.search(source.text)
    return None if match is None else match.span()
