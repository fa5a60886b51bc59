"""Checking of limits, contracts and tests."""

from __future__ import annotations

from dataclasses import replace

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.compatibility import with_article
from colony.dsl.check.references import actuator_named
from colony.dsl.check.reserved import RESTARTED
from colony.dsl.check.scope import BrokenSymbol, SensorSymbol
from colony.dsl.check.sent import sent_field
from colony.ir import program as ir
from colony.ir.expression import Expression
from colony.ir.types import BOOL, Array, Quantity, ScalarValue, element_type

MAX_TEST_FRAMES = 1_000_000


def check_limit(checker: Checker, node: ast.LimitDecl) -> ir.Limit | None:
    """Check a limit on a field of the commands to an actuator."""
    actuator = actuator_named(checker, node.actuator)
    condition: Expression | None = None
    if node.condition is not None:
        condition = checker.expect(node.condition, BOOL, "the condition of a limit")
    if actuator is None:
        checker.check(node.bound)
        return None
    names = [f.name for f in actuator.fields]
    if node.field.text not in names:
        hint = checker.report.suggest(node.field.text, names) or f"it has {', '.join(names)}"
        checker.error("E601", node.field, f"`{actuator.name}` has no field `{node.field.text}`", hint)
        checker.check(node.bound)
        return None
    index = names.index(node.field.text)
    type_ = actuator.fields[index].type
    if not isinstance(type_, Quantity):
        checker.error(
            "E601", node.field, f"a limit bounds numbers; `{node.field.text}` is {with_article(type_)}"
        )
        return None
    bound = checker.expect(node.bound, type_, "the bound")
    if bound is None or (condition is None and node.condition is not None):
        return None
    return ir.Limit(
        actuator=actuator.name,
        field_index=index,
        relation=node.relation,
        bound=bound,
        condition=condition,
        span=checker.span(node),
    )


def check_contract(checker: Checker, node: ast.ContractDecl) -> ir.Contract | None:
    """Check a contract: a condition that must hold in every frame."""
    contract_checker = replace(checker, in_contract_or_test=True)
    found = contract_checker.expect(node.expression, BOOL, "a contract")
    if found is None:
        return None
    name = checker.scope.full_name(node.name.text)
    return ir.Contract(name=name, expression=found, span=checker.span(node.name))


def check_test(checker: Checker, node: ast.TestDecl) -> ir.Example | None:
    """Check a test; its times must strictly increase."""
    steps: list[ir.Step] = []
    last_ns = -1
    frames = 0
    for step in node.steps:
        times = _times(checker, step)
        restarts = [g for g in step.given if g.sensor.text == RESTARTED]
        restarted = [_given_restarted(checker, g, is_first=step is node.steps[0]) for g in restarts]
        given = [_given(checker, g) for g in step.given if g.sensor.text != RESTARTED]
        contract_checker = replace(checker, in_contract_or_test=True)
        expectations = [contract_checker.expect(e, BOOL, "an expectation") for e in step.expect]
        if times is None:
            continue
        frames += len(times)
        if frames > MAX_TEST_FRAMES:
            checker.error("E604", step, f"the test has more than {MAX_TEST_FRAMES} frames", "make it shorter")
            return None
        if times[0] <= last_ns:
            hint = "each step begins after the one before it has ended"
            checker.error("E602", step.first, "the times of a test must strictly increase", hint)
        last_ns = max(last_ns, times[-1])
        steps.append(
            ir.Step(
                times_ns=times,
                given=tuple(g for g in given if g is not None),
                expectations=tuple(e for e in expectations if e is not None),
                restarted=bool(restarted and restarted[-1]),
                span=checker.span(step),
            )
        )
    return ir.Example(name=node.title, steps=tuple(steps), span=checker.span(node))


def _times(checker: Checker, step: ast.StepDecl) -> tuple[int, ...] | None:
    first = checker.duration_ns(step.first, "the time of a step")
    if step.last is None or step.period is None:
        return None if first is None else (first,)
    last = checker.duration_ns(step.last, "the end of a step")
    period = checker.duration_ns(step.period, "the time between frames")
    if first is None or last is None or period is None:
        return None
    if period == 0:
        checker.error("E604", step.period, "the time between frames must be longer than 0")
        return None
    if last < first:
        checker.error("E602", step.last, "the step ends before it begins")
        return None
    if (last - first) // period >= MAX_TEST_FRAMES:
        checker.error("E604", step, f"the step has more than {MAX_TEST_FRAMES} frames", "make it shorter")
        return None
    return tuple(range(first, last + 1, period))


