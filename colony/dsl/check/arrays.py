"""Checking of elements and slices of arrays, by whole index or by bearing, and of the bearings of sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite
from typing import NamedTuple

from colony.dsl import ast
from colony.dsl.check.calls import reduction_result
from colony.dsl.check.checker import Checker
from colony.dsl.check.compatibility import constant_value, with_article
from colony.dsl.check.declare import reject_reserved_name
from colony.ir import expression as ir
from colony.ir.bearings import (
    TURN,
    Bearings,
    between,
    listed_bearings,
    nearest,
    part_by_bearing,
    part_by_index,
    reaches_beyond,
    sweep,
    too_many_hint,
    uniform,
)
from colony.ir.types import BOOL, DEGREES, DIMENSIONLESS, Array, Quantity, Type, element_type
from colony.text.diagnostics import note, warning
from colony.text.units import ANGLE, NUMBER
from colony.text.wording import degrees_text, listed, one_line

_SHOWN_BEARINGS = 8
"""Maximum number of bearings that a hint lists."""

_NO_WRAP = "indices wrap in a ring that closes: a sensor with `bearing`"
"""Part of a hint for an index that is outside an array, or a slice that would have to wrap."""


def is_angle(type_: Type) -> bool:
    """Return True for the type of an angle, which a literal 0 is not."""
    return isinstance(type_, Quantity) and type_.dimension == ANGLE and not type_.wildcard


# --- elements --------------------------------------------------------------------------------------


def check_index(checker: Checker, node: ast.IndexNode) -> ir.Expression | None:
    """Check `array[index]`, where the index is a whole number or an angle."""
    array, index = checker.array(node.array), checker.visit(node.index)
    if array is None or index is None:
        return None
    assert isinstance(array.type, Array)
    if is_angle(index.type):
        place = _index_of_bearing(checker, node, array, index)
    elif not isinstance(index.type, Quantity) or index.type.dimension != NUMBER:
        found = with_article(index.type)
        checker.error("E202", node.index, f"an index must be a plain number or an angle, found {found}")
        return None
    else:
        place = _whole_index(checker, node, array.type, index)
    if place is None:
        return None
    span, wraps = checker.span(node), array.type.closes
    return ir.Element(type=array.type.element, array=array, index=place, wraps=wraps, span=span)


def _index_of_bearing(
    checker: Checker, node: ast.IndexNode, array: ir.Expression, angle: ir.Expression
) -> ir.Expression | None:
    bearings = _bearings(checker, node.array, array)
    if bearings is None:
        return None
    value = constant_value(angle)
    if value is None:
        return ir.Nearest(type=DIMENSIONLESS, bearings=bearings, angle=angle, span=angle.span)
    index = nearest(bearings, value)
    if index is None:
        message = f"no element of `{_text(checker, node.array)}` looks along {degrees_text(value)}"
        checker.error("E215", node.index, message, _looks(bearings))
        return None
    return ir.Constant(type=DIMENSIONLESS, value=float(index), span=angle.span)


def _whole_index(
    checker: Checker, node: ast.IndexNode, type_: Array, index: ir.Expression
) -> ir.Expression | None:
    value = constant_value(index)
    if value is None:
        return index
    bearings = type_.bearings
    if not (isfinite(value) and (type_.closes or 0 <= round(value) < type_.size)):
        is_angle_too = isfinite(value) and bearings is not None and nearest(bearings, value) is not None
        angles = _meant(degrees_text(value)) if is_angle_too else None
        _report_outside(checker, node.index, f"index {value:g}", type_, angles)
        return None
    if bearings is not None:
        place = round(value) % type_.size
        angle = bearings.angles[place]
        same = degrees_text(angle) if nearest(bearings, angle) == place else None
        is_inside = 0 <= round(value) < type_.size
        is_angle_too = nearest(bearings, value) is not None
        _note_plain(checker, node, f"looks along {degrees_text(angle)}", same, is_inside, is_angle_too)
    return index


def _report_outside(
    checker: Checker, node: ast.SyntaxNode, what: str, type_: Array, angles: str | None
) -> None:
    """Report what is outside an array; `angles` is a hint for numbers that were meant as degrees."""
    message = f"{what} is outside the array, whose last index is {type_.size - 1}"
    checker.error("E205", node, message, angles or _NO_WRAP)


# --- slices ----------------------------------------------------------------------------------------


def check_slice(checker: Checker, node: ast.SliceOf) -> ir.Expression | None:
    """Check `array[first..last]`, where both ends are constant: whole numbers or angles."""
    array = checker.array(node.array)
    first = checker.constant(node.first, None, "the start of a slice")
    last = checker.constant(node.last, None, "the end of a slice")
    if array is None or first is None or last is None:
        return None
    assert isinstance(array.type, Array)
    by_bearing = is_angle(first.type) or is_angle(last.type)
    indices = (_indices_between if by_bearing else _whole_indices)(checker, node, array)
    if indices is None:
        return None
    bearings = array.type.bearings
    if bearings is not None:
        bearings = part_by_bearing(bearings, indices) if by_bearing else part_by_index(bearings, indices)
    type_ = Array(array.type.element, len(indices), bearings)
    return ir.Slice(type=type_, array=array, indices=indices, span=checker.span(node))


def _whole_indices(checker: Checker, node: ast.SliceOf, array: ir.Expression) -> tuple[int, ...] | None:
    type_ = array.type
    assert isinstance(type_, Array)
    size, far = type_.size, 10**9
    first = checker.whole(node.first, "the start of a slice", -far, far)
    last = checker.whole(node.last, "the end of a slice", -far, far)
    if first is None or last is None:
        return None
    count = last - first + 1 if first <= last else (last - first) % size + 1
    is_inside = count <= size and (type_.closes or (0 <= first < size and 0 <= last < size))
    what = f"the slice from {first} to {last}"
    if not is_inside:
        angles = None
        if type_.bearings is not None and 0 <= last - first <= TURN:
            is_angle_too = bool(between(type_.bearings, float(first), float(last)))
            angles = _meant(f"{degrees_text(first)} .. {degrees_text(last)}") if is_angle_too else None
        _report_outside(checker, node, what, type_, angles)
        return None
    if first > last and not type_.closes:
        message = f"the slice runs from {first} past the end to {last}; only rings that close wrap"
        checker.error("E217", node, message, f"the last index is {size - 1}; {_NO_WRAP}")
        return None
    indices = tuple(i % size for i in range(first, first + count))
    if type_.bearings is not None:
        a, b = (type_.bearings.angles[i] for i in (indices[0], indices[-1]))
        same = [ends for ends in ((a, b), (b, a)) if set(between(type_.bearings, *ends)) == set(indices)]
        written = f"{degrees_text(same[0][0])} .. {degrees_text(same[0][1])}" if same else None
        is_inside = first >= 0 and last < size
        looks = f"looks from {degrees_text(a)} to {degrees_text(b)}"
        is_angle_too = last - first <= TURN and bool(between(type_.bearings, float(first), float(last)))
        _note_plain(checker, node, looks, written, is_inside, is_angle_too)
    return indices


def _indices_between(checker: Checker, node: ast.SliceOf, array: ir.Expression) -> tuple[int, ...] | None:
    bearings = _bearings(checker, node.array, array)
    start = checker.constant(node.first, DEGREES, "the start of a slice by bearing")
    end = checker.constant(node.last, DEGREES, "the end of a slice by bearing")
    if bearings is None or start is None or end is None:
        return None
    assert isinstance(start.value, float)
    assert isinstance(end.value, float)
    first, last = start.value, end.value
    if last - first > TURN:
        checker.error(
            "E215", node, "the slice takes more than a full turn", "a turn is `-180 deg .. 180 deg`"
        )
        return None
    indices = between(bearings, first, last)
    if not indices:
        shown = f"{degrees_text(first)} .. {degrees_text(last)}"
        message = f"no element of `{_text(checker, node.array)}` looks along {shown}"
        checker.error("E215", node, message, _looks(bearings))
        return None
    _warn_about_slice(checker, node, bearings, first, last)
    return indices


def _warn_about_slice(
    checker: Checker, node: ast.SliceOf, bearings: Bearings, first: float, last: float
) -> None:
    findings = checker.report.diagnostics
    width = float(sweep(first, last))
    if first > last and width > TURN / 2:
        message = f"the slice goes through the rear and takes {degrees_text(width)}"
        smaller = f"{degrees_text(last)} .. {degrees_text(first)}"
        hint = f"counterclockwise angles rise: write `{smaller}` for the smaller part"
        findings.append(warning("W013", checker.span(node), message, hint))
    elif reaches_beyond(bearings, first, last):
        message = f"the slice reaches beyond `{_text(checker, node.array)}`"
        findings.append(warning("W012", checker.span(node), message, _looks(bearings)))


# --- bearings --------------------------------------------------------------------------------------


def _bearings(checker: Checker, node: ast.Expression, array: ir.Expression) -> Bearings | None:
    """Return the bearings of an array, or None after reporting that it has none."""
    assert isinstance(array.type, Array)
    if array.type.bearings is None:
        hint = "a sensor has them with `bearing START step ANGLE`; a `window` has none"
        checker.error("E216", node, f"`{_text(checker, node)}` has no bearings", hint)
    return array.type.bearings


def bearings_of(checker: Checker, node: ast.Expression, array: ir.Expression) -> ir.Constant | None:
    """Return the bearings of an array as an array of constants, or None after reporting that it has none."""
    bearings = _bearings(checker, node, array)
    if bearings is None:
        return None
    type_ = Array(DEGREES, len(bearings.angles))
    return ir.Constant(type=type_, value=bearings.angles, span=array.span)


def check_bearings(checker: Checker, node: ast.BearingDecl, size: int | None) -> Bearings | None:
    """Check the bearings of a sensor of `size` elements; None after an error."""
    if size is None:
        hint = "write the number of its elements, as in `sonar[24]`"
        checker.error("E311", node, "only an array has bearings", hint)
        return None
    if node.angles is not None:
        angles = [_angle(checker, angle, "a bearing") for angle in node.angles]
        known = [angle for angle in angles if angle is not None]
        if len(angles) != size:
            checker.error("E311", node, f"the array has {size} elements, found {len(angles)} bearings")
        return listed_bearings(known) if len(known) == size == len(angles) else None
    assert node.first is not None
    start = _angle(checker, node.first, "the first bearing")
    step = None if node.step is None else _angle(checker, node.step, "the step of bearings")
    if start is None or (step is None and node.step is not None):
        return None
    if step == 0:
        equal = ", ".join([degrees_text(start)] * size) if size <= _SHOWN_BEARINGS else "..."
        checker.error("E311", node, "a step of 0 deg", f"list equal bearings: `bearing [{equal}]`")
        return None
    bearings = uniform(start, step, size)
    if bearings is None:
        message = f"{size} elements that are {degrees_text(step or 0)} apart take more than a full turn"
        checker.error("E311", node, message, too_many_hint(step or 0, size))
    return bearings


def _angle(checker: Checker, node: ast.Expression, what: str) -> float | None:
    found = checker.constant(node, DEGREES, what)
    return None if found is None else float(found.value)  # type: ignore[arg-type]


# --- wording ---------------------------------------------------------------------------------------


def _note_plain(
    checker: Checker,
    node: ast.IndexNode | ast.SliceOf,
    looks: str,
    bearing: str | None,
    is_inside: bool,
    is_angle_too: bool,
) -> None:
    """Note where a plain index looks; warn of one that wraps: perhaps an angle without its unit.

    `bearing` is the index or slice that takes the same elements by angle, None if there is none;
    `is_angle_too` is True if there are elements along the numbers as degrees.
    """
    array, span = _text(checker, node.array), checker.span(node)
    if is_inside:
        if checker.in_call:
            return  # other arguments look elsewhere; the declaration has noted what reads no parameter
        message = f"`{_text(checker, node)}` {looks}"
        hint = None if bearing is None else f"write `{array}[{bearing}]`, which means the same on every robot"
        checker.report.diagnostics.append(note("N002", span, message, hint))
        return
    message = f"`{_text(checker, node)}` wraps, and {looks}: a number without a unit is an index"
    ends = (node.index,) if isinstance(node, ast.IndexNode) else (node.first, node.last)
    meant = " .. ".join(f"{_text(checker, end)} deg" for end in ends)
    hints = [f"`{array}[{meant}]` if that is an angle"] if is_angle_too else []
    hints += [] if bearing is None else [f"`{array}[{bearing}]`"]
    hint = f"write {', else '.join(hints)}" if hints else None
    checker.report.diagnostics.append(warning("W014", span, message, hint))


def _meant(angles: str) -> str:
    """Return a hint for numbers outside an array that are bearings of it in degrees."""
    return f"a number without a unit is an index; write `{angles}`"


def _text(checker: Checker, node: ast.SyntaxNode) -> str:
    return one_line(checker.scope.file.source.text[node.start : node.end])


def _looks(bearings: Bearings) -> str:
    """Return a hint that lists the array's bearings."""
    if bearings.closes:
        apart, first = degrees_text(bearings.spacing), degrees_text(bearings.angles[0])
        return f"its bearings are {apart} apart, from {first}"
    if len(bearings.angles) <= _SHOWN_BEARINGS:
        return f"its bearings are {listed([degrees_text(a) for a in bearings.angles])}"
    if bearings.step is not None:
        ends = bearings.ends or (0, -1)
        first, last = (degrees_text(bearings.angles[i]) for i in ends)
        return f"its bearings go from {first} to {last}, {degrees_text(bearings.spacing)} apart"
    shown = ", ".join(degrees_text(a) for a in sorted(bearings.angles)[:_SHOWN_BEARINGS])
    return f"its {len(bearings.angles)} bearings begin with {shown}"


