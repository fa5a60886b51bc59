"""Lints of limits: bounds that contradict each other, and bounds that exclude the idle command's value.

The bounds of a field are those of its range and of all limits that apply. Both findings come with a run in
which a module wins: nothing is limited otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression
from colony.ir.frame import FrameEvent
from colony.ir.program import Actuator, ActuatorField, AnyModule, Limit, Module, PythonModule
from colony.ir.types import Quantity, ScalarValue, is_rate
from colony.text.diagnostics import Diagnostic, Label, Severity, warning
from colony.text.source import Span
from colony.text.wording import counted
from colony.verify.claims import (
    FALSE,
    all_of,
    any_of,
    binary,
    constant,
    fresh,
    implies,
    negation,
    value_or,
    won,
)
from colony.verify.contracts.results import Trace
from colony.verify.contracts.table import seconds
from colony.verify.lints.case import (
    Case,
    FieldBound,
    all_bounds,
    all_known,
    command_of,
    contradiction,
    exclusion,
    is_finite,
    value_text,
)
from colony.verify.lints.proof import Finding, FindingRun, LintProver, asked, frames, replay, undecided
from colony.verify.reference.boundary import clamp

# --- ranges --------------------------------------------------------------------------------------------
#
# Lint of commands that can leave the range of an actuator's field.


def _name(module: Module, field: ActuatorField) -> str:
    return f"range {module.name} {field.name}"


def _ranges_fields(case: Case) -> Iterator[tuple[Module, str, int, ActuatorField]]:
    for module in case.own_modules.values():
        if module.command is not None and module.actuator is not None:
            for i, field in enumerate(case.actuators[module.actuator].fields):
                if _may_leave_range(module, i, field):
                    yield module, module.actuator, i, field


def _may_leave_range(module: Module, i: int, field: ActuatorField) -> bool:
    """Return True if a field has a range, and its command is not a constant within it."""
    if field.low is None and field.high is None:
        return False
    e = module.command.fields[i] if module.command else None
    if not isinstance(e, ir.Constant):
        return True
    return clamp(e.value, field.low, field.high) != e.value if isinstance(e.value, float) else False


def _claim(module: Module, actuator: str, i: int, field: ActuatorField) -> Expression:
    """Return the claim that a field of a module's command is within its range when the module wins."""
    value = command_of(module, i)
    outside = []
    if field.low is not None:
        outside.append(binary(Binary.LESS, value, constant(field.low, field.type)))
    if field.high is not None:
        outside.append(binary(Binary.GREATER, value, constant(field.high, field.type)))
    return implies(won(actuator, module.name), negation(value_or(any_of(outside), FALSE)))


def ranges_findings(case: Case, prover: LintProver) -> Iterator[Diagnostic]:
    """Yield a warning for each field that the interpreter clamps in some run."""
    for module, actuator, i, field in _ranges_fields(case):
        trace = prover.refuted(asked(_name(module, field), _claim(module, actuator, i, field)))
        clamped = FrameEvent("command clamped", f"{actuator}.{field.name}")
        if trace is None or clamped not in trace.outcomes[-1].records:
            continue
        *_, (_, interpreter) = frames(case.instrumented, trace.snapshots)
        value = interpreter.value_of(command_of(module, i))
        assert isinstance(value, float)
        assert module.command is not None
        yield _warning(module.name, actuator, field, value, module.command.fields[i])


def _warning(module: str, actuator: str, field: ActuatorField, value: float, e: ir.Expression) -> Diagnostic:
    low, high = (_text(x, field) for x in (field.low, field.high))
    if field.low is not None and field.high is not None:
        bounds, remedy = f"its range is {low} .. {high}", f"`clamp(..., {low}, {high})`"
    elif field.high is not None:
        bounds, remedy = f"its maximum is {high}", f"`min(..., {high})`"
    else:
        bounds, remedy = f"its minimum is {low}", f"`max(..., {low})`"
    return warning(
        "V025",
        e.span,
        f"`{module}` can command {actuator}.{field.name} = {_text(value, field)}, which is clamped: {bounds}",
        f"write {remedy} if that is intended; otherwise correct the command or the range",
    )


