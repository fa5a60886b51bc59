"""Statements that decide what is sent to an actuator once its winner is known.

A command that is finite and within limits and range, provably or by a check, is sent unchanged; any other is
passed to `settle`.
"""

from __future__ import annotations

from math import isfinite

from colony.compile.backends.python.expressions import ExpressionTexts
from colony.compile.backends.python.plan import ActuatorPlan
from colony.compile.backends.python.text import NumberRange, Precedence, UniqueNames, literal
from colony.execute.code import LimitCode
from colony.execute.intake import members, stand_in
from colony.ir.program import ActuatorField, Sensor, in_declared_units
from colony.ir.types import Array, Bool, ScalarValue, Value, element_type

# --- sensor validation --------------------------------------------------------------------------------
#
# Statements that validate a sensor's reading: inline tests for usual readings, a function call for others.
#
# A reading is usual if it is present, of exactly the declared type (a float, not an int), and within range.


def constants(sensors: tuple[Sensor, ...]) -> list[str]:
    """Return the constants that the inline tests use, as statements of the generated Python module."""
    array_types = set()
    for sensor in sensors:
        if isinstance(sensor.type, Array):
            kind = "bool" if isinstance(sensor.type.element, Bool) else "float"
            array_types.add((kind, sensor.type.size))
    return [f"{_types(kind, size)} = [{kind}] * {size}" for kind, size in sorted(array_types)]


def _types(kind: str, size: int) -> str:
    return f"{kind.upper()}S_{size}"


def validation_statements(sensor: Sensor, names: UniqueNames) -> list[str]:
    """Return the statements that set a sensor's value (or stand-in) and its freshness.

    Without a reading of what an actuator was given last, it is what the program itself sent.
    """
    otherwise = f", self.{names.last[sensor.name]}" if sensor.sent is not None else ""
    value, fresh = names.sensors[sensor.name], names.fresh[sensor.name]
    converted = sensor.factor != 1.0 and not isinstance(element_type(sensor.type), Bool)
    reading = "reading" if converted else value
    inline_tests = _array_tests if isinstance(sensor.type, Array) else _scalar_tests
    return [
        f"{reading} = readings.get({sensor.name!r}{otherwise})",
        *_if(inline_tests(sensor, reading, value)),
        f"    {fresh} = True",
        "else:",
        f"    {value}, {fresh}, records = {_validation_call(sensor, reading)}",
    ]


def _if(tests: list[str]) -> list[str]:
    """Return an `if` for all tests, on one line if it is short."""
    line = f"if {' and '.join(tests)}:"
    if len(line) <= 96:
        return [line]
    return ["if (", f"    {tests[0]}", *[f"    and {test}" for test in tests[1:]], "):"]


def _scalar_tests(sensor: Sensor, reading: str, value: str) -> list[str]:
    """Return the inline tests of a scalar; they also convert it where necessary."""
    if isinstance(sensor.type, Bool):
        return [f"{reading} is True or {reading} is False"]
    tests, numbers = [f"type({reading}) is float"], members(sensor)
    if reading != value:
        tests.append(f"({value} := {reading} * {literal(sensor.factor).text}) == {value}")
    if numbers is not None:
        return [*tests, f"{value} in {_listed(numbers)}"]
    if sensor.low is not None and sensor.high is not None:
        return [*tests, f"{literal(sensor.low).text} <= {value} <= {literal(sensor.high).text}"]
    range_test = _in_range(sensor, value)
    return (
        [*tests, range_test] if range_test else [*tests, f"{value} == {value}"] if len(tests) == 1 else tests
    )


def _array_tests(sensor: Sensor, reading: str, value: str) -> list[str]:
    """Return the inline tests of an array; they also convert it where necessary."""
    assert isinstance(sensor.type, Array)
    kind, numbers = sensor.type.element, members(sensor)
    name = "bool" if isinstance(kind, Bool) else "float"
    tests = [
        f"(type({reading}) is list or type({reading}) is tuple)",
        f"[*map(type, {reading})] == {_types(name, sensor.type.size)}",
    ]
    if isinstance(kind, Bool):
        return tests
    if reading != value:
        tests.append(f"({value} := [x * {literal(sensor.factor).text} for x in {reading}])")
    if numbers is not None:
        return [*tests, f"not [x for x in {value} if x not in {_listed(numbers)}]"]
    range_test = _in_range(sensor, "x")
    return [
        *tests,
        f"not [x for x in {value} if not ({range_test})]" if range_test else f"sum({value}) <= inf",
    ]


def _in_range(sensor: Sensor, x: str) -> str:
    """Return a test of the range, which NaN fails; an empty string if there is no range."""
    tests = [f"{literal(sensor.low).text} <= {x}"] if sensor.low is not None else []
    tests += [f"{x} <= {literal(sensor.high).text}"] if sensor.high is not None else []
    return " and ".join(tests)


