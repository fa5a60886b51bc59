"""Formulas of conditions: what makes an expression true or false in a moment.

A boolean operation is a group of its operands, and a `let` the group of its expression. Whatever else is true
or false is a leaf, with the values that it reads.
"""

from __future__ import annotations

import math
from collections import ChainMap
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Literal, Protocol

from colony.ir import expression as ir
from colony.ir.bearings import index_text
from colony.ir.program import Let, Module
from colony.ir.types import (
    Array,
    Bool,
    Enum,
    Quantity,
    ScalarValue,
    Type,
    Value,
    bearings_of,
    element_type,
    is_percent,
    unit_shown,
)
from colony.text.wording import duration_text
from colony.verify.claims import source_text
from colony.verify.explain.causes import (
    Comparison,
    ConstantCondition,
    Past,
    Present,
    Remembered,
    SimpleCondition,
    UnknownCondition,
)
from colony.verify.explain.formula import Formula, Key, Leaf, all_leaves, group, negation
from colony.verify.explain.moment import Moment
from colony.verify.reference.boundary import default_of
from colony.verify.reference.expressions import evaluate, missing
from colony.verify.reference.kleene import Known, is_known, known_value
from colony.verify.snapshot import sparse_text

# --- memory --------------------------------------------------------------------------------------------
#
# Conditions about the past: what memory functions remembered before a frame.


def past_recently(moment: Moment, e: ir.MemoryCall, last: int | None) -> Leaf:
    """Return the condition that the argument was true within the duration; `last` is when, in ns."""
    elapsed = None if last is None else moment.t_ns - last
    holds = elapsed is not None and elapsed < e.duration_ns
    return _past(moment, e, "recently", last, elapsed, holds=holds)


def past_sustained(moment: Moment, e: ir.MemoryCall, last: tuple[int, int] | None, *, is_true: bool) -> Leaf:
    """Return the condition that the argument has been true for the duration.

    Args:
        moment: the frame.
        e: the call.
        last: the time since which it was true, in ns, and the number of the last frame in which it was.
        is_true: True if it is true in this frame.
    """
    unbroken = last is not None and last[1] == moment.values.number - 1
    since = None if not is_true else last[0] if unbroken and last is not None else moment.t_ns
    elapsed = None if since is None else moment.t_ns - since
    holds = elapsed is not None and elapsed >= e.duration_ns
    return _past(moment, e, "sustained", since, elapsed, holds=holds)


def _past(
    moment: Moment,
    e: ir.MemoryCall,
    function: Literal["recently", "sustained"],
    at_ns: int | None,
    elapsed_ns: int | None,
    *,
    holds: bool,
) -> Leaf:
    cause = Past(
        function=function,
        condition=source_text(e.arguments[0]),
        duration_ns=e.duration_ns,
        at_ns=at_ns,
        elapsed_ns=elapsed_ns,
    )
    return Leaf(holds=holds, cause=cause, key=("past", e.cell), span=e.span, node=e, fixed=moment.is_first)


def remembered(moment: Moment, e: ir.MemoryCall, *, value: bool, condition: str = "") -> Leaf:
    """Return the condition that a memory function remembers `value`; its text is `condition` or the call."""
    since = moment.earlier.cells.get((e.cell, (), 0))
    cause = Remembered(
        condition=condition or source_text(e),
        value="true" if value else "false",
        since_ns=None if since is None or since.first else since.t_ns,
    )
    return Leaf(holds=value, cause=cause, key=("memory", e.cell), span=e.span, node=e, fixed=moment.is_first)


def rests_on_past_alone(e: ir.Expression) -> bool:
    """Return True for a memory function whose own condition is about earlier frames only."""
    return isinstance(e, ir.MemoryCall) and e.function not in (
        ir.MemoryFunction.CAPTURED,
        ir.MemoryFunction.CHANGED,
    )


# --- values --------------------------------------------------------------------------------------------
#
# The text of values in an answer: with as many digits as the answer needs.


_DIGITS = (4, 6, 9, 12, 17)
"""Numbers of significant digits that are tried, until two values differ in their text."""