# --- reductions ---------------------------------------------------------------------------------------
#
# Checking of reductions: `function(body for k in low .. high)`, `function(body for r, a in array)`.

MAX_ITERATIONS = 4096

_REDUCTIONS = {function.value: function for function in ir.REDUCTIONS}


def check_comprehension(
    checker: Checker, node: ast.Comprehension | ast.ElementsComprehension
) -> ir.Expression | None:
    """Check a reduction of a body for each value of a variable, or for each element of an array."""
    function = _REDUCTIONS.get(node.function.text)
    if function is None:
        hint = f"the reductions are {', '.join(sorted(_REDUCTIONS))}"
        checker.error("E211", node.function, f"`{node.function.text}` is not a reduction", hint)
        return None
    if isinstance(node, ast.Comprehension):
        rounds = _range_rounds(checker, node)
    else:
        rounds = _array_rounds(checker, node)
    return None if rounds is None else _comprehension(checker, node, function, rounds)


class _Rounds(NamedTuple):
    """The rounds of a reduction: its variable and bounds, what each name in its body is, and its arrays."""

    variable: str
    low: int
    high: int
    names: Mapping[str, ir.LoopIndex | ir.LoopElement]
    arrays: tuple[tuple[str, ir.Expression], ...] = ()


def _range_rounds(checker: Checker, node: ast.Comprehension) -> _Rounds | None:
    """Return the rounds of `for k in low .. high`."""
    low = checker.whole(node.low, "the start of a reduction", -(10**9), 10**9)
    high = checker.whole(node.high, "the end of a reduction", -(10**9), 10**9)
    if low is None or high is None:
        return None
    index = ir.LoopIndex(type=DIMENSIONLESS, name=_unique(checker, node.variable))
    return _Rounds(index.name, low, high, {node.variable.text: index})


