"""The correspondence between the modules of two programs, as reports show it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from colony.dsl import ast
from colony.dsl.parse import parse
from colony.ir.program import Actuator, Program, Sensor
from colony.text.diagnostics import Diagnostic, DiagnosticError, error
from colony.text.source import NOWHERE, Span
from colony.text.wording import did_you_mean, duration_text, one_line
from colony.verify.difference.content import contents
from colony.verify.difference.results import Matching

# --- compatible ---------------------------------------------------------------------------------------
#
# Compatibility of two behaviors, and the parts of them that are compared.


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """An actuator of A and one of B to compare, in the fields at `field_indices`."""

    a: Actuator
    b: Actuator
    field_indices: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class IgnoredParts:
    """The parts to ignore: whole actuators, fields, and frames in which one of `modules` wins."""

    actuators: frozenset[str] = frozenset()
    fields: frozenset[tuple[str, str]] = frozenset()
    modules: frozenset[str] = field(default=frozenset())


def find_ignored_parts(a: Program, b: Program, names: Iterable[str]) -> IgnoredParts:
    """Return the parts that `names` refer to in either program: an actuator, `actuator.field`, or a module.

    Raises:
        DiagnosticError: V040: neither program has one of the names.
    """
    actuators = {x.name for p in (a, b) for x in p.robot.actuators}
    fields = {(x.name, f.name) for p in (a, b) for x in p.robot.actuators for f in x.fields}
    modules = {m.name for p in (a, b) for m in p.modules if m.actuator is not None}
    ignored_actuators, ignored_modules = set[str](), set[str]()
    ignored_fields: set[tuple[str, str]] = set()
    for name in names:
        actuator, _, field_name = name.rpartition(".")
        if name in actuators:
            ignored_actuators.add(name)
        elif (actuator, field_name) in fields:
            ignored_fields.add((actuator, field_name))
        elif name in modules:
            ignored_modules.add(name)
        else:
            known = [*sorted(actuators), *(f"{x}.{y}" for x, y in sorted(fields)), *sorted(modules)]
            raise DiagnosticError([_unknown(name, known, "actuator, field or module", a)])
    return IgnoredParts(
        actuators=frozenset(ignored_actuators),
        fields=frozenset(ignored_fields),
        modules=frozenset(ignored_modules),
    )


def _unknown(name: str, known: Sequence[str], kind: str, program: Program) -> Diagnostic:
    hint = did_you_mean(name, known) or f"known names: {', '.join(known) or 'none'}"
    message = f"neither behavior has the {kind} `{name}`"
    return error("V040", program.robot.span, message, hint)


def pairs(
    a: Program, b: Program, ignored_parts: IgnoredParts, chosen_names: Sequence[tuple[str, str]] = ()
) -> tuple[Pair, ...]:
    """Return the actuators to compare: those of equal names, or `chosen_names` (A's name, B's name).

    Raises:
        DiagnosticError: V040: a name is unknown; V041: the actuators have different commands; V042: nothing
            is left to compare.
    """
    actuators_a = {x.name: x for x in a.robot.actuators}
    actuators_b = {x.name: x for x in b.robot.actuators}
    for name_a, name_b in chosen_names:
        for name, known, program in ((name_a, actuators_a, a), (name_b, actuators_b, b)):
            if name not in known:
                raise DiagnosticError([_unknown(name, list(known), "actuator", program)])
    names = chosen_names or [(name, name) for name in actuators_a if name in actuators_b]
    found, diagnostics = [], list[Diagnostic]()
    for name_a, name_b in names:
        if ignored_parts.actuators & {name_a, name_b}:
            continue
        mismatch = (
            [] if chosen_names else list(_command_differences(actuators_a[name_a], actuators_b[name_b]))
        )
        mismatch += _field_differences(actuators_a[name_a], actuators_b[name_b])
        diagnostics += mismatch
        if not mismatch:
            found.append(_pair(actuators_a[name_a], actuators_b[name_b], ignored_parts))
    if diagnostics:
        raise DiagnosticError(diagnostics)
    if not any(pair.field_indices for pair in found):
        hint = "name pairs with `--actuator A=B`" if not names else "ignore less"
        message = "there is nothing to compare: the behaviors share no actuator that is not ignored"
        raise DiagnosticError([error("V042", b.robot.span, message, hint)])
    return tuple(found)


def _pair(a: Actuator, b: Actuator, ignored_parts: IgnoredParts) -> Pair:
    field_indices = tuple(
        i
        for i, f in enumerate(a.fields)
        if (a.name, f.name) not in ignored_parts.fields and (b.name, f.name) not in ignored_parts.fields
    )
    return Pair(a=a, b=b, field_indices=field_indices)


def _command_differences(a: Actuator, b: Actuator) -> Iterator[Diagnostic]:
    if (a.server, a.command) != (b.server, b.command):
        found, expected = f"{b.server}.{b.command}", f"{a.server}.{a.command}"
        yield _differs(f"actuator `{b.name}` commands `{found}`", f"`{expected}`", b.span, a.span)


def _field_differences(a: Actuator, b: Actuator) -> Iterator[Diagnostic]:
    """Yield the differences between the fields; ranges may differ, as they belong to the behavior."""
    found = [(f.name, str(f.type), f.unit) for f in b.fields]
    expected = [(f.name, str(f.type), f.unit) for f in a.fields]
    if found != expected:
        shown = ("`" + ", ".join(f"{n} : {u or t}" for n, t, u in some) + "`" for some in (found, expected))
        shown_found, shown_expected = shown
        yield _differs(f"actuator `{b.name}` has the fields {shown_found}", shown_expected, b.span, a.span)


def _differs(what: str, expected: str, span: Span, other: Span) -> Diagnostic:
    return error("V041", span, f"{what}, expected {expected}, as at {_location(other)}", _SAME_ROBOT_HINT)


_SAME_ROBOT_HINT = "behaviors are compared for one robot: declare it in a file that both import"


def check_sensors(a: Program, b: Program) -> None:
    """Check that sensors with the same name are equal, and that one source has one name.

    Raises:
        DiagnosticError: V041 for each sensor that differs, at its declaration in B.
    """
    sensors_a = {s.name: s for s in a.robot.sensors}
    sources = {(s.server, s.field): s for s in a.robot.sensors}
    names_b = {s.name for s in b.robot.sensors}
    diagnostics: list[Diagnostic] = []
    for sensor in b.robot.sensors:
        other = sensors_a.get(sensor.name)
        same_source = sources.get((sensor.server, sensor.field))
        if other is not None:
            diagnostics += _sensor_differences(other, sensor)
        elif same_source is not None and same_source.name not in names_b:
            what = f"sensor `{sensor.name}` reads `{sensor.server}.{sensor.field}`"
            diagnostics.append(
                _differs(what, f"the name `{same_source.name}` for that", sensor.span, same_source.span)
            )
    if diagnostics:
        raise DiagnosticError(diagnostics)


def _sensor_differences(a: Sensor, b: Sensor) -> Iterator[Diagnostic]:
    for (what, expected), (_, found) in zip(_properties(a), _properties(b), strict=True):
        if found != expected:
            yield _differs(f"sensor `{b.name}` has the {what} {found}", expected, b.span, a.span)
            return


def _properties(sensor: Sensor) -> tuple[tuple[str, str], ...]:
    """Return the properties that sensors with the same name must share, as (property, text)."""
    bounds = [
        "none" if x is None else f"{x / sensor.factor:.9g}{f' {sensor.unit}' if sensor.unit else ''}"
        for x in (sensor.low, sensor.high)
    ]
    return (
        ("type", f"`{_type(sensor)}`"),
        ("range", "none" if bounds == ["none", "none"] else f"{bounds[0]} .. {bounds[1]}"),
        ("default", "none" if sensor.default is None else f"{sensor.default!r}"),
        ("source", f"`{sensor.server}.{sensor.field}`"),
        ("age limit", "none" if sensor.within_ns is None else duration_text(sensor.within_ns)),
    )


def _type(sensor: Sensor) -> str:
    kind = str(sensor.type)
    return f"{kind} in {sensor.unit}" if sensor.unit and sensor.unit != kind else kind


def _location(span: Span) -> str:
    return "the other behavior" if span is NOWHERE else span.place


# --- declarations -------------------------------------------------------------------------------------
#
# Descriptions of params, derived values and limits that are written differently in two programs.

_KINDS = {ast.ParamDecl: "param", ast.LetDecl: "let", ast.StateDecl: "state"}


def changed_declarations(a: Program, b: Program) -> tuple[str, ...]:
    """Return a phrase for each value whose text differs, and for each limit that only one program has.

    Files correspond by name; the two main files correspond to each other.
    """
    texts_a, texts_b = dict(_values(a)), dict(_values(b))
    values = (
        f"{kind} `{name}`: `{text}` in A, `{texts_b[kind, name]}` in B"
        for (kind, name), text in texts_a.items()
        if texts_b.get((kind, name), text) != text
    )
    limits_a, limits_b = Counter(_limits(a)), Counter(_limits(b))
    return (
        *values,
        *(f"`{text}` of A" for text in (limits_a - limits_b).elements()),
        *(f"`{text}` of B" for text in (limits_b - limits_a).elements()),
    )


def _values(program: Program) -> Iterator[tuple[tuple[str, str], str]]:
    """Yield ((kind, qualified name), text) of each value."""
    for file, text, declaration in _declarations(program):
        if isinstance(declaration, ast.ModuleDecl):
            module_prefix = f"{file}{declaration.name.text}."
            for clause in declaration.clauses:
                yield from _value(module_prefix, text, clause)
        yield from _value(file, text, declaration)


def _value(prefix: str, text: str, node: object) -> Iterator[tuple[tuple[str, str], str]]:
    match node:
        case ast.ParamDecl(interval=ast.RangeNode()):
            yield (_KINDS[type(node)], prefix + node.name.text), _text_of(text, node)
        case ast.ParamDecl() | ast.LetDecl():
            yield (_KINDS[type(node)], prefix + node.name.text), _text_of(text, node.value)
        case ast.StateDecl():
            yield (_KINDS[type(node)], prefix + node.name.text), _text_of(text, node)
        case _:
            return


def _limits(program: Program) -> Iterator[str]:
    for _, text, declaration in _declarations(program):
        if isinstance(declaration, ast.LimitDecl):
            yield _text_of(text, declaration)


def _declarations(program: Program) -> Iterator[tuple[str, str, ast.Declaration]]:
    """Yield the prefix of the file's names, the file's text, and each declaration."""
    for i, (path, source) in enumerate(program.files):
        is_root = i == len(program.files) - 1
        prefix = "" if is_root else path.rpartition("/")[2].removesuffix("colony")
        for declaration in parse(source).file.declarations:
            yield prefix, source.text, declaration


def _text_of(text: str, node: ast.SyntaxNode) -> str:
    return one_line(text[node.start : node.end])


# --- matching -----------------------------------------------------------------------------------------


def matching(a: Program, b: Program, compared: Sequence[Pair]) -> Matching:
    """Return the pairs of modules with equal contents, equal names first, and the modules without a match."""
    names_a, names_b = _contents(a, b)
    unmatched_b = dict(names_b)
    same: dict[str, str] = {}
    for by_name in (True, False):
        for name, content in names_a.items():
            if name in same:
                continue
            candidates = [n for n, c in unmatched_b.items() if c == content and (n == name or not by_name)]
            if candidates:
                same[name] = candidates[0]
                del unmatched_b[candidates[0]]
    changed = tuple(n for n in names_a if n not in same and n in unmatched_b)
    return Matching(
        same=tuple((n, same[n]) for n in names_a if n in same),
        changed=changed,
        only_a=tuple(n for n in names_a if n not in same and n not in changed),
        only_b=tuple(n for n in unmatched_b if n not in changed),
        declarations=changed_declarations(a, b),
        notes=tuple(_notes(a, b, compared)),
    )


def _contents(a: Program, b: Program) -> tuple[dict[str, tuple[str, int]], dict[str, tuple[str, int]]]:
    """Return the content of each module and the actuator that it commands."""
    of_a, of_b = contents(a, b)
    return (
        {m.name: (m.actuator or "", of_a.module(m)) for m in a.modules},
        {m.name: (m.actuator or "", of_b.module(m)) for m in b.modules},
    )


def _notes(a: Program, b: Program, compared: Sequence[Pair]) -> Iterator[str]:
    """Yield notes on what was not compared."""
    compared_a, compared_b = {p.a.name for p in compared}, {p.b.name for p in compared}
    for title, program, other, compared_names in (("A", a, b, compared_a), ("B", b, a, compared_b)):
        other_names = {x.name for x in other.robot.actuators}
        for actuator in program.robot.actuators:
            if actuator.name not in compared_names and actuator.name not in other_names:
                yield f"only {title} has the actuator `{actuator.name}`: it is not compared"
    if a.robot.frame_ns != b.robot.frame_ns:
        periods = f"{duration_text(a.robot.frame_ns)} in A and {duration_text(b.robot.frame_ns)} in B"
        yield f"the frame period is {periods}: they are compared on the same frames"