_MAX_ELEMENTS = 8
"""Maximum number of elements of an array that are shown."""


def value_text(value: Known, type_: Type, digits: int = _DIGITS[0]) -> str:
    """Return a value with its unit; "missing" for one that is not known."""
    if value is None:
        return "missing"
    if not isinstance(value, tuple):
        return scalar_text(value, type_, digits)
    assert isinstance(type_, Array)
    if None not in value and len(value) > _MAX_ELEMENTS:
        known = tuple(x for x in value if x is not None)
        text = sparse_text(known, type_, lambda x: scalar_text(x, type_, digits))
        if text is not None:
            return text
    more = ", ..." if len(value) > _MAX_ELEMENTS else ""
    return f"[{', '.join(value_text(x, type_.element, digits) for x in value[:_MAX_ELEMENTS])}{more}]"


def scalar_text(value: ScalarValue, type_: Type, digits: int = _DIGITS[0]) -> str:
    """Return a scalar, or one element of an array, with its unit."""
    match element_type(type_):
        case Bool():
            return "true" if value else "false"
        case Enum(name=name, members=members):
            return next((f"{name}.{member}" for member, n in members if n == value), _number(value, digits))
        case Quantity() as quantity:
            unit = unit_shown(quantity)
            text = _number(value / float(unit.factor), digits)
            return text if unit.text == "number" else f"{text} {unit.text}"


def pair_text(left: Value, right: Value, left_type: Type, right_type: Type) -> tuple[str, str]:
    """Return the texts of two values, with enough digits to tell them apart if they differ."""
    texts = "", ""
    for digits in _DIGITS:
        texts = value_text(left, left_type, digits), value_text(right, right_type, digits)
        if texts[0] != texts[1] or left == right:
            break
    return texts


def gap_text(left: Value, right: Value, type_: Type) -> str | None:
    """Return the distance between two numbers, None where there is no finite one."""
    if isinstance(left, tuple | bool) or isinstance(right, tuple | bool):
        return None
    gap = abs(left - right)
    if not isinstance(type_, Quantity) or not math.isfinite(gap):
        return None
    return scalar_text(gap, type_, 3)


def _number(x: float, digits: int) -> str:
    text = f"{x:.{digits}g}"
    if "e" in text and math.isfinite(x) and 1e-4 <= abs(x) < 1e9:
        return f"{x:.0f}" if abs(x) >= 1 else f"{x:.{digits}f}"
    return text


# --- comparisons ---------------------------------------------------------------------------------------
#
# Comparisons: the values of both sides, how far apart they are, and which inputs decided.


MAX_INPUTS = 6
"""Maximum number of inputs of a condition whose values an answer has."""

Values = Callable[[ir.Expression], Known]


def comparison(moment: Moment, e: ir.BinaryOperation | ir.Within, value: Values) -> Comparison:
    """Return what decided a comparison."""
    operands = (e.left, e.right) if isinstance(e, ir.BinaryOperation) else _nearest_bound(e, value)
    left, right = (value(operand) for operand in operands)
    left_type, right_type = (_quantity(a.type, b.type) for a, b in (operands, operands[::-1]))
    if not is_known(left) or not is_known(right):
        texts, gap = (value_text(left, left_type), value_text(right, right_type)), None
    else:
        texts = pair_text(left, right, left_type, right_type)
        gap = gap_text(left, right, left_type)
    places = [_place(operand, value) for operand in operands]
    sides = tuple(f"{source_text(operand)} =" for operand in operands)
    inputs = (text for text in inputs_text(e, value) if not text.startswith(sides))
    detail = (*inputs, *_memory_text(moment, e, value), *_commanders(moment, e))
    return Comparison(
        condition=source_text(e),
        left=texts[0] + places[0],
        right=texts[1] + places[1],
        gap=gap,
        detail=detail,
    )