def _validation_call(sensor: Sensor, reading: str) -> str:
    """Return a call of the function that validates any reading."""
    kind, array = element_type(sensor.type), isinstance(sensor.type, Array)
    arguments = [repr(sensor.name), reading]
    if isinstance(sensor.type, Array):
        arguments.append(str(sensor.type.size))
    if not isinstance(kind, Bool):
        numbers = members(sensor)
        arguments += [literal(sensor.factor).text, _optional(sensor.low), _optional(sensor.high)]
        arguments.append("None" if numbers is None else _listed(numbers))
    function = "take_bool" if isinstance(kind, Bool) else "take_number"
    return f"{function}{'s' if array else ''}({', '.join(arguments)}, {values(stand_in(sensor))}, records)"


def values(value: Value) -> str:
    """Return a value as a constant; an array of equal elements as `(x,) * n`."""
    if not isinstance(value, tuple):
        return literal(value).text
    if len(value) > 4 and all(_same(x, value[0]) for x in value):
        return f"({literal(value[0]).text},) * {len(value)}"
    return _listed(value)


def _same(x: ScalarValue, y: ScalarValue) -> bool:
    return repr(x) == repr(y)


def _listed(elements: tuple[ScalarValue, ...]) -> str:
    return f"({', '.join(literal(x).text for x in elements)}{',' if len(elements) == 1 else ''})"


def _optional(bound: float | None) -> str:
    return "None" if bound is None else literal(bound).text


# --- decision -----------------------------------------------------------------------------------------