def _given_restarted(checker: Checker, node: ast.GivenDecl, *, is_first: bool) -> bool:
    """Check `restarted = true`, which is possible only where a test begins: memory is initial there."""
    if isinstance(node.value, ast.Missing | ast.Elements) or node.index is not None or node.taken_ago:
        checker.error("E603", node, "`restarted` is true or false", "write `restarted = true`")
        return False
    if not is_first:
        hint = "give it in the first step, in which all memory is initial"
        checker.error("E603", node, "`restarted` is true at most in the first frame of a test", hint)
        return False
    return bool(checker.constant_in(node.value, BOOL, "", "the value given to `restarted`"))


def _given(checker: Checker, node: ast.GivenDecl) -> ir.Given | None:
    """Check `sensor = value`, `sensor[index] = value` or `sensor = missing`, with or without its age."""
    if node.sensor.path[0] == ir.SENT:
        sent = sent_field(checker, node.sensor)
        return None if sent is None else _given_to(checker, node, sent)
    symbol = checker.scope.robot.values.get(node.sensor.text)
    if not isinstance(symbol, SensorSymbol):
        if not isinstance(symbol, BrokenSymbol) and not checker.scope.may_be_lost(node.sensor.text):
            hint = checker.report.suggest(node.sensor.text, checker.scope.robot.values)
            if checker.scope.value(node.sensor.text) is not None:
                hint = "tests give values only to sensors; derived values are computed from them"
            checker.error("E603", node.sensor, f"unknown sensor `{node.sensor.text}`", hint)
        return None
    return _given_to(checker, node, symbol.sensor)


def _given_to(checker: Checker, node: ast.GivenDecl, sensor: ir.Sensor) -> ir.Given | None:
    """Check the value, and the age, that a step gives to a sensor."""
    size = sensor.type.size if isinstance(sensor.type, Array) else None
    index: int | None = None
    if node.index is not None:
        if size is None:
            checker.error("E603", node, f"`{sensor.name}` is not an array")
            return None
        index = checker.whole(node.index, "the index", 0, size - 1)
        if index is None:
            return None
    given = _given_value(checker, node, sensor, index)
    if node.taken_ago is None:
        return given
    age_ns = _age_ns(checker, node.taken_ago, sensor, isinstance(node.value, ast.Missing))
    return None if given is None or age_ns is None else replace(given, age_ns=age_ns)


def _given_value(
    checker: Checker, node: ast.GivenDecl, sensor: ir.Sensor, index: int | None
) -> ir.Given | None:
    span = checker.span(node)
    if isinstance(node.value, ast.Missing):
        if index is not None:
            hint = f"write `{sensor.name} = missing`"
            checker.error("E603", node, "one element cannot be missing, only the whole sensor", hint)
            return None
        return ir.Given(sensor=sensor.name, index=None, value=None, span=span)
    if isinstance(node.value, ast.Elements):
        return _given_elements(checker, node, node.value, sensor, index)
    value = _constant(checker, sensor, node.value)
    return None if value is None else ir.Given(sensor=sensor.name, index=index, value=value, span=span)


def _age_ns(checker: Checker, node: ast.Expression, sensor: ir.Sensor, is_missing: bool) -> int | None:
    """Check the duration after `taken`; only a reading of a sensor with `within` has an age."""
    age_ns = checker.duration_ns(node, "the age of a reading")
    if is_missing:
        checker.error("E603", node, "what is missing has no age", f"write `{sensor.name} = missing`")
        return None
    if sensor.within_ns is None:
        hint = f"declare `{sensor.name}` with `within`, or give it without `taken`"
        if sensor.sent is not None:
            hint = "give it without `taken`"
        checker.error("E603", node, f"`{sensor.name}` has no `within`: its readings do not age", hint)
        return None
    return age_ns


def _given_elements(
    checker: Checker, node: ast.GivenDecl, elements: ast.Elements, sensor: ir.Sensor, index: int | None
) -> ir.Given | None:
    values = [_constant(checker, sensor, v) for v in elements.values]
    if not isinstance(sensor.type, Array) or index is not None:
        checker.error("E603", elements, f"found a list of elements, expected one value for `{sensor.name}`")
        return None
    if len(values) != sensor.type.size:
        message = f"`{sensor.name}` has {sensor.type.size} elements, found {len(values)}"
        checker.error("E603", elements, message)
        return None
    valid = tuple(v for v in values if v is not None)
    if len(valid) < len(values):
        return None
    return ir.Given(sensor=sensor.name, index=None, value=valid, span=checker.span(node))


def _constant(checker: Checker, sensor: ir.Sensor, node: ast.Expression) -> ScalarValue | None:
    return checker.constant_in(
        node, element_type(sensor.type), sensor.unit, f"the value given to `{sensor.name}`"
    )
