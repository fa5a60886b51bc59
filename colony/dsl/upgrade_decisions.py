"""What a person has to decide about a file of version 1: where version 2 decides differently.

Each is a warning at its place in the upgraded text.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from colony.dsl.missing import Missing
from colony.ir import expression as ir
from colony.ir.program import Actuator, Limit, Machine, Program, Transition
from colony.ir.types import Array
from colony.ir.walk import expressions
from colony.text.diagnostics import Diagnostic, Label, warning
from colony.text.source import Source
from colony.text.wording import listed


def decisions_about(program: Program, errors: tuple[Diagnostic, ...], source: Source) -> Iterator[Diagnostic]:
    """Yield what has to be decided about `source`, a file of an upgraded program.

    `errors` are those that version 1 did not have.
    """
    missing = Missing(program)
    yield from _contradicting_limits(program, source)
    yield from _missing_bounds(program, missing, source)
    yield from _blind_transitions(program, missing, source)
    yield from _unknown_contracts(program, missing, source)
    for expression in expressions(program):
        yield from _wrapping_indices(expression, {}, source)
    for found in errors:
        if found.code == "E305" and found.span.source is source:
            message = "`idle hold` is refused for an actuator with a speed or rate; version 1 accepted it"
            yield warning("U005", found.span, message, found.hint)
        if found.code == "E217" and found.span.source is source:
            yield warning(
                "U007", found.span, "what is outside wrapped in version 1; now it is refused", _RING
            )


# --- indices ---------------------------------------------------------------------------------------

_RING = "declare the array as a ring, with `bearing`, or keep the index inside"
_Interval = tuple[float, float]


def _wrapping_indices(
    e: ir.Expression, loops: Mapping[str, _Interval], source: Source
) -> Iterator[Diagnostic]:
    """Yield the computed indices of an expression that may be outside: they were taken modulo the size."""
    if isinstance(e, ir.Reduce):
        loops = {**loops, e.variable: (e.low, e.high)}
    if isinstance(e, ir.Element | ir.Window) and not e.wraps and e.span.source is source:
        assert isinstance(e.array.type, Array)
        center, reach = (e.center, e.reach) if isinstance(e, ir.Window) else (e.index, 0)
        found, size = _interval(center, loops), e.array.type.size
        if isinstance(e, ir.Element) and isinstance(center, ir.Constant):
            found = (0, 0)  # a constant index outside is refused
        if found is None or found[0] - reach < -0.5 or found[1] + reach > size - 0.5:
            message = "this index was taken modulo the size in version 1; outside it now gives NaN, or false"
            yield warning("U007", e.span, message, _RING)
    for child in ir.children(e):
        yield from _wrapping_indices(child, loops, source)


def _interval(e: ir.Expression, loops: Mapping[str, _Interval]) -> _Interval | None:
    """Return the least and greatest value of an index, if loops and constants alone bound it."""
    match e:
        case ir.Constant(value=float(value)):
            return value, value
        case ir.LoopIndex(name=name):
            return loops[name]
        case ir.Call(function=ir.Function.MOD, arguments=(_, ir.Constant(value=float(n)))) if n > 0:
            return 0, n
        case ir.Call(function=ir.Function.CLAMP, arguments=(_, low, high)):
            least, greatest = _interval(low, loops), _interval(high, loops)
            return None if least is None or greatest is None else (least[0], greatest[1])
        case ir.UnaryOperation(operator=ir.Unary.NEGATE, operand=operand):
            found = _interval(operand, loops)
            return None if found is None else (-found[1], -found[0])
        case ir.BinaryOperation(operator=ir.Binary.ADD | ir.Binary.SUBTRACT, left=left, right=right):
            a, b = _interval(left, loops), _interval(right, loops)
            if a is None or b is None:
                return None
            if e.operator is ir.Binary.ADD:
                return a[0] + b[0], a[1] + b[1]
            return a[0] - b[1], a[1] - b[0]
        case _:
            return None


# --- limits ----------------------------------------------------------------------------------------


def _contradicting_limits(program: Program, source: Source) -> Iterator[Diagnostic]:
    actuators = {a.name: a for a in program.robot.actuators}
    for i, limit in enumerate(program.limits):
        beyond = _beyond_range(limit, actuators[limit.actuator])
        if beyond is not None and limit.span.source is source:
            message = f"this bound is {beyond}; version 1 used the range; now the idle command is sent"
            yield warning("U001", limit.span, message, "choose a bound inside the range")
        earlier = [other for other in program.limits[:i] if _can_contradict(other, limit)]
        if earlier and _concerns(source, limit, earlier):
            message = (
                "this limit can contradict another one; version 1 used this one, the last; "
                "now the idle command is sent"
            )
            hint = "make one of them apply only `when` the other does not, or keep their bounds apart"
            labels = tuple(Label(other.span, "the other limit") for other in earlier)
            yield replace(warning("U001", limit.span, message, hint), labels=labels)


def _concerns(source: Source, limit: Limit, earlier: list[Limit]) -> bool:
    """Return True if the limits are in this file, or meet only because it imports their files."""
    sources = {limit.span.source, *(other.span.source for other in earlier)}
    return source in sources or len(sources) > 1


def _can_contradict(one: Limit, other: Limit) -> bool:
    same_field = (one.actuator, one.field_index) == (other.actuator, other.field_index)
    if not same_field or one.relation == other.relation:
        return False
    upper, lower = (one, other) if one.relation == "<=" else (other, one)
    high, low = _constant(upper.bound), _constant(lower.bound)
    return high is None or low is None or low > high


def _beyond_range(limit: Limit, actuator: Actuator) -> str | None:
    field, bound = actuator.fields[limit.field_index], _constant(limit.bound)
    if bound is None:
        return None
    if limit.relation == "<=" and field.low is not None and bound < field.low:
        return "below the range"
    if limit.relation == ">=" and field.high is not None and bound > field.high:
        return "above the range"
    return None


def _constant(bound: ir.Expression) -> float | None:
    """Return the value of a bound that is a number, perhaps negative; None for any other."""
    match bound:
        case ir.Constant(value=float(value)):
            return value
        case ir.UnaryOperation(operator=ir.Unary.NEGATE, operand=ir.Constant(value=float(value))):
            return -value
        case _:
            return None


def _missing_bounds(program: Program, missing: Missing, source: Source) -> Iterator[Diagnostic]:
    actuators = {a.name: a for a in program.robot.actuators}
    for limit in program.limits:
        actuator = actuators[limit.actuator]
        idle = None if actuator.idle is None else actuator.idle[limit.field_index]
        if limit.span.source is not source or idle == 0:
            continue
        needs = sorted(missing.needs(limit.bound))
        if not needs and not _may_be_infinite(limit.bound):
            continue
        now = (
            "nothing is sent" if idle is None else f"it is the idle command's {_value(limit, actuator, idle)}"
        )
        where = _without(needs) if needs else "it is not finite"
        message = f"where {where}, this bound was 0 in version 1; now {now}"
        yield warning("U002", limit.bound.span, message, "`value_or(BOUND, VALUE)` gives another bound")


_PARTIAL = frozenset({ir.Function.SQRT, ir.Function.MOD, ir.Function.TAN, ir.Function.ASIN, ir.Function.ACOS})
"""Functions that are NaN or infinite for some finite arguments."""


def _may_be_infinite(bound: ir.Expression) -> bool:
    """Return True if a bound may be NaN or infinite though what it reads is finite, overflow left aside."""
    return any(map(_makes_infinite, ir.subexpressions(bound)))


def _makes_infinite(e: ir.Expression) -> bool:
    match e:
        case ir.BinaryOperation(operator=ir.Binary.DIVIDE, right=right):
            return not isinstance(right, ir.Constant)
        case ir.Call(function=function):
            return function in _PARTIAL
        case ir.Reduce(function=function, condition=condition):  # of nothing
            return condition is not None and function in (ir.Function.MIN, ir.Function.MAX, ir.Function.MEAN)
        case ir.Element(index=index) | ir.Window(center=index):
            return _may_be_infinite(index)
        case _:
            return False


def _value(limit: Limit, actuator: Actuator, idle: float | bool) -> str:
    field = actuator.fields[limit.field_index]
    return f"{idle / field.factor:g} {field.unit}".rstrip()


def _without(sensors: list[str]) -> str:
    names = listed([f"`{name}`" for name in sensors], "or")
    return f"{names} is missing"


# --- machines and contracts ------------------------------------------------------------------------


def _blind_transitions(program: Program, missing: Missing, source: Source) -> Iterator[Diagnostic]:
    for machine in program.derived:
        if isinstance(machine, Machine) and machine.span.source is source:
            for i, transition in enumerate(machine.transitions):
                held_back = _held_back(machine, i, missing)
                if held_back is not None:
                    yield _blind_transition(transition, held_back, missing)


def _blind_transition(transition: Transition, held_back: Transition, missing: Missing) -> Diagnostic:
    lost = sorted(missing.needs(transition.condition) - missing.needs(held_back.condition))
    message = (
        f"where {_without(lost)}, no transition of the same phase below this one is taken; "
        "in version 1 they were"
    )
    hint = (
        "`failsafe` before a transition takes it where it reads something missing; "
        f"`value_or({lost[0]}, VALUE)` decides this one there"
    )
    label = Label(held_back.span, "this one is held back")
    return replace(warning("U003", transition.span, message, hint), labels=(label,))


def _held_back(machine: Machine, i: int, missing: Missing) -> Transition | None:
    """Return the first transition that transition `i` holds back where something is missing."""
    transition = machine.transitions[i]
    if transition.failsafe:
        return None
    needs = missing.needs(transition.condition)
    for below in machine.transitions[i + 1 :]:
        shares_phase = transition.sources & below.sources
        if shares_phase and not below.failsafe and not needs <= missing.needs(below.condition):
            return below
    return None


def _unknown_contracts(program: Program, missing: Missing, source: Source) -> Iterator[Diagnostic]:
    for contract in program.contracts:
        if contract.span.source is not source:
            continue
        sensors = missing.unknown_without(contract.expression)
        if sensors is None:
            continue
        if not sensors:
            message = (
                f"`{contract.name}` reads an actuator on `idle hold`: where nothing is sent, it had no value "
                "in version 1; now the field is what was sent last, and the contract is broken before that"
            )
            hint = "write `ACTUATOR is commanded implies (...)`"
        else:
            names = [f"`{name}`" for name in sensors]
            verb = "is" if len(names) == 1 else "are"
            message = (
                f"`{contract.name}` can be broken where {listed(names, 'and')} {verb} missing; "
                "in version 1 it had no value there"
            )
            first = sensors[0]
            hint = (
                f"write `fresh({first}) implies (...)` or `value_or({first}, VALUE)`, "
                "or a second contract for the missing case"
            )
        yield warning("U004", contract.span, message, hint)
