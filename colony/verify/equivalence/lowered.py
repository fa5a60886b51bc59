"""Formulas of the guards in lowered code (`colony.execute.code`), which the executor runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from colony.compile.guards import ClientList
from colony.compile.lower.lower import lower
from colony.execute.code import ActuatorCode, Apply, Code, FrameTime, Literal, Lost, OldCell, Table
from colony.execute.compiled import Compiled
from colony.execute.needs import loss_aware_view, unsimplified_view, whole_view
from colony.execute.operators import Operator
from colony.ir.program import Program
from colony.verify.equivalence.circuit import FALSE, TRUE, Circuit, Opaque
from colony.verify.equivalence.forms import (
    Form,
    Timer,
    TimerClasses,
    WinnerFormulas,
    module_of,
    with_activities,
)

LOWERED = "lowered code"


def views(sent: Compiled) -> Iterator[Code]:
    """Yield the code of all clients, and its views with loss-aware or unsimplified guards, if different."""
    yield whole_view(sent.code)
    clients = [client for actuator in sent.code.actuators for client in actuator.clients]
    if any((c.loss_aware_guard, c.loss_aware_exclusive) != (c.guard, c.exclusive) for c in clients):
        yield loss_aware_view(sent.code)
    if any(c.unsimplified != c.guard for c in clients):
        yield unsimplified_view(sent.code)


def read_lowered(program: Program, clients: ClientList, code: Code, timer_classes: TimerClasses) -> Form:
    """Read the form from the code of all clients of a program."""
    circuit = Circuit()
    values = _Values(circuit, {})
    literals = values.literals(code, timer_classes)
    with_contracts = whole_view(lower(with_activities(program), clients).code)
    contract_literals = values.literals(with_contracts, timer_classes)
    activity = {
        module: contract_literals[contract.holds]
        for contract in with_contracts.contracts
        if (module := module_of(contract.name)) is not None
    }
    return Form(
        name=LOWERED,
        circuit=circuit,
        winners={a.actuator.name: _winners(a, circuit, literals) for a in code.actuators},
        timers=tuple(_timers(code, circuit, literals, timer_classes)),
        activity=activity,
    )


def _winners(actuator: ActuatorCode, circuit: Circuit, literals: Sequence[int]) -> tuple[WinnerFormulas, ...]:
    """Return the winners by the executor's rules: the first true guard, or the true exclusive guard."""
    winners, above = [], FALSE
    for client in actuator.clients:
        guard = literals[client.guard]
        wins = circuit.both(guard, above ^ 1)
        winners.append(
            WinnerFormulas(module=client.module, by_priority=wins, by_exclusive=literals[client.exclusive])
        )
        above = circuit.either(above, guard)
    return tuple(winners)


def _timers(
    code: Code, circuit: Circuit, literals: Sequence[int], timer_classes: TimerClasses
) -> list[Timer]:
    """Return the cells that hold the end of a time constant: initially 0, then a window after now."""
    timers = []
    for cell in code.cells:
        value = code.ops[cell.value]
        if not isinstance(value, Apply) or value.operator is not Operator.TIME_ADD or cell.initial != 0:
            continue
        now, window = (code.ops[i] for i in value.arguments)
        if isinstance(now, FrameTime) and isinstance(window, Literal) and isinstance(window.value, int):
            history = _history(circuit, cell.name, timer_classes)
            timer = Timer(
                cell=cell.name, operand=literals[cell.condition], window_ns=window.value, history=history
            )
            timers.append(timer)
    return timers


def _history(circuit: Circuit, cell: str, timer_classes: TimerClasses) -> int:
    """Return the condition that the current time is before the time in the cell."""
    same = timer_classes.get(cell, cell)
    return FALSE if same is None else circuit.input(Opaque(f"time is before {same}"))


class _Values:
    """Ops as formulas; equal opaque ops share one input across all code. Mutable."""

    def __init__(self, circuit: Circuit, numbers: dict[object, int]) -> None:
        self._circuit = circuit
        self._numbers = numbers  # by content of the op

    def literals(self, code: Code, timer_classes: TimerClasses) -> Sequence[int]:
        """Return each op's formula; for ops that are not bools, an opaque input."""
        identities: list[int] = []
        literals: list[int] = []
        for op in code.ops:
            key: object = op
            match op:
                case Apply(operator=operator, arguments=arguments):
                    key = (operator, tuple(identities[i] for i in arguments))
                case Table(elements=elements):
                    key = tuple(identities[i] for i in elements)
                case OldCell(cell=cell):
                    key = ("cell", code.cells[cell].name)
                case Literal(value=value):
                    key = (type(value).__name__, repr(value))
                case _:
                    pass
            identities.append(self._numbers.setdefault(key, len(self._numbers)))
            literals.append(self._literal(code, len(identities) - 1, identities[-1], literals, timer_classes))
        return literals

    def _literal(
        self, code: Code, index: int, identity: int, literals: Sequence[int], timer_classes: TimerClasses
    ) -> int:
        circuit, op = self._circuit, code.ops[index]
        match op:
            case Literal(value=bool() as value):
                return TRUE if value else FALSE
            case Lost():
                return FALSE
            case Apply(operator=Operator.NOT, arguments=(operand,)):
                return literals[operand] ^ 1
            case Apply(operator=Operator.AND, arguments=operands):
                return circuit.all([literals[i] for i in operands])
            case Apply(operator=Operator.OR, arguments=operands):
                return circuit.any([literals[i] for i in operands])
            case Apply(operator=Operator.TIME_LESS, arguments=(now, end)) if isinstance(
                code.ops[now], FrameTime
            ) and isinstance(cell := code.ops[end], OldCell):
                return _history(circuit, code.cells[cell.cell].name, timer_classes)
            case _:
                return circuit.input(Opaque(f"value {identity}"))