def _text(x: ScalarValue | None, field: ActuatorField) -> str:
    """Return a value in the declared unit."""
    return "" if x is None else value_text(x, field)


# --- limits --------------------------------------------------------------------------------------------


_UNDECIDED_HINT = "give a `range` to what the limits read, or bound it by `min` and `max`"


class _Field(NamedTuple):
    """A field that limits bound: field `i` of `actuator`."""

    actuator: Actuator
    i: int
    bounds: tuple[FieldBound, ...]

    @property
    def name(self) -> str:
        return f"{self.actuator.name}.{self.actuator.fields[self.i].name}"

    @property
    def contradiction_claim(self) -> str:
        return f"contradict {self.name}"

    @property
    def exclusion_claim(self) -> str:
        return f"exclude {self.name}"

    @property
    def first_limit(self) -> Limit:
        return next(b.limit for b in self.bounds if b.limit is not None)

    def text(self, x: float) -> str:
        return value_text(x, self.actuator.fields[self.i])


def _fields(case: Case) -> Iterator[_Field]:
    for actuator in case.program.robot.actuators:
        if actuator.name in case.network.roots:
            for i in range(len(actuator.fields)):
                bounds = all_bounds(case.program, actuator, i)
                if any(b.limit is not None for b in bounds):
                    yield _Field(actuator, i, bounds)


def _claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that a field's bounds never contradict, or exclude idle's value, in a module's way."""
    for field in _fields(case):
        contradicts = contradiction(field.bounds)
        if contradicts is not FALSE:
            known = all_known(
                [
                    b
                    for i in range(len(field.actuator.fields))
                    for b in all_bounds(case.program, field.actuator, i)
                ]
            )
            broken = all_of((_commanded(case, field.actuator), known, contradicts))
            yield field.contradiction_claim, negation(broken)
        if field.actuator.idle is not None:
            idle = float(field.actuator.idle[field.i])
            excludes = exclusion(field.bounds, idle, field.actuator.fields[field.i])
            if excludes is not FALSE:
                sent = (_commanded(case, field.actuator), negation(contradicts), excludes)
                yield field.exclusion_claim, negation(all_of(sent))


def _commanded(case: Case, actuator: Actuator) -> Expression:
    """Return the condition that a module wins the actuator with a finite command."""
    modules = {m.name: m for m in case.program.modules}
    reached = (modules[name] for name in case.network.modules_under(case.network.roots[actuator.name]))
    return any_of(all_of((won(actuator.name, m.name), *_has_command(case, m))) for m in reached)


def _has_command(case: Case, module: AnyModule) -> Iterator[Expression]:
    """Yield the conditions that a module that wins is not blind and has a finite command."""
    if isinstance(module, PythonModule) or module.command is None:
        return
    if module.failsafe:
        yield from (fresh(s) for s in sorted(case.contents.needs(module)))
    for i, field in enumerate(module.command.fields):
        if isinstance(field.type, Quantity) and not isinstance(field, ir.Constant):
            yield value_or(is_finite(command_of(module, i)), FALSE)


def findings(case: Case, prover: LintProver) -> Iterator[Finding]:
    """Yield the findings, each with its run, and what is undecided."""
    claims = dict(_claims(case))
    for field in _fields(case):
        for claim, found, what in (
            (field.contradiction_claim, _contradiction, "contradict each other"),
            (field.exclusion_claim, _exclusion, "exclude the idle command's value"),
        ):
            trace = prover.refuted(asked(claim, claims[claim])) if claim in claims else None
            if trace is not None:
                yield from found(case, field, trace)
            elif prover.is_undecided(claim):
                question = f"limits of `{field.name}` can {what}"
                yield Finding(undecided(field.first_limit.span, question, _UNDECIDED_HINT))


