"""Checking of limits, contracts and tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from colony.dsl import ast
from colony.dsl.check.calls import held_assumption
from colony.dsl.check.checker import Checker, sent_field
from colony.dsl.check.compatibility import constant_value, with_article
from colony.dsl.check.declare import RESTARTED
from colony.dsl.check.references import actuator_named, is_before, report_unknown, role_read, role_sensor
from colony.dsl.check.scope import (
    AssumptionSymbol,
    BrokenSymbol,
    CheckReport,
    LetSymbol,
    ModuleSymbol,
    SensorSymbol,
    TunableSymbol,
    ValueSymbol,
)
from colony.ir import program as ir
from colony.ir.expression import (
    Binary,
    BinaryOperation,
    Constant,
    Element,
    Expression,
    MemoryCall,
    MemoryFunction,
    Now,
    Slice,
    Unary,
    UnaryOperation,
    ValueOr,
    Within,
)
from colony.ir.types import BOOL, DURATION, Array, Quantity, ScalarValue, element_type

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
    """Check a contract: a condition that must hold in every frame; or a `reach`, as one that never does.

    That of an assumption is that the value of its name is true or missing.
    """
    if isinstance(node, ast.AssumeDecl):
        symbol = checker.scope.values.get(node.name.text)
        if not isinstance(symbol, AssumptionSymbol):
            return None
        expression = held_assumption(symbol.name)
        return ir.Contract(
            name=symbol.name, expression=expression, assumed=True, span=checker.span(node.name)
        )
    if not all(requirement.strip() for requirement in node.requirements):
        hint = (
            f'write the id that the requirement has elsewhere: `{node.keyword} NAME requirement "SR-12": ...`'
        )
        checker.error("E605", node.name, f"`{node.name.text}` names a requirement without an id", hint)
    contract_checker = replace(checker, in_contract_or_test=True)
    found = contract_checker.expect(node.expression, BOOL, f"a {node.keyword}")
    if found is None:
        return None
    return ir.Contract(
        name=checker.scope.full_name(node.name.text),
        expression=_never(found) if node.reach else found,
        in_time=node.in_time or node.reach,
        reach=node.reach,
        requirements=node.requirements,
        span=checker.span(node.name),
    )


def _never(condition: Expression) -> Expression:
    """Return the contract that a condition is not true."""
    known = ValueOr(type=BOOL, expression=condition, other=Constant(type=BOOL, value=False))
    return UnaryOperation(type=BOOL, operator=Unary.NOT, operand=known)


def frames_are_regular(robot: ir.Robot, new_cell: Callable[[], int]) -> ir.Contract:
    """Return the contract that the frames of a robot come at its period, as closely as it says.

    It allows a nanosecond more, as times in seconds round.
    """
    assert robot.jitter_ns is not None

    def seconds(value_ns: int) -> Constant:
        return Constant(type=DURATION, value=value_ns / 1e9)

    now = Now(type=DURATION)
    arguments = (now, seconds(-robot.frame_ns))
    before = MemoryCall(type=DURATION, function=MemoryFunction.PREVIOUS, arguments=arguments, cell=new_cell())
    gap = BinaryOperation(type=DURATION, operator=Binary.SUBTRACT, left=now, right=before)
    shortest = seconds(robot.frame_ns - robot.jitter_ns - 1)
    longest = seconds(robot.frame_ns + robot.jitter_ns + 1)
    within = Within(type=BOOL, operand=gap, low=shortest, high=longest)
    return ir.Contract(name=ir.REGULAR, expression=within, span=robot.span, assumed=True)


def check_test(checker: Checker, node: ast.TestDecl) -> ir.Example | None:
    """Check a test; its times must strictly increase."""
    steps: list[ir.ExampleStep] = []
    last_ns = -1
    frames = 0
    for step in node.steps:
        times = _times(checker, step)
        restarts = [g for g in step.given if _gives_restarted(g)]
        restarted = [_given_restarted(checker, g, is_first=step is node.steps[0]) for g in restarts]
        given = [x for g in step.given if not _gives_restarted(g) for x in _given(checker, g)]
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
            ir.ExampleStep(
                times_ns=times,
                given=tuple(given),
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


def _gives_restarted(node: ast.GivenDecl) -> bool:
    return isinstance(node.sensor, ast.Reference) and node.sensor.text == RESTARTED


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


def _given(checker: Checker, node: ast.GivenDecl) -> list[ir.GivenReading]:
    """Check `sensor = value`, `sensor[index] = value` or `sensor = missing`, with or without its age."""
    named = node.sensor
    if not isinstance(named, ast.Reference):
        role = _given_role(checker, named)
        return [] if role is None else _given_to(checker, node, role)
    if named.path[0] == ir.SENT:
        sent = sent_field(checker, named)
        return [] if sent is None else _given_to(checker, node, sent)
    symbol = checker.scope.robot.values.get(named.text) or _program_sensor(checker, named)
    if not isinstance(symbol, SensorSymbol):
        if not isinstance(symbol, BrokenSymbol) and not checker.scope.may_be_lost(named.text):
            hint = checker.report.suggest(named.text, checker.scope.robot.values)
            if checker.scope.value(named.text) is not None:
                hint = "tests give values only to sensors; derived values are computed from them"
            report_unknown(checker, "E603", named, f"unknown sensor `{named.text}`", hint)
        return []
    return _given_to(checker, node, symbol.sensor)


def _given_role(checker: Checker, node: ast.By | ast.Is) -> ir.Sensor | None:
    """Return the sensor of what a module did in the frame before; errors in its names are reported later."""
    if is_before(node):
        quiet = replace(checker, report=CheckReport(suggestions=0))
        return None if role_read(checker, node) is None else role_sensor(quiet, node)
    hint = "give what a module did in the frame before: `last.ACTUATOR by MODULE = true`"
    checker.error("E603", node, "what a module does is decided, not given", hint)
    return None


def _program_sensor(checker: Checker, node: ast.Reference) -> ValueSymbol | None:
    """Return an input or tunable param of the program, or the sensor that a `let NAME = SENSOR` renames."""
    scope, path = checker.scope.resolve(node.path)
    symbol = scope.value(path[0]) if len(path) == 1 else None
    module = scope.network_symbol(path[0]) if len(path) == 2 else None
    if isinstance(module, ModuleSymbol):
        symbol = module.members.get(path[1])
    robot = checker.scope.robot
    match symbol:
        case TunableSymbol(sensor=sensor):
            robot.tunables[sensor.name] = sensor
            return SensorSymbol(sensor=sensor)
        case SensorSymbol():
            return symbol
        case LetSymbol(name=name):
            return robot.values.get(robot.renamed.get(name, ""))
        case _:
            return None


def _given_to(checker: Checker, node: ast.GivenDecl, sensor: ir.Sensor) -> list[ir.GivenReading]:
    """Check the value, and the age, that a step gives to a sensor or to some of its elements."""
    indices: tuple[int | None, ...] = (None,)
    if node.index is not None:
        found = _indices(checker, node, node.index, sensor)
        if found is None:
            return []
        indices = found
    given = _given_value(checker, node, sensor, len(indices))
    age_ns: int | None = None
    if node.taken_ago is not None:
        age_ns = _age_ns(checker, node.taken_ago, sensor, isinstance(node.value, ast.Missing))
        if age_ns is None:
            return []
    if given is None:
        return []
    if node.index is not None and isinstance(given.value, tuple):
        pairs = zip(indices, given.value, strict=True)
        return [replace(given, index=i, value=value, age_ns=age_ns) for i, value in pairs]
    return [replace(given, index=i, age_ns=age_ns) for i in indices]


def _indices(
    checker: Checker, node: ast.GivenDecl, index: ast.Expression, sensor: ir.Sensor
) -> tuple[int, ...] | None:
    """Return the elements that a step gives; None after an error."""
    if not isinstance(sensor.type, Array):
        checker.error("E603", node, f"`{sensor.name}` is not an array")
        return None
    start, end = node.start, (node.last or index).end + 1
    if node.last is not None:
        place = ast.SliceOf(array=node.sensor, first=index, last=node.last, start=start, end=end)
        found = checker.visit(place)
        return found.indices if isinstance(found, Slice) else None
    if checker.constant(index, None, "the index") is None:
        return None
    element = checker.visit(ast.IndexNode(array=node.sensor, index=index, start=start, end=end))
    if not isinstance(element, Element):
        return None
    value = constant_value(element.index)
    assert value is not None, "the index is constant"
    return (round(value) % sensor.type.size,)


def _given_value(
    checker: Checker, node: ast.GivenDecl, sensor: ir.Sensor, size: int
) -> ir.GivenReading | None:
    """Return the value that a step gives; `size` is the number of elements, if it gives some of them."""
    span = checker.span(node)
    if isinstance(node.value, ast.Missing):
        if node.index is not None:
            hint = f"write `{sensor.name} = missing`"
            checker.error("E603", node, "one element cannot be missing, only the whole sensor", hint)
            return None
        return ir.GivenReading(sensor=sensor.name, index=None, value=None, span=span)
    if isinstance(node.value, ast.Elements):
        return _given_elements(checker, node, node.value, sensor, size)
    value = _constant(checker, sensor, node.value)
    return None if value is None else ir.GivenReading(sensor=sensor.name, index=None, value=value, span=span)


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
    checker: Checker, node: ast.GivenDecl, elements: ast.Elements, sensor: ir.Sensor, size: int
) -> ir.GivenReading | None:
    values = [_constant(checker, sensor, v) for v in elements.values]
    if not isinstance(sensor.type, Array) or (node.index is not None and node.last is None):
        checker.error("E603", elements, f"found a list of elements, expected one value for `{sensor.name}`")
        return None
    expected = sensor.type.size if node.index is None else size
    if len(values) != expected:
        what = f"`{sensor.name}` has" if node.index is None else "the slice has"
        message = f"{what} {expected} elements, found {len(values)}"
        checker.error("E603", elements, message)
        return None
    valid = tuple(v for v in values if v is not None)
    if len(valid) < len(values):
        return None
    return ir.GivenReading(sensor=sensor.name, index=None, value=valid, span=checker.span(node))


def _constant(checker: Checker, sensor: ir.Sensor, node: ast.Expression) -> ScalarValue | None:
    return checker.constant_in(
        node, element_type(sensor.type), sensor.unit, f"the value given to `{sensor.name}`"
    )
