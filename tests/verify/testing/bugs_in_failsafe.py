"""Mistakes that failsafe modules and transitions invite."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from colony.compile.lower.declarations import Declarations
from colony.execute import decisions as executor_decisions
from colony.execute import executor, python_step
from colony.execute.code import Apply, ClientCode, Code, Kind, Literal
from colony.execute.decisions import ActuatorDecision
from colony.execute.operators import Operator
from colony.execute.settle import settle
from colony.ir import expression as ir
from colony.ir.program import Machine, Transition
from colony.ir.types import BOOL
from tests.verify.testing.bugs_in_code import added
from tests.verify.testing.bugs_in_passes import Plant

# --- modules -------------------------------------------------------------------------------------


def failsafe_clients(code: Code) -> Iterator[ClientCode]:
    """The clients that can be blind."""
    for actuator in code.actuators:
        for client in actuator.clients:
            if not isinstance(code.ops[client.known], Literal):
                yield client


def active_when_not_blind(code: Code, client: ClientCode) -> int | None:
    """The op that is the activity of a failsafe client without that of its blindness."""
    active, known = code.ops[client.active], code.ops[client.known]
    if not isinstance(active, Apply) or active.operator is not Operator.OR:
        return None
    for argument in active.arguments:
        is_blind = code.ops[argument] == Apply(Operator.NOT, (client.known,))
        if is_blind or (isinstance(known, Apply) and known.arguments == (argument,)):
            return next(other for other in active.arguments if other != argument)
    return None


def not_active_when_blind(given: Code) -> Code:
    """What a blind module dominates gets through, and nobody is blind."""
    ops = list(given.ops)
    for client in failsafe_clients(given):
        without = active_when_not_blind(given, client)
        if without is not None:
            ops[client.active] = Apply(Operator.AND, (without, without))
    return replace(given, ops=tuple(ops))


def moved_while_blind(given: Code) -> Code:
    """The memory of a blind module moves on, from placeholders."""
    given, always = added(given, Literal(True), Kind.BOOL)
    present = {client.module: client.present for client in failsafe_clients(given)}
    cells = []
    for cell in given.cells:
        module = re.split(r"[. ]", cell.name)[0]
        if cell.kind is not Kind.TIME and cell.condition == present.get(module):
            cell = replace(cell, condition=always)
        cells.append(cell)
    return replace(given, cells=tuple(cells))


def no_activity_when_blind(given: Code) -> Code:
    """The time constants of a failsafe module begin where it was active last without being blind."""
    without = {client.active: active_when_not_blind(given, client) for client in failsafe_clients(given)}
    cells = []
    for cell in given.cells:
        condition = without.get(cell.condition)
        if cell.kind is Kind.TIME and condition is not None:
            cell = replace(cell, condition=condition)
        cells.append(cell)
    return replace(given, cells=tuple(cells))


def placeholders_sent(given: Code) -> Code:
    """A blind winner sends what its transfer function makes of placeholders."""
    given, always = added(given, Literal(True), Kind.BOOL)
    actuators = tuple(
        replace(a, clients=tuple(replace(c, known=always) for c in a.clients)) for a in given.actuators
    )
    return replace(given, actuators=actuators)


def decisions(change: Callable[[Any, ActuatorDecision, list[Any]], ActuatorDecision]) -> Plant:
    """`change` what is decided for an actuator whose winner is blind."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        def decide(actuator: Any, winner: Any, values: list[Any]) -> ActuatorDecision:
            decision = executor_decisions.decide(actuator, winner, values)
            return change(actuator, decision, values) if decision.fault == "missing" else decision

        monkeypatch.setattr(executor, "decide", decide)

    return plant


def nobody_wins(actuator: Any, decision: ActuatorDecision, values: list[Any]) -> ActuatorDecision:
    """The idle command of a blind winner counts as nobody's."""
    return decision._replace(by=None, fault=None, records=())


def limits_hold(actuator: Any, decision: ActuatorDecision, values: list[Any]) -> ActuatorDecision:
    """The idle command of a blind winner is limited."""
    if decision.sent is None or decision.by is None:
        return decision
    limits = tuple(
        (limit.field_index, limit.relation == "<=", values[limit.bound] if values[limit.known] else None)
        for limit in actuator.limits
        if values[limit.applies]
    )
    fields = executor_decisions.field_bounds(actuator.actuator)
    settled = settle(actuator.actuator.name, decision.by, decision.sent, fields, limits, decision.sent, ())
    return decision._replace(sent=settled[1])


# --- transitions ---------------------------------------------------------------------------------


def machines(change: Callable[[Transition], Transition]) -> Plant:
    """`change` each transition before it is lowered."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = Declarations._machine

        def lowered(self: Declarations, machine: Machine) -> None:
            original(self, replace(machine, transitions=tuple(map(change, machine.transitions))))

        monkeypatch.setattr(Declarations, "_machine", lowered)

    return plant


def otherwise(transition: Transition, value: bool) -> Transition:
    """The transition with this value in place of a condition that reads something missing."""
    other = ir.Constant(type=BOOL, value=value)
    return replace(transition, condition=ir.ValueOr(type=BOOL, expression=transition.condition, other=other))


def passed_over(transition: Transition) -> Transition:
    """A transition that reads something missing counts as false: those below it are taken."""
    return transition if transition.failsafe else otherwise(transition, False)


def as_ordinary(transition: Transition) -> Transition:
    """A failsafe transition that reads something missing is not taken."""
    return otherwise(transition, False) if transition.failsafe else transition


def kept_by_those_above(transition: Transition) -> Transition:
    """A failsafe transition is not taken below one that reads something missing."""
    return replace(otherwise(transition, True), failsafe=False) if transition.failsafe else transition


# --- modules in Python ---------------------------------------------------------------------------


def error_is_not_applicable(monkeypatch: pytest.MonkeyPatch) -> None:
    """A call that failed is an answer: not applicable."""
    original = python_step.PythonStep._call

    def call(self: Any, *args: Any) -> Any:
        answer, records = original(self, *args)
        return (None if answer is False else answer), records

    monkeypatch.setattr(python_step.PythonStep, "_call", call)


def first_answer_is_not_applicable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Before the first answer a module is not applicable."""
    original = python_step.PythonStep.__init__

    def init(self: Any, *args: Any) -> None:
        original(self, *args)
        self.standing = None

    monkeypatch.setattr(python_step.PythonStep, "__init__", init)


# --- generated Python ----------------------------------------------------------------------------


def without_blindness(source: str) -> str:
    """Generated Python that sends a blind winner's placeholders."""
    return re.sub(r"elif (\w+_blind):", r"elif \1 and False:", source)