def _contradiction(case: Case, field: _Field, trace: Trace) -> Iterator[Finding]:
    """Yield the finding if the bounds contradict each other in the last frame, and the program says so."""
    outcomes = replay(case.program, trace.snapshots)
    (low, lower), (high, upper) = _tightest(case, field, trace)
    decision = next(d for d in outcomes[-1].decisions if d.actuator == field.actuator.name)
    if decision.fault != "limits contradict" or low <= high:
        return
    bounds = f"at least {field.text(low)}, at most {field.text(high)}"
    is_hold = field.actuator.idle is None
    sent = "nothing is sent" if is_hold else "the idle command is sent"
    message = f"the limits of `{field.name}` contradict each other {_at(trace)}: {bounds}; {sent}"
    hint = "change a bound, or add a `when`, so that the lower bound never exceeds the upper one"
    spans = [b.limit.span for b in (lower, upper) if b.limit is not None]
    diagnostic = _diagnostic("V033", "error" if is_hold else "warning", spans, message, hint)
    found = Trace(
        snapshots=trace.snapshots,
        outcomes=outcomes,
        needed_missing=trace.needed_missing,
        could_change=trace.could_change,
        found=(f"{field.name}: {bounds}",),
    )
    yield Finding(diagnostic, FindingRun(field.name, field.actuator.name, found))


def _exclusion(case: Case, field: _Field, trace: Trace) -> Iterator[Finding]:
    """Yield the finding, with the nearest value to idle's that the bounds let through."""
    assert field.actuator.idle is not None
    idle = float(field.actuator.idle[field.i])
    (low, lower), (high, upper) = _tightest(case, field, trace)
    if low <= idle <= high or low > high:
        return
    nearest, bound, what = (low, lower, "at least") if idle < low else (high, upper, "at most")
    outcomes = replay(case.program, trace.snapshots)
    message = (
        f"`{field.name}` is {what} {field.text(nearest)} {_at(trace)}: a module that commands "
        f"{field.text(idle)}, as the idle command does, gets {field.text(nearest)} instead"
    )
    kind = field.actuator.fields[field.i].type
    cure = (
        "add a `when` that is false where a module may stop" if is_rate(kind) else "idle at a value within it"
    )
    hint = f"let {field.text(idle)} through, or {cure}"
    spans = [b.limit.span for b in (bound,) if b.limit is not None]
    found = Trace(
        snapshots=trace.snapshots,
        outcomes=outcomes,
        needed_missing=trace.needed_missing,
        could_change=trace.could_change,
        found=(f"{field.name}: {what} {field.text(nearest)}",),
    )
    diagnostic = _diagnostic("V034", "warning", spans, message, hint)
    yield Finding(diagnostic, FindingRun(field.name, field.actuator.name, found))


def _tightest(
    case: Case, field: _Field, trace: Trace
) -> tuple[tuple[float, FieldBound], tuple[float, FieldBound]]:
    """Return the greatest lower and the least upper bound in the last frame of a run, each with its value.

    A side without bounds is infinite, and has the bound of the other side.
    """
    *_, (_, interpreter) = frames(case.instrumented, trace.snapshots)
    applying = [
        (float(value), b)
        for b in field.bounds
        if interpreter.value_of(b.applies) and isinstance(value := interpreter.value_of(b.value), float)
    ]
    lower = [x for x in applying if not x[1].is_upper]
    upper = [x for x in applying if x[1].is_upper]
    low = max(lower, key=lambda x: x[0]) if lower else (float("-inf"), upper[0][1])
    high = min(upper, key=lambda x: x[0]) if upper else (float("inf"), lower[0][1])
    return low, high


def _at(trace: Trace) -> str:
    length = counted(len(trace.snapshots), "frame")
    return f"at {seconds(trace.snapshots[-1].t_ns)} of a run of {length}"


def _diagnostic(code: str, severity: Severity, spans: list[Span], message: str, hint: str) -> Diagnostic:
    first, *others = spans
    labels = tuple(Label(span, "the other limit") for span in others)
    return Diagnostic(code=code, span=first, message=message, hint=hint, severity=severity, labels=labels)