class DecisionText:
    """The statements for one actuator. With `observed`, they keep what is sent for contracts to read."""

    def __init__(
        self,
        plan: ActuatorPlan,
        names: UniqueNames,
        expressions: ExpressionTexts,
        ranges: list[NumberRange],
        observed: bool,
    ) -> None:
        self.plan = plan
        self.actuator = plan.actuator.actuator
        self.names = names
        self.expressions = expressions
        self.ranges = ranges
        self.observed = observed
        self.name = self.actuator.name
        self.by = names.by[self.name]
        self.fields = [names.field[self.name, i] for i in range(len(self.actuator.fields))]
        self.target = names.decision[self.name]

    def lines(self) -> list[str]:
        """Return the statements that decide what is sent to the actuator."""
        if not self.plan.groups:
            return self.idle(by=self.observed)
        lines = [f"if {self.by} is None:", *_indented(self.idle(by=False))]
        if self.plan.may_be_blind:
            lines += [f"elif {self.names.blind[self.name]}:", *_indented(self.blind())]
        checks = self.checks()
        before = self.expressions.statements.get(self.plan.limits)
        if before:
            return [*lines, "else:", *_indented([*before, *self.command(checks)])]
        first, *rest = self.command(checks)
        if not checks:
            return [*lines, "else:", *_indented([first, *rest])]
        return [*lines, f"el{first}", *rest]

    def blind(self) -> list[str]:
        """Return the idle command, for a winner that is failsafe and blind."""
        record = f"records = (*records, ('missing', {self.by}))"
        return [record, *self.idle_command(self.by, "'missing'")]

    def idle(self, by: bool) -> list[str]:
        """Return the idle command, or nothing for `idle hold`."""
        lines = self.idle_command("None", "None")
        return [lines[0], f"{self.by} = None", *lines[1:]] if by else lines

    def idle_command(self, by: str, fault: str) -> list[str]:
        """Return the statements for the idle command."""
        idle = self.actuator.idle
        declared_values = in_declared_units(idle, self.actuator.fields)
        shown = "None" if declared_values is None else values(declared_values)
        lines = [f"{self.target} = ({self.name!r}, {by}, {shown}, {fault})"]
        if self.observed:
            lines.append(f"{self.names.commanded[self.name]} = False")
            sent = idle or tuple(False if isinstance(f.type, Bool) else 0.0 for f in self.actuator.fields)
            lines += [f"{field} = {literal(x).text}" for field, x in zip(self.fields, sent, strict=True)]
        return lines

    def command(self, checks: list[str]) -> list[str]:
        """Return the statements for the winner's command: as is if the checks hold, else through `settle`."""
        declared_values = self.declared_values(self.fields)
        direct = [f"{self.target} = ({self.name!r}, {self.by}, {declared_values}, None)"]
        if self.observed:
            direct.append(f"{self.names.commanded[self.name]} = True")
        if not checks:
            return direct
        single = checks[0][1:-1] if checks[0].startswith("(") else checks[0]
        condition = " and ".join(checks) if len(checks) > 1 else single
        return [f"if {condition}:", *_indented(direct), "else:", *_indented(self.settled())]

    def declared_values(self, fields: list[str]) -> str:
        """Return a command in declared units."""
        return _tuple(
            [
                field if spec.factor == 1.0 else f"{field} / {literal(spec.factor).text}"
                for field, spec in zip(fields, self.actuator.fields, strict=True)
            ]
        )

    def constants(self) -> list[str]:
        """Return the bounds passed to `settle`, as a module-level statement."""
        bounds = _tuple([_field(f) for f in self.actuator.fields])
        return [f"{self.names.bounds[self.name]} = {bounds}"]

    def settled(self) -> list[str]:
        """Return the statements that call `settle`."""
        limits = " + ".join(self.limit(limit) for limit in self.plan.actuator.limits) or "()"
        idle = "None" if self.actuator.idle is None else values(self.actuator.idle)
        bounds = self.names.bounds[self.name]
        arguments = f"{self.name!r}, {self.by}, {_tuple(self.fields)}, {bounds}, {limits}, {idle}, records"
        declared_values = "settled"
        if any(spec.factor != 1.0 for spec in self.actuator.fields):
            declared_values = self.declared_values([f"settled[{i}]" for i in range(len(self.fields))])
            if self.actuator.idle is None:
                declared_values = f"None if settled is None else {declared_values}"
        lines = [
            f"fault, settled, records = settle({arguments})",
            f"{self.target} = ({self.name!r}, {self.by}, {declared_values}, fault)",
        ]
        if self.observed:
            lines.append(f"{self.names.commanded[self.name]} = fault is None")
        if self.observed and self.fields:
            unpacked = f"{', '.join(self.fields)}{',' if len(self.fields) == 1 else ''} = settled"
            if self.actuator.idle is None:
                lines += ["if settled is not None:", f"    {unpacked}"]
            else:
                lines.append(unpacked)
        return lines

    def limit(self, limit: LimitCode) -> str:
        """Return a limit as `settle` takes it, if it applies."""
        bound, known = self.expressions.text(limit.bound), self.expressions.text(limit.known)
        text = (
            bound.text
            if known.text == "True"
            else f"{bound.inside(Precedence.OR)} if {known.inside(Precedence.OR)} else None"
        )
        limit_tuple = f"(({limit.field_index}, {limit.relation == '<='}, {text}),)"
        applies = self.expressions.text(limit.applies)
        return (
            limit_tuple
            if applies.text == "True"
            else f"({limit_tuple} if {applies.inside(Precedence.OR)} else ())"
        )

    def checks(self) -> list[str]:
        """Return the checks under which a command needs no `settle`, without those that always hold."""
        checks = []
        for limit in self.plan.actuator.limits:
            field = self.fields[limit.field_index]
            check = f"{field} {limit.relation} {self.expressions.text(limit.bound).inside(Precedence.SUM)}"
            known = self.expressions.text(limit.known)
            if known.text != "True":
                check = f"({known.inside(Precedence.AND)} and {check})"
            applies = self.expressions.text(limit.applies)
            exempt = f"not {applies.inside(Precedence.NOT)} or "
            checks.append(check if applies.text == "True" else f"({exempt}{check})")
        for i, spec in enumerate(self.actuator.fields):
            checks += self.field_checks(i, spec)
        return checks

    def field_checks(self, i: int, field: ActuatorField) -> list[str]:
        """Return the checks of a field's value that its known ranges do not make superfluous."""
        if isinstance(field.type, Bool):
            return []
        clients = [c.client for g in self.plan.groups for c in g.clients]
        ranges = [self.ranges[c.fields[i]] for c in clients]
        name, low, high = self.fields[i], field.low, field.high
        bounded = all(r.within(low, high) for r in ranges)
        finite = all(
            r.finite and isfinite(r.low / field.factor) and isfinite(r.high / field.factor) for r in ranges
        )
        checks = []
        if low is not None and high is not None:
            finite = finite or (isfinite(low / field.factor) and isfinite(high / field.factor))
            if not bounded:
                checks.append(f"{literal(low).text} <= {name} <= {literal(high).text}")
        elif not bounded:
            checks.append(f"{literal(low).text} <= {name}" if low is not None else f"{name} <= {_high(high)}")
        if not finite:
            declared_values = name if field.factor == 1.0 else f"{name} / {literal(field.factor).text}"
            checks.append(f"isfinite({declared_values})")
        return checks


def _high(high: float | None) -> str:
    return "inf" if high is None else literal(high).text


def _field(field: ActuatorField) -> str:
    low, high = ("None" if b is None else literal(b).text for b in (field.low, field.high))
    return f"({field.name!r}, {literal(field.factor).text}, {low}, {high})"


def _tuple(parts: list[str]) -> str:
    return f"({', '.join(parts)}{',' if len(parts) == 1 else ''})"


def _indented(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]
