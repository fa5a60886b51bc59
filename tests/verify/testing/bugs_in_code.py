"""Mistakes in the code that clients execute, in what executes it, and in generated Python."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import pytest

from colony.execute import decisions as executor_decisions
from colony.execute import executor, python_step
from colony.execute import machine as executor_machine
from colony.execute.code import Apply, Code, Kind, Literal, Op, SensorFresh
from colony.execute.operators import FUNCTIONS, Operator
from colony.ir.program import Before, Role, Sensor
from colony.verify.testing import agreement
from tests.verify.testing.bugs_in_passes import Plant

# --- code ----------------------------------------------------------------------------------------


def code(change: Callable[[Code], Code]) -> Plant:
    """`change` the code that clients execute."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = executor.whole_view
        monkeypatch.setattr(executor, "whole_view", lambda *args, **kw: change(original(*args, **kw)))

    return plant


def added(given: Code, op: Op, kind: Kind) -> tuple[Code, int]:
    """The code with one more op, and its number."""
    return replace(given, ops=(*given.ops, op), kinds=(*given.kinds, kind)), len(given.ops)


def moved_while_missing(given: Code) -> Code:
    """Memory moves on in every frame, from placeholders too."""
    given, always = added(given, Literal(True), Kind.BOOL)
    cells = tuple(replace(c, condition=always) if c.kind is not Kind.TIME else c for c in given.cells)
    return replace(given, cells=cells)


def sustained_over_silence(given: Code) -> Code:
    """What is sustained goes on where a frame did not evaluate it."""
    cells = []
    for cell in given.cells:
        update = given.ops[cell.value]
        if "sustained" in cell.name and isinstance(update, Apply) and update.operator is Operator.AND:
            cell = replace(cell, condition=update.arguments[0])
        cells.append(cell)
    return replace(given, cells=tuple(cells))


def short_circuited(given: Code) -> Code:
    """Serving stops at the first active client, so memory below it stays: here, of all when one is active."""
    cells = list(given.cells)
    for actuator in given.actuators:
        for client in actuator.clients[:1]:
            given, idle = added(given, Apply(Operator.NOT, (client.guard,)), Kind.BOOL)
            for i, cell in enumerate(cells):
                given, both = added(given, Apply(Operator.AND, (cell.condition, idle)), Kind.BOOL)
                cells[i] = replace(cell, condition=both)
    return replace(given, cells=tuple(cells))


def frozen_where_not_winning(given: Code) -> Code:
    """Memory moves on only in frames in which some client wins."""
    guards = tuple(c.guard for a in given.actuators for c in a.clients)
    if not guards:
        return given
    given, winning = added(given, Apply(Operator.OR, guards), Kind.BOOL)
    cells = []
    for cell in given.cells:
        given, both = added(given, Apply(Operator.AND, (cell.condition, winning)), Kind.BOOL)
        cells.append(replace(cell, condition=both))
    return replace(given, cells=tuple(cells))


def other_initial_values(given: Code) -> Code:
    """Memory of bools starts true."""
    cells = tuple(
        replace(c, initial=True) if c.kind is Kind.BOOL and c.initial is False else c for c in given.cells
    )
    return replace(given, cells=cells)


def never_silent(given: Code) -> Code:
    """A module that reads something missing goes on with placeholders."""
    ops = list(given.ops)
    for actuator in given.actuators:
        for client in actuator.clients:
            ops[client.present] = Literal(True)
    return replace(given, ops=tuple(ops))


def limits(change: Callable[[tuple[Any, ...]], tuple[Any, ...]]) -> Plant:
    """`change` the limits of every actuator."""
    return code(
        lambda given: replace(
            given, actuators=tuple(replace(a, limits=change(a.limits)) for a in given.actuators)
        )
    )


def limits_without_condition(given: Code) -> Code:
    given, always = added(given, Literal(True), Kind.BOOL)
    actuators = tuple(
        replace(a, limits=tuple(replace(m, applies=always) for m in a.limits)) for a in given.actuators
    )
    return replace(given, actuators=actuators)


