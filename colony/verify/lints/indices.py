"""Lint of computed indices that are not proved to be inside their arrays.

The finding is an error where the element decides what the robot does: in a predicate, a limit or a
transition. There an index outside, whose element is NaN or false, silently decides as if nothing were there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from colony.ir import expression as ir
from colony.ir.expression import Expression, SensorValue, Window, children, subexpressions
from colony.ir.program import Contract, Derived, Let, Machine, Module, Program, State
from colony.ir.types import BOOL, DIMENSIONLESS, Array, Quantity
from colony.ir.walk import all_subexpressions, expressions_of
from colony.text.diagnostics import Diagnostic, Label, Severity
from colony.text.source import Span
from colony.text.wording import counted, degrees_text, one_line, quoted
from colony.verify.claims import FALSE, TRUE, all_of, any_of, binary, constant, value_or
from colony.verify.contracts.prove import ContractProver
from colony.verify.contracts.report import reason_text
from colony.verify.contracts.results import (
    OverReals,
    Proved,
    ProvedInTime,
    Refuted,
    Result,
    Trace,
    Unknown,
)
from colony.verify.contracts.table import seconds
from colony.verify.difference.product import rewrite_expression
from colony.verify.lints.case import Case, is_finite
from colony.verify.lints.proof import OPTIONS, Effort, Finding, FindingRun, frames, replay
from colony.verify.reference.expressions import FrameValues, evaluate
from colony.verify.symbolic.system import Reason, Shape

# --- accesses -----------------------------------------------------------------------------------------
#
# Computed indices of a program, and the claims that they are inside their arrays.
#
# A claim is about every frame in which the owner of the index (a module, a derived value, a transition, ...)
# has all that it reads. Evaluation is strict, so no `if`, `and` or condition of a reduction around an access
# matters. The claim becomes a let of the owner, with memory of its own that advances as the owner's does.

Place = ir.Element | ir.Window

_READING = (
    ir.SensorValue,
    ir.DerivedValue,
    ir.LocalValue,
    ir.StateValue,
    ir.Now,
    ir.RestartedFlag,
    ir.Fresh,
    ir.SentField,
    ir.IsActive,
    ir.IsCommanded,
    ir.IsIdle,
    ir.WonBy,
    ir.MemoryCall,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Access:
    """A computed index of a program.

    Attributes:
        place: the element or window.
        decides: True in a predicate, a limit or a transition.
        owner: the module that has it, if any.
        claim: the claim that it is inside, about the instrumented program.
    """

    place: Place
    decides: bool
    owner: Module | None
    claim: Contract

    @property
    def size(self) -> int:
        """Return the size of the array."""
        return _size(self.place)

    @property
    def angle(self) -> Expression | None:
        """Return the angle of an element that is found by its bearing, else None."""
        match self.place:
            case ir.Element(index=ir.Nearest(angle=angle)):
                return angle
            case _:
                return None

    @property
    def index(self) -> Expression:
        """Return what is computed: an angle, an index, or the center of a window."""
        place = self.place
        return self.angle or (place.index if isinstance(place, ir.Element) else place.center)

    @property
    def is_shown(self) -> bool:
        """Return True if the index can be evaluated after a run: it is in no reduction, and has no memory."""
        hidden = (ir.LoopIndex, ir.LoopElement, ir.MemoryCall)
        return not any(isinstance(e, hidden) for e in ir.subexpressions(self.index))


def accesses(program: Program) -> tuple[Program, tuple[Access, ...]]:
    """Return the computed indices that need a proof, and the program instrumented for their claims."""
    collector = _Collector(program)
    derived = tuple(x for item in program.derived for x in collector.around(item))
    modules = tuple(collector.instrumented(m) if isinstance(m, Module) else m for m in program.modules)
    for limit in program.limits:
        roots = (limit.bound,) if limit.condition is None else (limit.bound, limit.condition)
        for root in roots:
            derived += collector.lets_of(root, decides=True)
    for contract in program.contracts:
        collector.claims_of_contract(contract)
    instrumented = replace(
        program,
        derived=derived,
        modules=modules,
        contracts=tuple(access.claim for access in collector.found),
        tests=(),
    )
    return instrumented, tuple(collector.found)


class _Collector:
    """Collects the computed indices of a program. Mutable: `found` grows."""

    def __init__(self, program: Program) -> None:
        calls = (e for e in all_subexpressions(program) if isinstance(e, ir.MemoryCall))
        self._cells = 1 + max((call.cell for call in calls), default=0)
        self.found: list[Access] = []

    def around(self, item: Derived) -> Iterator[Derived]:
        """Yield a derived value, and before it the lets for what it computes."""
        match item:
            case Let(expression=expression):
                yield from self.lets_of(expression)
            case State(next=update) if update is not None:
                yield from self.lets_of(update)
            case Machine(transitions=transitions):
                for transition in transitions:
                    yield from self.lets_of(transition.condition, decides=True)
            case _:
                pass
        yield item

    def lets_of(self, root: Expression, *, decides: bool = False) -> tuple[Let, ...]:
        """Return the lets for the claims about a file-level expression."""
        lets = []
        for place, claim in self._claims(root):
            let = Let(name=f"index {len(self.found)}", expression=_missing_with(claim, root))
            self._add(place, ir.DerivedValue(type=BOOL, name=let.name), decides=decides)
            lets.append(let)
        return tuple(lets)

    def instrumented(self, module: Module) -> Module:
        """Return a module with lets for the claims about its expressions."""
        lets = list(module.lets)
        for root in expressions_of(module):
            for place, claim in self._claims(root):
                let = Let(name=f"{module.name}. index {len(self.found)}", expression=claim)
                value = ir.LocalValue(type=BOOL, name=let.name)
                self._add(place, value, decides=root is module.when, owner=module)
                lets.append(let)
        return replace(module, lets=tuple(lets))

    def claims_of_contract(self, contract: Contract) -> None:
        """Collect the claims about a contract, which are contracts as they are."""
        for place, claim in self._claims(contract.expression):
            self._add(place, _missing_with(claim, contract.expression))

    def _claims(self, root: Expression) -> Iterator[tuple[Place, Expression]]:
        """Yield the places that need a proof, each with its claim, which has memory of its own."""
        for place, claim in _claims(root):
            if not _holds_always(claim):
                yield place, rewrite_expression(claim, str, self._cells * (len(self.found) + 1))

    def _add(
        self, place: Place, claim: Expression, *, decides: bool = False, owner: Module | None = None
    ) -> None:
        name, span = f"index {len(self.found)}", place.span
        contract = Contract(name=name, expression=value_or(claim, TRUE), span=span)
        self.found.append(Access(place=place, decides=decides, owner=owner, claim=contract))


# --- claims ----------------------------------------------------------------------------------------


def _claims(e: Expression) -> Iterator[tuple[Place, Expression]]:
    """Yield the computed indices of an expression, and the conditions that they are inside."""
    match e:
        case ir.ValueOr(expression=first, other=other):
            parts: Sequence[Expression] = (first,)
            if isinstance(first, ir.Element):  # `other` stands for an element that is outside
                parts = ir.children(first)
            for place, claim in _claims_of(parts):
                yield place, value_or(_missing_with(claim, first), TRUE)
            yield from _claims(other)
        case ir.Reduce(body=body, condition=condition, arrays=arrays):
            yield from _claims_of(array for _, array in arrays)
            for place, claim in _claims_of((body,) if condition is None else (body, condition)):
                yield place, replace(e, type=BOOL, function=ir.Function.ALL, body=claim, condition=None)
        case _:
            if isinstance(e, ir.Element | ir.Window):
                yield e, _is_inside(e)
            yield from _claims_of(ir.children(e))


def _claims_of(expressions: Iterable[Expression]) -> Iterator[tuple[Place, Expression]]:
    for e in expressions:
        yield from _claims(e)


def _is_inside(place: Place) -> Expression:
    """Return the condition that an index, or all that a window takes, is inside."""
    index = place.index if isinstance(place, ir.Element) else place.center
    if place.wraps and not isinstance(index, ir.Nearest):
        return is_finite(index)
    reach = place.reach if isinstance(place, ir.Window) else 0
    whole = ir.FunctionCall(type=DIMENSIONLESS, function=ir.Function.ROUND, arguments=(index,))
    low, high = (constant(float(x), DIMENSIONLESS) for x in (reach, _size(place) - 1 - reach))
    return ir.Within(type=BOOL, operand=whole, low=low, high=high)


def _size(place: Place) -> int:
    assert isinstance(place.array.type, Array)
    return place.array.type.size


def _holds_always(claim: Expression) -> bool:
    """Return True if a claim that reads nothing is true."""
    if any(isinstance(e, _READING) for e in ir.subexpressions(claim)):
        return False
    return evaluate(claim, FrameValues(number=1, t_ns=0, first_ns=0, states={}), {}, ()) is True


def _missing_with(claim: Expression, e: Expression) -> Expression:
    """Return a claim that is missing wherever `e` is, and else has its value."""
    read = [_is_itself(x) for x in _needs(e)]
    return any_of((claim, all_of((FALSE, *read)))) if read else claim


def _needs(e: Expression) -> Iterator[Expression]:
    """Yield what an expression reads that can be missing, each once."""
    match e:
        case ir.ValueOr(other=other):
            yield from _needs(other)
        case ir.SensorValue() | ir.DerivedValue() | ir.LocalValue() | ir.SentField():
            yield e
        case _:
            yield from {x: None for child in ir.children(e) for x in _needs(child)}


def _is_itself(e: Expression) -> Expression:
    if not isinstance(e.type, Array):
        return binary(ir.Binary.EQUAL, e, e)
    equal = ir.BinaryOperation(type=replace(e.type, element=BOOL), operator=ir.Binary.EQUAL, left=e, right=e)
    return ir.FunctionCall(type=BOOL, function=ir.Function.ALL, arguments=(equal,))


# --- indices ------------------------------------------------------------------------------------------


def findings(case: Case, effort: Effort, shapes: dict[str, Shape]) -> Iterator[Finding]:
    """Yield an error or a warning for each computed index that is not proved to be inside.

    `shapes` are those found for the program's memory so far.
    One that is proved only over real numbers gets a note. An index in a function counts once a call.
    """
    instrumented, found = accesses(case.program)
    if not found:
        return
    prover, reported = ContractProver(instrumented, OPTIONS, effort, shapes=shapes), set[tuple[Span, ...]]()
    for access in sorted(found, key=lambda access: not access.decides):
        place = (access.place.span, *_arguments(access.place, access.place.span))
        if place in reported or not effort.allows_question():
            continue
        result = prover.prove_disturbed(access.claim)
        finding = _finding(case, access, result)
        if finding is not None:
            reported.add(place)
            yield finding


def _arguments(e: Expression, body: Span) -> Iterator[Span]:
    """Yield the spans of what a call puts into a place with the span `body`: arguments for parameters."""
    if e.span.source is body.source and body.start <= e.span.start and e.span.end <= body.end:
        for part in children(e):
            yield from _arguments(part, body)
    else:
        yield e.span


def _finding(case: Case, access: Access, result: Result) -> Finding | None:
    """Return the finding about an index, None if it is proved to be inside."""
    match result:
        case Proved():
            return None
        case OverReals(in_time=in_time):
            return _proved_over_reals(case, access, in_time.over_reals)
        case Refuted(trace=trace):
            return _outside(case, access, trace)
        case ProvedInTime(trace=late, python_trace=with_python, because=because):
            run = late or with_python
            return _unproved(case, access, because) if run is None else _outside(case, access, run)
        case Unknown(trace=with_python, because=because):
            return (
                _unproved(case, access, because)
                if with_python is None
                else _outside(case, access, with_python)
            )


def _outside(case: Case, access: Access, trace: Trace) -> Finding:
    """Return the finding of a run in whose last frame an index is outside."""
    shown = _shown(case, access, trace)
    length = counted(len(trace.snapshots), "frame")
    at = f"at {seconds(trace.snapshots[-1].t_ns)} of a run of {length}"
    what = f"{_noun(access)} is {shown} {at}" if shown is not None else f"{_noun(access)} is outside {at}"
    if access.angle is not None:
        message = f"`{_text(access)}` can look where there is no element: {what}"
    elif access.place.wraps:
        message = f"`{_text(access)}` can have an index that is not finite: {what}"
    else:
        message = f"`{_text(access)}` can be outside the array: {what}, the last index {access.size - 1}"
    found = Trace(
        snapshots=trace.snapshots,
        outcomes=replay(case.program, trace.snapshots),
        needed_missing=trace.needed_missing,
        could_change=trace.could_change,
        found=() if shown is None else (f"{_noun(access)} of {_text(access)}: {shown}",),
    )
    actuator = None if access.owner is None else access.owner.actuator
    return Finding(_diagnostic(case, access, message), FindingRun(_text(access), actuator, found))


def _unproved(case: Case, access: Access, because: tuple[str, ...]) -> Finding:
    reasons = "; ".join(line.strip() for line in because)
    message = f"`{_text(access)}` is not proved to be inside the array: {reasons}"
    return Finding(_diagnostic(case, access, message))


def _proved_over_reals(case: Case, access: Access, reasons: tuple[Reason, ...]) -> Finding:
    """Return the note that a proof takes floats as real numbers."""
    because = "; ".join(dict.fromkeys(map(reason_text, reasons)))
    message = f"`{_text(access)}` is proved to be inside the array only over real numbers: {because}"
    return Finding(replace(_diagnostic(case, access, message), severity="note"))


def _shown(case: Case, access: Access, trace: Trace) -> str | None:
    """Return the index in the last frame of a run, None if the interpreter cannot give it."""
    if not access.is_shown:
        return None
    *_, (_, interpreter) = frames(case.program, trace.snapshots)
    value = interpreter.value_of(access.index)
    if not isinstance(value, float):
        return None
    return f"{value:.10g}" if access.angle is None else degrees_text(value)


def _noun(access: Access) -> str:
    if access.angle is not None:
        return "the angle"
    return "the center" if isinstance(access.place, Window) else "the index"


def _text(access: Access) -> str:
    return one_line(access.place.span.text)


def _diagnostic(case: Case, access: Access, message: str) -> Diagnostic:
    severity: Severity = "error" if access.decides else "warning"
    span, hint = access.place.span, _hint(case, access)
    labels = tuple(Label(s, "together with this") for s in dict.fromkeys(_arguments(access.place, span)))
    return Diagnostic(code="V036", span=span, message=message, hint=hint, severity=severity, labels=labels)


def _hint(case: Case, access: Access) -> str:
    """Return how to keep the index inside, or say what stands for an element that is outside."""
    unbounded = [] if isinstance(access.place, Window) else list(_without_range(case, access))
    ranges = f"; or give {quoted(unbounded)} a range" if unbounded else ""
    return f"{_inside_or_else(access)}{ranges}"


def _without_range(case: Case, access: Access) -> Iterator[str]:
    """Yield the scalar sensors that an index reads itself and that have no range."""
    read = {e.name for e in subexpressions(access.index) if isinstance(e, SensorValue)}
    for sensor in case.program.robot.sensors:
        is_scalar = sensor.sent is None and isinstance(sensor.type, Quantity)
        if sensor.name in read and is_scalar and sensor.low is None and sensor.high is None:
            yield sensor.name


def _inside_or_else(access: Access) -> str:
    text, index = _text(access), one_line(access.index.span.text)
    last = access.size - 1
    if isinstance(access.place, Window):
        if access.place.wraps:
            return "bound what the center reads, so that it is finite"
        reach = access.place.reach
        return f"keep the center inside, as in `clamp({index}, {reach}, {last - reach})`"
    or_else = f"say what stands for an element outside: `value_or({text}, ...)`"
    if access.angle is not None or access.place.wraps:
        return or_else
    return f"{or_else}; or keep the index inside, as in `clamp({index}, 0, {last})`"
