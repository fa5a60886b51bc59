"""Lint of contracts that constrain nothing: what they are about never happens."""

from __future__ import annotations

from collections.abc import Iterator, Set

from colony.ir import expression as ir
from colony.ir.expression import Expression
from colony.ir.program import Contract, Module
from colony.ir.walk import WiringNode, expressions_of
from colony.text.diagnostics import Diagnostic, note, warning
from colony.text.wording import duration_text, quoted
from colony.verify.claims import active, all_of, any_of, negation, source_text, won
from colony.verify.contracts.results import with_reaches
from colony.verify.lints.case import Case, span_of
from colony.verify.lints.proof import LintProver, asked
from colony.verify.testing.frames import sensors_read

# --- never blind ---------------------------------------------------------------------------------------
#
# Lint of failsafe modules that missing sensors do not make blind.


def never_blind_findings(case: Case) -> Iterator[Diagnostic]:
    """Yield a note for each failsafe module that is never blind, or only where a server has no value at all.

    A reading grows too old only by its sensor's `within`. A module in Python is blind also without an answer,
    so nothing is said of it.
    """
    sensors = {s.name: s for s in case.program.robot.sensors}
    for name, module in case.own_modules.items():
        needed = sorted(case.contents.needs(module))
        if not module.failsafe or any(sensors[s].within_ns is not None for s in needed):
            continue
        if needed:
            names, has, its = quoted(needed), *(("has", "its") if len(needed) == 1 else ("have", "their"))
            message = (
                f"`{name}` is failsafe, but goes blind only where {names} {has} no value at all: "
                f"{its} readings never get too old"
            )
            hint = f"declare {names} with a `within`"
        else:
            message = f"`{name}` is failsafe, but never goes blind: nothing that it needs can be missing"
            hint = _hint(case, module)
        yield note("V032", module.span, message, hint)


def _hint(case: Case, module: Module) -> str:
    """Return advice on a module that needs no sensor."""
    with_default = {s.name for s in case.program.robot.sensors if s.default is not None}
    read = {x.name for x in case.reads(*expressions_of(module)) if isinstance(x, ir.SensorValue)}
    names = sorted(with_default & read)
    if not names:
        return "remove `failsafe`"
    has = "has a default, which stands" if len(names) == 1 else "have defaults, which stand"
    advice = f"ask `fresh({names[0]})`, or remove `failsafe`"
    return f"{quoted(names)} {has} in for a missing reading: {advice}"


# --- unused --------------------------------------------------------------------------------------------
#
# Lint of sensors that nothing reads.


def unused_findings(case: Case) -> Iterator[Diagnostic]:
    """Yield the warnings about unused sensors of the main file; an imported robot may have unused ones."""
    read = sensors_read(with_reaches(case.program))
    for sensor in case.program.robot.sensors:
        if case.is_own(sensor.span) and sensor.name not in read:
            yield warning(
                "V028",
                sensor.span,
                f"nothing reads the sensor `{sensor.name}`",
                "remove it, or use it",
            )


# --- pauses --------------------------------------------------------------------------------------------
#
# Lint of time constants within a dominant side, which hold back only their own inferior side.


def _name(inner: WiringNode, outer: WiringNode) -> str:
    return f"pause {inner.name} {outer.name}"


def _pairs(case: Case) -> Iterator[tuple[WiringNode, WiringNode]]:
    """Yield the inner and the outer node of each `(A suppresses[T] B) suppresses C`."""
    for outer in case.network.nodes.values():
        inner = case.network.nodes.get(outer.dominant)
        if inner is None or not inner.window_ns or not case.is_own(span_of(outer)):
            continue
        if inner.relation == outer.relation == "suppresses":
            yield inner, outer


def _claim(case: Case, inner: WiringNode, outer: WiringNode) -> Expression:
    """Return the claim that no inferior of the outer node wins while the inner one holds back its own."""
    below = [
        won(actuator, module)
        for actuator, root in case.network.roots.items()
        for module in case.network.modules_under(outer.inferior)
        if case.network.is_under(module, root) and not case.network.is_under(module, inner.name)
    ]
    held_back = (active(inner.inferior), negation(active(inner.dominant)), negation(active(inner.name)))
    return negation(all_of((*held_back, any_of(below))))


def pauses_findings(case: Case, prover: LintProver) -> Iterator[Diagnostic]:
    """Yield the warnings about pauses that let other modules through."""
    for inner, outer in _pairs(case):
        if prover.refuted(asked(_name(inner, outer), _claim(case, inner, outer))) is None:
            continue
        first, held_back, passing = (
            quoted(case.network.modules_under(ref))
            for ref in (inner.dominant, inner.inferior, outer.inferior)
        )
        is_plural = len(case.network.modules_under(inner.inferior)) > 1
        is_, dominates = ("are", "they dominate") if is_plural else ("is", "it dominates")
        time = duration_text(inner.window_ns)
        yield warning(
            "V031",
            span_of(outer),
            f"within {time} after {first}, {held_back} {is_} held back, and {passing}, which {dominates}, "
            "gets through",
            f"put the time constant where it holds all of them back: `A suppresses[{time}] (B suppresses C)`",
        )


# --- contracts -----------------------------------------------------------------------------------------


def _vacuous(contract: Contract) -> str:
    return f"vacuous {contract.name}"


def claims(case: Case) -> Iterator[tuple[str, Expression]]:
    """Yield the claims that the left side of a contract's `implies` is never true."""
    for contract in case.program.contracts:
        if not case.is_own(contract.span):
            continue
        left = premise(contract.expression)
        if left is not None:
            yield _vacuous(contract), negation(left)


def premise(e: Expression) -> Expression | None:
    """Return the left side of an `implies`, None of anything else."""
    match e:
        case ir.BinaryOperation(operator=ir.Binary.IMPLIES, left=left):
            return left
        case _:
            return None


def findings(case: Case, proved: Set[str]) -> Iterator[Diagnostic]:
    """Yield the warnings about contracts that constrain nothing."""
    for contract in case.program.contracts:
        if _vacuous(contract) in proved and (left := premise(contract.expression)) is not None:
            yield warning(
                "V027",
                left.span,
                f"contract `{contract.name}` is vacuous: the left side of its `implies`, "
                f"`{source_text(left)}`, is never true",
                "correct the condition: as written, the contract holds whatever the robot does",
            )