def defaults_fresh(given: Code) -> Code:
    """A sensor counts as fresh where only its default stands in."""
    with_default = {s.name for s in given.sensors if s.default is not None}
    return replace(
        given,
        ops=tuple(
            Literal(True) if isinstance(op, SensorFresh) and op.sensor in with_default else op
            for op in given.ops
        ),
    )


def sensors_changed(change: Callable[[Any], Any]) -> Plant:
    return code(lambda given: replace(given, sensors=tuple(map(change, given.sensors))))


def only_winners_active(sensor: Sensor) -> Sensor:
    """A module counts as active in the frame before only if it won."""
    match sensor.sent:
        case Before(of=Role() as role):
            return replace(sensor, sent=replace(sensor.sent, of=replace(role, kind="by")))
    return sensor


def operator(which: Operator, function: Callable[..., Any]) -> Plant:
    """Another function for an operator, both where it is executed and where constants are folded."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        functions: Mapping[Operator, Callable[..., Any]] = MappingProxyType({**FUNCTIONS, which: function})
        monkeypatch.setattr(executor_machine, "FUNCTIONS", functions)
        inline = {operator: made for operator, made in executor_machine.INLINE.items() if operator != which}
        monkeypatch.setattr(executor_machine, "INLINE", inline)

    return plant


def rounded_up(x: float) -> float:
    return math.copysign(math.floor(x + 0.5), x) if math.isfinite(x) else x


# --- what surrounds code -------------------------------------------------------------------------


def bad_commands_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("colony.execute.settle.isfinite", lambda x: True)


def range_before_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    original = executor_decisions.settle

    def settle(actuator: str, by: str, command: Any, fields: Any, limits: Any, *rest: Any) -> Any:
        inside = tuple(
            x if isinstance(x, bool) else clamped(x, low, high)
            for x, (_, _, low, high) in zip(command, fields, strict=True)
        )
        return original(actuator, by, inside, fields, limits, *rest)

    monkeypatch.setattr(executor_decisions, "settle", settle)


def last_limit_wins(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of limits that contradict each other the last one counts."""
    original = executor_decisions.settle

    def settle(actuator: str, by: str, command: Any, fields: Any, limits: Any, *rest: Any) -> Any:
        result = original(actuator, by, command, fields, limits, *rest)
        if result[0] == "limits contradict":
            return original(actuator, by, command, fields, limits[-1:], *rest)
        return result

    monkeypatch.setattr(executor_decisions, "settle", settle)


def unknown_bounds_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    """On `idle hold` a bound that is missing or not finite stands at zero."""
    original = executor_decisions.settle

    def settle(actuator: str, by: str, command: Any, fields: Any, limits: Any, *rest: Any) -> Any:
        known = tuple((at, above, 0.0 if bound is None else bound) for at, above, bound in limits)
        return original(actuator, by, command, fields, known, *rest)

    monkeypatch.setattr(executor_decisions, "settle", settle)


def clamped(x: float, low: float | None, high: float | None) -> float:
    if low is not None and x < low:
        return low
    return high if high is not None and x > high else x


def answers_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Python module with a rate is called every frame, and its answer stands at once."""
    original = python_step.PythonStep.__init__

    def init(self: Any, module: str, instance: object, fields: Any, rate: int | None) -> None:
        original(self, module, instance, fields, None)

    monkeypatch.setattr(python_step.PythonStep, "__init__", init)


def generated(change: Callable[[str], str]) -> Plant:
    """`change` the text of the generated Python."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = agreement.generate
        monkeypatch.setattr(agreement, "generate", lambda *args: change(original(*args)))

    return plant


def without_memory(source: str) -> str:
    """Generated Python that forgets what it should keep: the last assignment after the mark `# memory`."""
    head, mark, tail = source.partition("# memory\n")
    lines = tail.splitlines()
    kept = [i for i, line in enumerate(lines) if line.lstrip().startswith("self.")]
    if kept:
        at = kept[-1]
        lines[at] = lines[at][: len(lines[at]) - len(lines[at].lstrip())] + "pass"
    return head + mark + "\n".join(lines) + "\n"
