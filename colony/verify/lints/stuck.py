"""Lint of memory that a missing sensor keeps as it is, while a module drives that it would stop.

With `going -> turning when bumper` and `go` active in `going`, a missing `bumper` keeps the machine in
`going`, and `go` drives. The evidence is a pair of runs that end with two frames of the same readings. With
all sensors present, the module drives in the first of them, the memory changes, and in the second one the
module does not win and the robot is restrained (`driving`). With one sensor missing in both frames, the
memory stays as it is, and the module drives.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression
from colony.ir.frame import Outcome
from colony.ir.program import Actuator, Machine, Module, State
from colony.ir.types import BOOL
from colony.ir.walk import all_subexpressions
from colony.text.diagnostics import Diagnostic, warning
from colony.text.wording import quoted
from colony.verify.claims import FALSE, active, all_of, binary, constant, negation, value_or, won
from colony.verify.lints.case import Case, condition_of
from colony.verify.lints.driving import (
    drivers,
    drives,
    inhibitor_hint,
    is_held_back,
    may_win_without,
    moving_fields,
    undecided_without,
    with_all_sensors,
    without,
)
from colony.verify.lints.proof import LintProver, Question, frames
from colony.verify.reference.kleene import Known
from colony.verify.snapshot import Snapshot


class _Change(NamedTuple):
    """A change of `memory` that stops `module`, and the sensors without which it does not happen.

    Attributes:
        module, actuator: The module that moves the robot, and what it commands.
        memory: A state or machine on which the predicate of the module, or of a dominator, depends.
        transition: The number of the machine's transition; None for a state.
        sensors: Sensors that the module does not need.
    """

    module: Module
    actuator: Actuator
    memory: State | Machine
    transition: int | None
    sensors: tuple[str, ...]

    @property
    def name(self) -> str:
        return f"change {self.module.name} {self.memory.name} {self.transition}"

    @property
    def phase(self) -> float | None:
        """The machine's new phase; None for a state."""
        if self.transition is None or isinstance(self.memory, State):
            return None
        return self.memory.transitions[self.transition].target

    @property
    def value(self) -> Expression:
        return ir.StateValue(type=self.memory.type, name=self.memory.name)


def _changes(case: Case) -> Iterator[_Change]:
    memories = {d.name: d for d in case.program.derived if isinstance(d, State | Machine)}
    for module, actuator in drivers(case) if memories else ():
        needs = case.contents.needs(module)
        read = dict.fromkeys(name for m in _relevant(case, module) for name in _memories_read(case, m))
        for memory in (memories[name] for name in read if name in memories):
            for transition, needed in _needed(case, memory):
                if sensors := needed - needs:
                    yield _Change(module, actuator, memory, transition, tuple(sorted(sensors)))


def _relevant(case: Case, module: Module) -> Iterator[Module]:
    """Yield a module and its dominators in the language."""
    yield module
    yield from (case.modules[name] for name in case.network.dominators(module.name) if name in case.modules)


def _memories_read(case: Case, module: Module) -> frozenset[str]:
    """Return the states and machines on which a module's predicate depends."""
    return frozenset(x.name for x in case.reads(module.when) if isinstance(x, ir.StateValue))


def _needed(case: Case, memory: State | Machine) -> Iterator[tuple[int | None, frozenset[str]]]:
    """Yield the sensors without which memory stays as it is; of a machine, for each of its transitions.

    A transition needs also what those above it of the same phase read. A failsafe one needs nothing. The task
    of a sequence that has a time limit, a failsafe transition below its `until`, does not stay.
    """
    if isinstance(memory, State):
        if memory.next is not None:
            yield None, case.contents.needed_sensors(memory.next)
        return
    for i, transition in enumerate(memory.transitions):
        if not (transition.failsafe or (memory.tasks and _has_time_limit(memory, i))):
            ordinary = [memory.transitions[j] for j in (*_above(memory, i), i)]
            needed = (case.contents.needed_sensors(t.condition) for t in ordinary if not t.failsafe)
            yield i, frozenset[str]().union(*needed)


def _has_time_limit(machine: Machine, i: int) -> bool:
    sources = machine.transitions[i].sources
    below = machine.transitions[i + 1 :]
    return any(t.failsafe and t.sources == sources and t.target not in sources for t in below)


def _above(machine: Machine, i: int) -> Iterator[int]:
    """Yield the transitions that come before transition `i` in one of its phases."""
    sources = machine.transitions[i].sources
    return (j for j, t in enumerate(machine.transitions[:i]) if t.sources & sources)