def _nearest_bound(e: ir.Within, value: Values) -> tuple[ir.Expression, ir.Expression]:
    """Return the operand, and the bound that it exceeds or is nearest to."""
    x, low, high = value(e.operand), value(e.low), value(e.high)
    numbers = [v for v in (x, low, high) if isinstance(v, float)]
    if len(numbers) < 3:
        return e.operand, e.low
    below, above = numbers[0] - numbers[1], numbers[2] - numbers[0]
    return (e.operand, e.low) if below < above else (e.operand, e.high)


def _quantity(a: Type, b: Type) -> Type:
    """Return the type of two compared quantities; a literal 0 fits any, a plain number may be in percent."""
    return b if is_percent(b) or (isinstance(a, Quantity) and a.wildcard) else a


def inputs_text(e: ir.Expression, value: Values) -> tuple[str, ...]:
    """Return the inputs of a condition with their values: `ahead = 1200 mm`, `min(...) at [15 deg]`."""
    found = dict.fromkeys(_inputs(e, value, top=True))
    return tuple(found)[:MAX_INPUTS]


def _inputs(e: ir.Expression, value: Values, *, top: bool = False) -> Iterator[str]:
    match e:
        case (
            ir.SensorValue(name=name)
            | ir.DerivedValue(name=name)
            | ir.LocalValue(name=name)
            | ir.StateValue(name=name)
        ):
            yield f"{name} = {value_text(value(e), e.type)}"
        case ir.FunctionCall(function=ir.Function.MIN | ir.Function.MAX as f, arguments=[array]) if (
            isinstance(array.type, Array)
        ):
            at = _deciding_element(f, array, value)
            yield f"{source_text(e)} = {value_text(value(e), e.type)} at {at}"
        case ir.Reduce():
            if not top:
                yield f"{source_text(e)} = {value_text(value(e), e.type)}"
            else:
                for _, array in e.arrays:
                    yield from _inputs(array, value)
        case ir.Element(array=ir.SensorValue() | ir.DerivedValue() | ir.LocalValue()):
            yield f"{source_text(e)} = {value_text(value(e), e.type)}"
        case _:
            for child in ir.children(e):
                yield from _inputs(child, value)


def _place(e: ir.Expression, value: Values) -> str:
    """Return ` at [15 deg]`, if an expression is the least or greatest element of an array."""
    match e:
        case ir.FunctionCall(function=ir.Function.MIN | ir.Function.MAX as f, arguments=[array]) if (
            isinstance(array.type, Array)
        ):
            return f" at {_deciding_element(f, array, value)}"
        case _:
            return ""


def _deciding_element(f: ir.Function, array: ir.Expression, value: Values) -> str:
    """Return `[15 deg]`, the first element that a minimum or maximum is of."""
    elements = value(array)
    assert isinstance(elements, tuple), "the value of an array"
    chosen = (min if f is ir.Function.MIN else max)(range(len(elements)), key=lambda i: elements[i] or 0.0)
    whole, index = (array.array, array.indices[chosen]) if isinstance(array, ir.Slice) else (array, chosen)
    return f"[{index_text(bearings_of(whole.type), index)}]"


def _memory_text(moment: Moment, e: ir.Expression, value: Values) -> Iterator[str]:
    """Yield what states and memory functions in a comparison remember, and since when."""
    for node in _outside_loops(e):
        match node:
            case ir.StateValue(name=name):
                since = moment.earlier.states.get(name)
                if since is not None and not since.first:
                    yield f"{name} was set {duration_text(moment.t_ns - since.t_ns)} before"
            case ir.MemoryCall(cell=cell) if not isinstance(node.type, Array):
                text = f"{source_text(node)} = {value_text(value(node), node.type)}"
                since = moment.history.cells.get((cell, (), 0))
                known = since is not None and not since.first
                yield text + (
                    f", set {duration_text(moment.t_ns - since.t_ns)} before" if since and known else ""
                )
            case _:
                pass


def _commanders(moment: Moment, e: ir.Expression) -> Iterator[str]:
    """Yield who commands each actuator of which a comparison reads what was sent."""
    sent = {node.actuator: None for node in ir.subexpressions(e) if isinstance(node, ir.SentField)}
    for actuator in sent:
        winner = moment.values.winners[actuator]
        unwon = "by an operator" if actuator in moment.values.commanded else "idle"
        yield f"{actuator} is {unwon if winner is None else f'by {winner}'}"


