"""Comparisons: the values of both sides, how far apart they are, and which inputs decided."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from colony.ir import expression as ir
from colony.ir.bearings import index_text
from colony.ir.types import Array, Quantity, Type, bearings_of, is_percent
from colony.text.wording import duration_text
from colony.verify.explain.causes import Comparison
from colony.verify.explain.moment import Moment
from colony.verify.explain.values import gap_text, pair_text, value_text
from colony.verify.reference.kleene import Known, is_known
from colony.verify.source_text import source_text

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
        case ir.Call(function=ir.Function.MIN | ir.Function.MAX as f, arguments=[array]) if isinstance(
            array.type, Array
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
        case ir.Call(function=ir.Function.MIN | ir.Function.MAX as f, arguments=[array]) if isinstance(
            array.type, Array
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
