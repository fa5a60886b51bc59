"""Lint of commands that can leave the range of an actuator's field."""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression
from colony.ir.frame import Record
from colony.ir.program import ActuatorField, Module
from colony.ir.types import ScalarValue
from colony.text.diagnostics import Diagnostic, warning
from colony.verify.claims import FALSE, any_of, binary, constant, implies, negation, value_or, won
from colony.verify.lints.case import Case, command_of, value_text
from colony.verify.lints.proof import Prover, asked, frames
from colony.verify.reference.boundary import clamp


def _name(module: Module, field: ActuatorField) -> str:
    return f"range {module.name} {field.name}"


def _fields(case: Case) -> Iterator[tuple[Module, str, int, ActuatorField]]:
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


def findings(case: Case, prover: Prover) -> Iterator[Diagnostic]:
    """Yield a warning for each field that the interpreter clamps in some run."""
    for module, actuator, i, field in _fields(case):
        trace = prover.refuted(asked(_name(module, field), _claim(module, actuator, i, field)))
        clamped = Record("command clamped", f"{actuator}.{field.name}")
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