def _outside_loops(e: ir.Expression) -> Iterator[ir.Expression]:
    """Yield the subexpressions that have one value in a frame, whatever the round of a reduction."""
    yield e
    inner = [array for _, array in e.arrays] if isinstance(e, ir.Reduce) else ir.children(e)
    for child in inner:
        yield from _outside_loops(child)


# --- conditions ----------------------------------------------------------------------------------------


MAX_NESTED_LETS = 40
"""Maximum number of lets that are looked into, one within the other."""


class ContractFormulas(Protocol):
    """The formulas of what contracts say about the network."""

    def active(self, name: str) -> Formula:
        """Return the formula of "this module or wire is active"."""
        ...

    def is_by(self, actuator: str, module: str) -> Formula:
        """Return the formula of "the actuator is by this module"."""
        ...

    def is_commanded(self, actuator: str) -> Formula:
        """Return the formula of "a module's command is sent to this actuator"."""
        ...


class Conditions:
    """Builds the formulas of expressions in one moment. Stateful: remembers those of lets.

    `network` gives the formulas of what contracts say about the network.
    """

    def __init__(self, moment: Moment, network: ContractFormulas) -> None:
        self._moment, self._network = moment, network
        self._lets: dict[str, Formula] = {}
        self._nested = 0
        self._numbers: dict[ir.Expression, int] = {}
        self._file_lets = {d.name: d for d in moment.program.derived if isinstance(d, Let)}
        modules = (m for m in moment.program.modules if isinstance(m, Module))
        self._local_lets = {let.name: let for m in modules for let in m.lets}

    def value(self, e: ir.Expression) -> Known:
        """Return the value of an expression; it advances no memory."""
        memory: Any = ChainMap({}, self._moment.memory)
        if missing(e, self._moment.values):
            return known_value(e, self._moment.values, memory)
        return evaluate(e, self._moment.values, memory)

    def formula(self, e: ir.Expression) -> Formula:
        """Return the formula of a scalar boolean expression."""
        match e:
            case ir.UnaryOperation(operator=ir.Unary.NOT, operand=operand):
                return negation(self.formula(operand))
            case ir.BinaryOperation():
                return self._operation(e)
            case ir.Within():
                return self._compared(e)
            case ir.Conditional(condition=condition, yes=yes, no=no):
                chosen = self.formula(condition)
                taken = group("all", (chosen, self.formula(yes)))
                return group("any", (taken, group("all", (negation(chosen), self.formula(no)))))
            case ir.FunctionCall(function=ir.Function.ANY | ir.Function.ALL as f, arguments=arguments) if all(
                not isinstance(a.type, Array) for a in arguments
            ):
                return group("any" if f is ir.Function.ANY else "all", [*map(self.formula, arguments)])
            case ir.ValueOr(expression=expression, other=other) if not isinstance(expression, ir.Element):
                return self.formula(other if missing(expression, self._moment.values) else expression)
            case ir.MemoryCall() if not any(isinstance(a.type, Array) for a in e.arguments):
                return self._recalled(e)
            case _:
                return self._named(e)

    def _operation(self, e: ir.BinaryOperation) -> Formula:
        match e.operator:
            case ir.Binary.AND:
                return group("all", self._flat(e.operator, e.left, e.right))
            case ir.Binary.OR:
                return group("any", self._flat(e.operator, e.left, e.right))
            case ir.Binary.IMPLIES:
                return group("any", (negation(self.formula(e.left)), self.formula(e.right)))
            case _:
                return self._compared(e)

    def _named(self, e: ir.Expression) -> Formula:
        """Return the formula of what has a name: a let, a module, a wire, a sensor that is fresh."""
        match e:
            case ir.DerivedValue(name=name):
                return self._let(name, self._file_lets, e)
            case ir.LocalValue(name=name):
                return self._let(name, self._local_lets, e)
            case ir.Fresh(name=name, derived=False):
                return self.present(name)
            case ir.Fresh(name=name, derived=True):
                let = self._file_lets[name]
                return group("all", self.presence([let.expression]), subject="let", name=name, span=let.span)
            case ir.IsActive(name=name):
                return self._agreeing(e, self._network.active(name))
            case ir.WonBy(actuator=actuator, module=module):
                return self._agreeing(e, self._network.is_by(actuator, module))
            case ir.IsCommanded(actuator=actuator):
                return self._agreeing(e, self._network.is_commanded(actuator))
            case ir.IsIdle(actuator=actuator):
                return self._agreeing(e, negation(self._network.is_commanded(actuator)))
            case _:
                return self._leaf(e)

    def _agreeing(self, e: ir.Expression, formula: Formula) -> Formula:
        """Return a formula, if it has the value that the interpreter found; else `e` without its parts."""
        return formula if formula.holds == (self.value(e) is True) else self._leaf(e)

    def _flat(self, operator: ir.Binary, *operands: ir.Expression) -> list[Formula]:
        """Return the formulas of the operands of a chain `a and b and c`."""
        parts: list[Formula] = []
        for operand in operands:
            match operand:
                case ir.BinaryOperation(operator=same, left=left, right=right) if same is operator:
                    parts += self._flat(operator, left, right)
                case _:
                    parts.append(self.formula(operand))
        return parts

    def _let(self, name: str, lets: Mapping[str, Let], e: ir.Expression) -> Formula:
        let = lets.get(name)
        if let is None or self._nested >= MAX_NESTED_LETS:
            return self._leaf(e)
        found = self._lets.get(name)
        if found is None:
            self._nested += 1
            part = self.formula(let.expression)
            self._nested -= 1
            found = group("all", (part,), subject="let", name=name, span=let.span)
            self._lets[name] = found
        return found

    def _key(self, e: ir.Expression) -> Key:
        return "expression", self._number(e)

    def entangled(self, formula: Formula) -> frozenset[Key]:
        """Return the conditions on which others of a formula depend, and those about missing sensors."""
        found = all_leaves(formula)
        numbers = {key: self._number(leaf.node) for key, leaf in found.items() if leaf.node is not None}
        read = {n for leaf in found.values() if leaf.node is not None for n in self._reads(leaf.node)}
        return frozenset(key for key in found if numbers.get(key) in read or key[0] == "present")

    def _reads(self, root: ir.Expression) -> set[int]:
        """Return the numbers of the boolean expressions within one, also by way of lets."""
        found: set[int] = set()
        lets: set[str] = set()
        work = [] if rests_on_past_alone(root) else [*ir.children(root)]
        while work:
            e = work.pop()
            if isinstance(e.type, Bool):
                found.add(self._number(e))
            if isinstance(e, ir.DerivedValue | ir.LocalValue) and e.name not in lets:
                lets.add(e.name)
                lets_of = self._file_lets if isinstance(e, ir.DerivedValue) else self._local_lets
                work.append(lets_of[e.name].expression)
            work.extend(ir.children(e))
        return found

    def _number(self, e: ir.Expression) -> int:
        """Return the number of an expression; equal ones have one value, and change together."""
        return self._numbers.setdefault(e, len(self._numbers))

    # --- leaves ----------------------------------------------------------------------------------

    def _compared(self, e: ir.BinaryOperation | ir.Within) -> Formula:
        value = self.value(e)
        if value is None:
            return self._unknown(e)
        cause = comparison(self._moment, e, self.value)
        return Leaf(holds=value is True, cause=cause, key=self._key(e), span=e.span, node=e)

    def _unknown(self, e: ir.Expression) -> Leaf:
        absent = tuple(str(leaf.key[1]) for leaf in self.presence([e]) if not leaf.holds)
        cause = UnknownCondition(condition=source_text(e), missing=absent)
        return Leaf(holds=False, cause=cause, key=self._key(e), span=e.span, node=e, fixed=True)

    def _leaf(self, e: ir.Expression) -> Leaf:
        """Return a condition without parts."""
        value = self.value(e)
        if value is None:
            return self._unknown(e)
        holds = value is True
        match e:
            case ir.Constant():
                cause = ConstantCondition(condition=source_text(e) or ("true" if holds else "false"))
                return Leaf(holds=holds, cause=cause, key=self._key(e), span=e.span, node=e, fixed=True)
            case ir.StateValue(name=name):
                since = self._moment.earlier.states.get(name)
                remembered = Remembered(
                    condition=name,
                    value=value_text(value, e.type),
                    since_ns=None if since is None or since.first else since.t_ns,
                )
                return Leaf(holds=holds, cause=remembered, key=("state", name), span=e.span, node=e)
            case ir.SensorValue(name=name):
                reading = SimpleCondition(condition=name)
                return Leaf(holds=holds, cause=reading, key=("sensor", name), span=e.span, node=e)
            case _:
                reading = SimpleCondition(condition=source_text(e), detail=inputs_text(e, self.value))
                return Leaf(holds=holds, cause=reading, key=self._key(e), span=e.span, node=e)

    def present(self, sensor: str) -> Leaf:
        """Return the condition that a sensor has a value."""
        moment = self._moment
        declared = next(s for s in moment.program.robot.sensors if s.name == sensor)
        is_fresh = sensor in moment.values.fresh
        since = moment.history.sensors.get(sensor)
        missing_since = None if is_fresh or since is None or since.first else since.t_ns
        return Leaf(
            holds=is_fresh,
            cause=Present(
                sensor=sensor,
                server=declared.server,
                why=None if is_fresh else moment.absent.get(sensor, "no reading"),
                since_ns=missing_since,
                within_ns=declared.within_ns,
            ),
            key=("present", sensor),
            span=declared.span,
        )

    def presence(self, expressions: Iterable[ir.Expression]) -> tuple[Leaf, ...]:
        """Return the conditions that no value is missing that expressions need."""
        found: dict[str, None] = {}
        seen: set[str] = set()
        work = [*expressions]
        while work:
            match work.pop():
                case ir.SensorValue(name=name):
                    found[name] = None
                case ir.DerivedValue(name=name) if name not in seen:
                    seen.add(name)
                    work.append(self._file_lets[name].expression)
                case ir.LocalValue(name=name) if name not in seen:
                    seen.add(name)
                    work.append(self._local_lets[name].expression)
                case ir.ValueOr(other=other):
                    work.append(other)
                case e:
                    work.extend(ir.children(e))
        sensors = self._moment.program.robot.sensors
        return tuple(self.present(s.name) for s in sensors if s.name in found and default_of(s) is None)

    # --- memory ----------------------------------------------------------------------------------

    def _recalled(self, e: ir.MemoryCall) -> Formula:
        """Return the formula of a boolean memory function: what it reads now, and what it remembers."""
        if self.value(e) is None:
            return self._unknown(e)
        moment = self._moment
        last: Any = moment.memory.get((e.cell, (), 0))
        match e.function:
            case ir.MemoryFunction.RECENTLY:
                return group("any", (self.formula(e.arguments[0]), past_recently(moment, e, last)))
            case ir.MemoryFunction.SUSTAINED:
                is_true = self.value(e.arguments[0]) is True
                past = past_sustained(moment, e, last, is_true=is_true)
                return group("all", (self.formula(e.arguments[0]), past))
            case ir.MemoryFunction.LATCH:
                latched = remembered(moment, e, value=bool(last), condition="latched")
                was = group("any", (latched, self.formula(e.arguments[0])))
                return group("all", (was, negation(self.formula(e.arguments[1]))))
            case ir.MemoryFunction.RISING:
                return group("all", (self.formula(e.arguments[0]), negation(self._previous(e, last))))
            case ir.MemoryFunction.FALLING:
                return group("all", (negation(self.formula(e.arguments[0])), self._previous(e, last)))
            case _:
                return remembered(moment, e, value=self.value(e) is True)

    def _previous(self, e: ir.MemoryCall, last: object) -> Leaf:
        """Return the condition that the argument of a memory function was true in the frame before."""
        before = f"previous({source_text(e.arguments[0])})"
        return remembered(self._moment, e, value=bool(last), condition=before)