def _array_rounds(checker: Checker, node: ast.ElementsComprehension) -> _Rounds | None:
    """Return the rounds of `for r in array`, or of `for r, a in array` with bearings."""
    array = checker.array(node.array)
    if array is None:
        return None
    arrays = [(node.variable, array)]
    if node.bearing is not None:
        bearings = bearings_of(checker, node.array, array)
        if bearings is None:
            return None
        if node.bearing.text == node.variable.text:
            message = f"`{node.bearing.text}` names both the element and its bearing"
            checker.error("E102", node.bearing, message, "choose two names")
            return None
        arrays.append((node.bearing, bearings))
    assert isinstance(array.type, Array)
    named = {name.text: (_unique(checker, name), values) for name, values in arrays}
    return _Rounds(
        named[node.variable.text][0],
        0,
        array.type.size - 1,
        {n: ir.LoopElement(type=element_type(v.type), name=unique) for n, (unique, v) in named.items()},
        tuple(named.values()),
    )


def _unique(checker: Checker, name: ast.NameNode) -> str:
    """Return a name for a variable of a reduction that differs from all around it."""
    reject_reserved_name(checker.report, checker.scope, name)
    taken = checker.taken_names
    unique, count = name.text, len(taken)
    while unique in taken:
        unique, count = f"{name.text}'{count}", count + 1
    return unique


def _comprehension(
    checker: Checker,
    node: ast.Comprehension | ast.ElementsComprehension,
    function: ir.Function,
    rounds: _Rounds,
) -> ir.Expression | None:
    iterations = checker.iterations * max(rounds.high - rounds.low + 1, 1)
    if iterations > MAX_ITERATIONS:
        checker.error("E211", node, f"{iterations} iterations; at most {MAX_ITERATIONS} are allowed")
        return None
    inner = replace(checker, loops={**checker.loops, **rounds.names}, iterations=iterations)
    body = inner.visit(node.body)
    condition = (
        None if node.condition is None else inner.expect(node.condition, BOOL, "the `if` of a reduction")
    )
    if body is None or (condition is None and node.condition is not None):
        return None
    if isinstance(body.type, Array):
        checker.error(
            "E211", node.body, "the body of a reduction must be a scalar", "reduce the array inside it"
        )
        return None
    result = reduction_result(checker, node, node.function, function, [body.type])
    if result is None:
        return None
    return ir.Reduce(
        type=result,
        function=function,
        variable=rounds.variable,
        low=rounds.low,
        high=rounds.high,
        body=body,
        condition=condition,
        arrays=rounds.arrays,
        span=checker.span(node),
    )
