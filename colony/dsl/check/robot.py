"""Checking of the robot (sensors, actuators, the frame period) and of type names."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

from colony.dsl import ast
from colony.dsl.check.arrays import check_bearings
from colony.dsl.check.checker import Checker, reject_private_name, type_hint
from colony.dsl.check.compatibility import fits, plural, unit_of, with_article
from colony.dsl.check.scope import (
    ActuatorSymbol,
    BrokenSymbol,
    CheckReport,
    EnumSymbol,
    FileScope,
    RobotScope,
    SensorSymbol,
    TypedParameter,
)
from colony.ir import program as ir
from colony.ir.servers import DSERVER
from colony.ir.types import (
    BOOL,
    DIMENSIONLESS,
    MAX_ELEMENTS,
    Array,
    Enum,
    Quantity,
    Scalar,
    ScalarValue,
    Type,
    in_unit,
    is_rate,
)
from colony.text.units import UnitError

# Keys that recordings and traces use besides the names of sensors, actuators and fields:
RESERVED_SENSORS = {"t": "the frame's time"}
RESERVED_ACTUATORS = {**RESERVED_SENSORS, "breaches": "the broken contracts"}
RESERVED_FIELDS = {"fault": "the fault of a command", "fates": "the fates of clients"}  # `by` is a keyword


def check_type(checker: Checker, node: ast.TypeName) -> tuple[Scalar, str] | None:
    """Return the type of a type name, and the declared unit of its values, if any."""
    name = ".".join(node.path)
    if node.path == ("bool",):
        return BOOL, ""
    if node.path == ("number",):
        return DIMENSIONLESS, ""
    try:
        unit = unit_of(name)
        return in_unit(unit), unit.text
    except UnitError as problem:
        unit_error_text = str(problem)
    scope, path = checker.scope.resolve(node.path)
    symbol = scope.value(path[0]) if len(path) == 1 else None
    if isinstance(symbol, EnumSymbol):
        return symbol.type, ""
    if isinstance(symbol, BrokenSymbol):
        return None
    if not all(part.isidentifier() for part in node.path):
        checker.error("E011", node, unit_error_text)
    elif not reject_private_name(checker, node, scope, path[0]):
        enums = [n for n in scope.visible_values if isinstance(scope.value(n), EnumSymbol)]
        known_names = [*enums, "bool", "number", "mm", "deg", "mm/s", "deg/s"]
        hint = checker.report.suggest(name, known_names) or "a type is `bool`, `number`, a unit or an enum"
        checker.error("E101", node, f"unknown type `{name}`", hint)
    return None


def check_robot(checker: Checker, node: ast.RobotDecl) -> ir.Robot:
    """Check the robot and fill in the scope that all files share; invalid items are left out."""
    robot = checker.scope.robot
    sensors: list[ir.Sensor] = []
    actuators: list[ir.Actuator] = []
    periods: list[_Period] = []
    names: dict[str, ast.NameNode] = {}
    for item in node.items:
        if isinstance(item, ast.FrameDecl):
            _frame(checker, item, periods)
            continue
        if item.name.text in names:
            message = f"`{item.name.text}` is declared twice"
            checker.error("E102", item.name, message, None, checker.label(names[item.name.text]))
            continue
        names[item.name.text] = item.name
        if isinstance(item, ast.SensorDecl):
            sensor = _sensor(checker, item)
            robot.values[item.name.text] = SensorSymbol(sensor=sensor) if sensor else BrokenSymbol()
            sensors += [sensor] if sensor else []
        else:
            actuator = _actuator(checker, item)
            robot.network_symbols[item.name.text] = (
                ActuatorSymbol(actuator=actuator) if actuator else BrokenSymbol()
            )
            actuators += [actuator] if actuator else []
    period = periods[0] if periods else _Period(ir.DEFAULT_FRAME_NS)
    robot.frame_ns = period.frame_ns
    return ir.Robot(
        name=node.name.text,
        span=checker.span(node.name),
        frame_ns=period.frame_ns,
        jitter_ns=period.jitter_ns,
        sensors=tuple(sensors),
        actuators=tuple(actuators),
    )


def literal_frame_period(checker: Checker, node: ast.RobotDecl) -> int | None:
    """Return the frame period, so that params may read it; None if it reads names itself."""
    bare = replace(
        checker, scope=FileScope(file=checker.scope.file, robot=RobotScope()), report=CheckReport()
    )
    frames = [item for item in node.items if isinstance(item, ast.FrameDecl)]
    return bare.duration_ns(frames[0].period, "the frame period") if frames else ir.DEFAULT_FRAME_NS


class _Period(NamedTuple):
    """The frame period and how much it may vary, in nanoseconds."""

    frame_ns: int
    jitter_ns: int | None = None


def _frame(checker: Checker, item: ast.FrameDecl, periods: list[_Period]) -> None:
    jitter = None if item.jitter is None else checker.duration_ns(item.jitter, "the jitter")
    period = checker.duration_ns(item.period, "the frame period")
    if period == 0:
        checker.error("E309", item, "the frame period must be longer than 0", "for example `frame 50 ms`")
    elif period is not None and periods:
        checker.error("E309", item, "the frame period is given twice")
    elif period is not None and jitter is not None and jitter >= period:
        checker.error("E309", item, "the jitter must be shorter than the frame period")
    elif period is not None:
        periods.append(_Period(period, jitter))


def _range(
    checker: Checker, node: ast.RangeNode | None, type_: Scalar, unit: str
) -> tuple[float | None, float | None]:
    """Return the bounds of a range in base units."""
    if node is None:
        return None, None
    if not isinstance(type_, Quantity):
        checker.error("E303", node, f"a range bounds numbers; this is {with_article(type_)}")
        return None, None
    low = checker.constant_in(node.low, type_, unit, "the lower bound of a range")
    high = checker.constant_in(node.high, type_, unit, "the upper bound of a range")
    if low is not None and high is not None and low > high:
        checker.error(
            "E303", node, "the range is empty: its lower bound is above its upper bound", "swap the bounds"
        )
        return None, None
    return low, high


def _default(
    checker: Checker,
    node: ast.Expression | None,
    type_: Scalar,
    unit: str,
    low: float | None,
    high: float | None,
) -> ScalarValue | None:
    """Return a default in base units; report one that is outside the range."""
    if node is None:
        return None
    default = checker.constant_in(node, type_, unit, "the default")
    outside = (low is not None and (default or 0) < low) or (high is not None and (default or 0) > high)
    if default is not None and outside:
        checker.error("E304", node, "the default is outside the range")
    return default


def _factor(unit: str) -> float:
    return float(unit_of(unit).factor) if unit else 1.0


def check_input(checker: Checker, node: ast.SensorDecl) -> ir.Sensor | None:
    """Check an input of the program: a sensor that reads a variable of DServer."""
    if node.server.text != DSERVER.name:
        message = f"an input of a program reads a variable of {DSERVER.name}, found `{node.server.text}`"
        checker.error(
            "E312", node.server, message, "the robot's interface declares the sensors of other servers"
        )
        return None
    sensor = _sensor(checker, node)
    return None if sensor is None else replace(sensor, name=checker.scope.full_name(sensor.name), own=True)


def _sensor(checker: Checker, item: ast.SensorDecl) -> ir.Sensor | None:
    reject_reserved(checker, item.name, RESERVED_SENSORS, "sensor")
    found = check_type(checker, item.type)
    size = None
    if item.size is not None:
        size = checker.whole(item.size, "the size of an array", 1, MAX_ELEMENTS)
    within = None
    if item.within is not None:
        within = checker.duration_ns(item.within, "`within`")
    bearings = None
    if item.bearing is not None and (size is not None or item.size is None):
        bearings = check_bearings(checker, item.bearing, size)
    if found is None or (item.size is not None and size is None):
        return None
    element, unit = found
    low, high = _range(checker, item.range, element, unit)
    return ir.Sensor(
        name=item.name.text,
        span=checker.span(item.name),
        type=element if size is None else Array(element, size, bearings),
        unit=unit,
        factor=_factor(unit),
        low=low,
        high=high,
        default=_default(checker, item.default, element, unit, low, high),
        server=item.server.text,
        field=item.field.text,
        within_ns=within,
    )


def reject_reserved(checker: Checker, name: ast.NameNode, reserved: dict[str, str], kind: str) -> None:
    """Report a name that has another meaning in recordings."""
    if name.text in reserved:
        message = f"`{name.text}` is {reserved[name.text]} in recordings, so no {kind} can have this name"
        checker.error("E307", name, message, "choose another name")


def _actuator(checker: Checker, item: ast.ActuatorDecl) -> ir.Actuator | None:
    reject_reserved(checker, item.name, RESERVED_ACTUATORS, "actuator")
    fields: list[ir.ActuatorField] = []
    units: dict[str, str] = {}
    complete = True
    for field in item.fields:
        found = check_type(checker, field.type)
        reject_reserved(checker, field.name, RESERVED_FIELDS, "field")
        if field.name.text in units:
            checker.error("E102", field.name, f"field `{field.name.text}` is declared twice")
            continue
        units[field.name.text] = found[1] if found else ""
        if found is None:
            complete = False
            continue
        low, high = _range(checker, field.range, *found)
        default = _default(checker, field.default, *found, low, high)
        complete &= field.default is None or default is not None
        fields.append(
            ir.ActuatorField(
                name=field.name.text,
                span=checker.span(field.name),
                type=found[0],
                unit=found[1],
                factor=_factor(found[1]),
                low=low,
                high=high,
                default=default,
            )
        )
    if not complete:
        return None
    hold, idle = _idle(checker, item, fields)
    if idle is None and not hold:
        return None
    return ir.Actuator(
        name=item.name.text,
        span=checker.span(item.name),
        fields=tuple(fields),
        server=item.server.text,
        command=item.command.text,
        idle=idle,
        on_loss=item.on_loss or "stop",
    )


def _idle(
    checker: Checker, item: ast.ActuatorDecl, fields: list[ir.ActuatorField]
) -> tuple[bool, tuple[ScalarValue, ...] | None]:
    """Return True for `idle hold`, and otherwise the values of the idle command."""
    node, name = item.idle, item.name.text
    if node.arguments is None:
        may_hold = item.server.text != "RServer" and not any(is_rate(field.type) for field in fields)
        safe = ", ".join(f"{f.name} = {'0' if is_rate(f.type) else '...'}" for f in fields)
        if node.name.text != "hold":
            hint = f"write `idle {name}({safe})`" + (" or `idle hold`" if may_hold else "")
            checker.error("E306", node, f"found `{node.name.text}`, expected a command of `{name}`", hint)
        elif not may_hold:
            checker.error(
                "E305",
                node,
                "an actuator with a speed or rate, or of RServer, needs an idle command, not `hold`",
                f"give a command that is safe: `idle {name}({safe})`",
            )
        return True, None
    if node.name.text != name:
        checker.error(
            "E306", node, f"found `{node.name.text}`, expected `{name}`, whose idle command this is"
        )
    values = command_arguments(checker, node, node.arguments, [f.name for f in fields], name)
    idle: list[ScalarValue] = []
    for field in fields:
        argument = values.get(field.name)
        if argument is None:
            continue
        constant = checker.constant(argument.value, field.type, f"field `{field.name}`")
        if constant is None:
            continue
        value: ScalarValue = constant.value  # type: ignore[assignment]
        if (field.low is not None and value < field.low) or (field.high is not None and value > field.high):
            checker.error("E306", argument, f"the idle command is outside the range of `{field.name}`")
        idle.append(value)
    return False, tuple(idle) if len(idle) == len(fields) else None


def command_arguments(
    checker: Checker,
    node: ast.SyntaxNode,
    arguments: tuple[ast.Argument, ...],
    fields: list[str],
    actuator: str,
    optional: Collection[str] = (),
) -> dict[str, ast.Argument]:
    """Return the arguments by field; report unknown, repeated and missing fields, except `optional` ones."""
    values: dict[str, ast.Argument] = {}
    for argument in arguments:
        name = argument.name.text
        if name not in fields:
            hint = checker.report.suggest(name, fields) or f"it has {', '.join(fields)}"
            checker.error("E401", argument.name, f"`{actuator}` has no field `{name}`", hint)
        elif name in values:
            checker.error("E401", argument.name, f"field `{name}` is given twice")
        else:
            values[name] = argument
    left_out = [name for name in fields if name not in values and name not in optional]
    misspelled = sum(argument.name.text not in fields for argument in arguments)
    if len(left_out) > misspelled:
        shown = ", ".join(f"`{name}`" for name in left_out)
        checker.error("E401", node, f"the command does not give {shown} of `{actuator}`")
    return values


def check_enum(checker: Checker, node: ast.EnumDecl) -> Enum | None:
    """Check an enum and return its type."""
    members: dict[str, float] = {}
    for member in node.members:
        name = member.name.text
        value = checker.constant(member.value, DIMENSIONLESS, f"the number of `{name}`")
        if name in members:
            checker.error("E102", member.name, f"`{name}` is declared twice")
        elif value is not None and value.value in members.values():
            other = next(n for n, v in members.items() if v == value.value)
            checker.error("E310", member, f"`{name}` has the number of `{other}`", "numbers must differ")
        elif value is not None:
            members[name] = float(value.value)  # type: ignore[arg-type]
    if not members:
        return None
    return Enum(name=checker.scope.full_name(node.name.text), members=tuple(members.items()))


# --- parameters ---------------------------------------------------------------------------------------
#
# Parameters of functions, and inputs of modules: their types, and what can be given to them.


def check_parameter(checker: Checker, node: ast.ParameterNode) -> TypedParameter | None:
    """Check the type of a parameter or input; its default is left out."""
    found = check_type(checker, node.type)
    size: int | None = None
    if node.size is not None:
        size = checker.whole(node.size, "the size of an array", 1, MAX_ELEMENTS)
        if size is None:
            return None
    if found is None:
        return None
    element, unit = found
    return TypedParameter(name=node.name.text, element=element, unit=unit, is_array=node.is_array, size=size)


def takes(parameter: TypedParameter, found: Type) -> bool:
    """Return True if a value of this type can be given to a parameter."""
    expected = parameter.type
    if expected is None:
        return isinstance(found, Array) and fits(found.element, parameter.element)
    return fits(found, expected)


def argument_hint(node: ast.Expression, parameter: TypedParameter, found: Type) -> str | None:
    """Return a hint for a value that a parameter does not take, if there is one."""
    if not parameter.is_array:
        return type_hint(node, found, parameter.element)
    return type_hint(node, found.element, parameter.element) if isinstance(found, Array) else None


def what_it_takes(parameter: TypedParameter) -> str:
    """Return the type of a parameter with its article, for messages."""
    if parameter.type is None:
        return f"an array of {plural(parameter.element)}"
    return with_article(parameter.type)