def _change_claim(case: Case, change: _Change) -> Expression:
    """Return the claim that a change of memory never stops a module that moved the robot in the frame before.

    All sensors are present in both frames, and no dominator is active that does not read the memory.
    """
    wins, free_cell = won(change.actuator.name, change.module.name), _free_cell(case)
    drives_now = (*with_all_sensors(case), wins, drives(change.module, change.actuator))
    drove = all_of((*drives_now, *_is_taken(change)))
    conditions = [
        *with_all_sensors(case),
        _memory(ir.MemoryFunction.PREVIOUS, (value_or(drove, FALSE), FALSE), free_cell),
        _memory(ir.MemoryFunction.CHANGED, (change.value,), free_cell + 1),
        negation(wins),
    ]
    if change.phase is not None:
        conditions.append(binary(Binary.EQUAL, change.value, constant(change.phase, change.memory.type)))
    for name in case.network.dominators(change.module.name):
        dominator = case.modules.get(name)
        if dominator is None or change.memory.name not in _memories_read(case, dominator):
            conditions.append(negation(active(name)))
    return negation(all_of(conditions))


def _is_taken(change: _Change) -> Iterator[Expression]:
    """Yield the conditions that the transition is the one that the machine takes."""
    if change.transition is None or isinstance(change.memory, State):
        return
    yield condition_of(change.memory, change.transition)
    for i in _above(change.memory, change.transition):
        yield negation(condition_of(change.memory, i))


def _free_cell(case: Case) -> int:
    """Return a number above those of all memory functions."""
    cells = (x.cell for x in all_subexpressions(case.program) if isinstance(x, ir.MemoryCall))
    return max(cells, default=-1) + 1


def _memory(function: ir.MemoryFunction, arguments: tuple[Expression, ...], cell: int) -> Expression:
    return ir.MemoryCall(type=BOOL, function=function, arguments=arguments, cell=cell)


class _End(NamedTuple):
    """The last frame of a run, and the memory's values as the last two frames saw them."""

    outcome: Outcome
    before: Known
    after: Known


def findings(case: Case, prover: LintProver) -> Iterator[Diagnostic]:
    """Yield the warnings about memory that a missing sensor keeps as it is."""
    found: dict[tuple[str, str, Known, float | None], tuple[_Change, list[str]]] = {}
    undecided: dict[str, list[str]] = {}
    for change in _changes(case):
        sensors = [
            s for s in change.sensors if may_win_without(case, change.module, change.actuator, s, prover)
        ]
        if not sensors:
            continue
        question = Question(change.name, partial(_change_claim, case, change))
        trace = prover.refuted(question)
        if trace is None:
            if prover.is_undecided(question.name):
                undecided.setdefault(change.module.name, []).extend(sensors)
            continue
        *first, last = trace.snapshots
        steady = (*first, last._replace(readings=first[-1].readings))
        stopped = _end(case, change, steady)
        for sensor in sensors if stopped.before != stopped.after else ():
            driving = _end(case, change, without(steady, sensor, 2))
            if driving.before == driving.after == stopped.before and _drives_on(change, stopped, driving):
                key = (change.module.name, change.memory.name, stopped.before, change.phase)
                found.setdefault(key, (change, []))[1].append(sensor)
    for (module, _, before, _), (change, names) in found.items():
        sensors = list(dict.fromkeys(names))
        yield warning("V030", case.modules[module].span, *_texts(change, before, sensors))
    pairs = ((module, s) for (module, *_), (_, names) in found.items() for s in names)
    yield from undecided_without(case, undecided, pairs)


def _drives_on(change: _Change, stopped: _End, driving: _End) -> bool:
    """Return True if the module drives in one run, and is held back in the other."""
    moves = moving_fields(driving.outcome, change.module, change.actuator)
    return bool(moves) and is_held_back(stopped.outcome, driving.outcome, change.module, change.actuator)


def _end(case: Case, change: _Change, snapshots: tuple[Snapshot, ...]) -> _End:
    run = frames(case.program, snapshots)
    *_, (_, before), (outcome, after) = ((x, interpreter.value_of(change.value)) for x, interpreter in run)
    return _End(outcome, before, after)


def _is_from_any(change: _Change) -> bool:
    """Return True if the transition, which is not failsafe, is written `any -> ...`."""
    assert change.transition is not None
    assert isinstance(change.memory, Machine)
    span = change.memory.transitions[change.transition].span
    return span.source.text[span.start : span.end].split()[:1] == ["any"]


def _texts(change: _Change, before: Known, sensors: list[str]) -> tuple[str, str]:
    """Return the message and the hint."""
    missing, module = f"with {quoted(sensors, 'or')} missing", change.module.name
    inhibitor = inhibitor_hint(sensors, module)
    match change.memory:
        case Machine(name=name, type=type_, tasks=tasks):
            names = {number: phase for phase, number in type_.members}
            old, new = (names[x] for x in (before, change.phase) if isinstance(x, float))
            message = f"{missing}, `{name}` cannot leave `{old}`, and `{module}` drives"
            if tasks:
                return message, f"give the task a time, `within 30 s else PHASE`, or {inhibitor}"
            source = "any" if _is_from_any(change) else old
            return message, f"write `failsafe {source} -> {new} when ...`, or {inhibitor}"
        case State(name=name):
            return f"{missing}, `{name}` stays as it is, and `{module}` drives", inhibitor
