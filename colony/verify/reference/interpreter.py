"""The reference: executes the source program, frame by frame and wire by wire, as the language reads.

It shares no code with the compiler. It is slow and plain on purpose: a frame is computed in the order of
the methods called in `Interpreter._frame`, each of which does one section of the language reference.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import assert_never

from colony.ir import program as ir
from colony.ir.expression import Expression
from colony.ir.frame import Answer, Decision, Frame, Outcome, Reading, Record
from colony.ir.memory import ProgramMemory
from colony.ir.types import ScalarValue, Value
from colony.verify.reference.boundary import (
    ModuleFrame,
    PythonRunner,
    aged,
    clamp,
    declared_command,
    default_of,
    sense,
)
from colony.verify.reference.expressions import Memory, Moment, evaluate, missing, scalar
from colony.verify.reference.memory import recalled


class Interpreter:
    """An executor of `program` (see `ir.frame.Executor`). Mutable: it has all of the program's memory.

    If `answered`, Python modules are not run: `step` is given what they answered.

    Raises:
        DiagnosticError: the class of a Python module cannot be imported and built.
    """

    def __init__(self, program: ir.Program, *, answered: bool = False) -> None:
        self.program = program
        self._memory: Memory = {}
        self._dominated: dict[tuple[str | int, ...], int] = {}  # wire and node: when A was last active
        self._states: dict[str, ScalarValue] = {s.name: start for s, start in _memory_cells(program)}
        self._next: dict[str, ScalarValue] = {}
        actuators = {a.name: a for a in program.robot.actuators}
        self._python = {
            m.name: PythonRunner(m, actuators[m.actuator] if m.actuator else None)
            for m in program.modules
            if isinstance(m, ir.PythonModule) and not answered
        }
        self._answers: Mapping[str, Answer] = {}
        self._moment: Moment | None = None
        self._lost: frozenset[str] = frozenset()
        self._silent: set[str] = set()

    def resume(self, memory: ProgramMemory) -> None:
        """Go on from what another executor remembered; before the first frame only.

        Raises:
            ValueError: the memory has what the program has not, or it runs modules in Python, which have
                memory of their own. `Resuming` checks the rest.
        """
        if self._python:
            raise ValueError("modules in Python have memory of their own")
        if memory.first_ns is None:
            return
        self._memory, self._dominated, self._states = recalled(self.program, memory, self._states)
        self._moment = Moment(t_ns=memory.first_ns, first_ns=memory.first_ns, states=self._states)

    def step(
        self, frame: Frame, lost: frozenset[str] = frozenset(), answers: Mapping[str, Answer] | None = None
    ) -> Outcome:
        """Step through one frame, its readings in declared units.

        The network does not hear the modules in `lost`: what actuators with `on_loss degrade` make of it.
        `answers` are those of all Python modules, where they are not run.

        Raises:
            KeyError: one of them is missing.
        """
        self._lost, self._answers = lost, answers or {}
        sensors = self.program.robot.sensors
        readings = {s.name: aged(s, frame.readings.get(s.name), frame) for s in sensors}
        return self._frame(frame.t_ns, readings, {s.name: s.factor for s in sensors})

    def step_in_base_units(self, t_ns: int, readings: Mapping[str, Reading]) -> Outcome:
        """Execute one frame with readings in base units, as tests and proofs give them."""
        return self._frame(t_ns, readings, {s.name: 1.0 for s in self.program.robot.sensors})

    def value_of(self, expression: Expression) -> Value | None:
        """Return the value of a contract expression in the last frame, None where it reads something missing.

        Its memory, if it has any, moves on: to be called once a frame.
        """
        moment = self._moment
        assert moment is not None, "no frame yet"
        return None if missing(expression, moment) else evaluate(expression, moment, self._memory)

    def is_active(self, name: str) -> bool:
        """Return True if a module or wire put a command on its output in the last frame."""
        assert self._moment is not None, "no frame yet"
        return self._moment.outputs[name] is not None

    def is_silent(self, module: str) -> bool:
        """Return True if a module was silent in the last frame because a value that it reads was missing."""
        return module in self._silent

    def _frame(self, t_ns: int, readings: Mapping[str, Reading], factors: dict[str, float]) -> Outcome:
        first_ns = t_ns if self._moment is None else self._moment.first_ns
        moment = self._moment = Moment(t_ns=t_ns, first_ns=first_ns, states=self._states)
        self._next, self._silent = {}, set()
        records: list[Record] = []
        self._sensors(moment, readings, factors, records)
        self._derived_values(moment)
        self._modules(moment, records)
        self._network(moment)
        limits = self._limits()
        decisions = [self._decide(a, moment, limits, records) for a in self.program.robot.actuators]
        breaches = [c.name for c in self.program.contracts if self.value_of(c.expression) is False]
        self._states = self._states | self._next
        return Outcome(tuple(decisions), tuple(records), tuple(breaches))

    def _sensors(
        self,
        moment: Moment,
        readings: Mapping[str, Reading],
        factors: dict[str, float],
        records: list[Record],
    ) -> None:
        for sensor in self.program.robot.sensors:
            value, kind = sense(sensor, readings.get(sensor.name), factors[sensor.name])
            if kind is not None:
                records.append(Record(kind, sensor.name))
            if value is not None:
                moment.fresh.add(sensor.name)
            else:
                value = default_of(sensor)
            if value is not None:
                moment.sensors[sensor.name] = value

    # --- derived values --------------------------------------------------------------------------

    def _derived_values(self, moment: Moment) -> None:
        for derived in self.program.derived:
            match derived:
                case ir.Let(name=name, expression=expression):
                    if not missing(expression, moment):
                        moment.derived[name] = evaluate(expression, moment, self._memory)
                case ir.State(next=following):
                    if following is not None and not missing(following, moment):
                        self._next[derived.name] = scalar(evaluate(following, moment, self._memory))
                case ir.Machine():
                    self._machine(derived, moment)
                case _:
                    assert_never(derived)

    def _machine(self, machine: ir.Machine, moment: Moment) -> None:
        """Take the first transition from the present phase; evaluate every condition, for its memory."""
        phase = scalar(moment.states[machine.name])
        taken: float | None = None
        for transition in machine.transitions:
            if missing(transition.condition, moment):
                continue
            holds = evaluate(transition.condition, moment, self._memory)
            if holds and phase in transition.sources and taken is None:
                taken = transition.target
        if taken is not None:
            self._next[machine.name] = taken

    # --- modules ---------------------------------------------------------------------------------

    def _modules(self, moment: Moment, records: list[Record]) -> None:
        for module in self.program.modules:
            match module:
                case ir.Module():
                    command = self._module(module, moment)
                case ir.PythonModule():
                    command = self._python_module(module, moment, records)
                case _:
                    assert_never(module)
            if command is not None:
                moment.commands[module.name] = command
            heard = command is not None and not (module.actuator and module.name in self._lost)
            moment.outputs[module.name] = module.name if heard else None

    def _module(self, module: ir.Module, moment: Moment) -> tuple[ScalarValue, ...] | None:
        """Return the command put on the output, without fields if the module has no `do`; None for nothing.

        Unless the module is silent everything in it is evaluated, whether or not its predicate holds.
        """
        fields = module.command.fields if module.command else ()
        following = [(s.name, s.next) for s in module.states if s.next is not None]
        everything = [
            *(let.expression for let in module.lets),
            module.when,
            *fields,
            *(n for _, n in following),
        ]
        own = {let.name for let in module.lets}
        if any(missing(e, moment, own) for e in everything):
            self._silent.add(module.name)
            return None
        for let in module.lets:
            moment.locals[let.name] = evaluate(let.expression, moment, self._memory)
        applicable = evaluate(module.when, moment, self._memory)
        command = tuple(scalar(evaluate(e, moment, self._memory)) for e in fields)
        for name, e in following:
            self._next[name] = scalar(evaluate(e, moment, self._memory))
        return command if applicable else None

    def _python_module(
        self, module: ir.PythonModule, moment: Moment, records: list[Record]
    ) -> tuple[ScalarValue, ...] | None:
        if any(missing(r.expression, moment) for r in module.reads):
            self._silent.add(module.name)
            return None
        values = {r.name: evaluate(r.expression, moment, self._memory) for r in module.reads}
        frame = ModuleFrame((moment.t_ns - moment.first_ns) / 1e9, values)
        runner = self._python.get(module.name)
        command, failed = self._answers[module.name] if runner is None else runner.step(moment.t_ns, frame)
        if failed:
            records.append(Record("python error", module.name))
        return command

    # --- network ---------------------------------------------------------------------------------

    def _network(self, moment: Moment) -> None:
        for actuator in self.program.robot.actuators:
            moment.winners[actuator.name] = None
        for wire in self.program.wires:
            output = self._wiring(wire.wiring, moment, (wire.name,))
            if wire.actuator is None:
                moment.outputs[wire.name] = output
            else:
                moment.winners[wire.actuator] = output

    def _wiring(self, wiring: ir.Wiring, moment: Moment, node: tuple[str | int, ...]) -> str | None:
        """Return the module whose output gets through `wiring`; None if it is not active."""
        if isinstance(wiring, ir.Use):
            return moment.outputs[wiring.name]
        last = len(wiring.operands) - 1
        inferior = self._wiring(wiring.operands[last], moment, (*node, last))
        for i in reversed(range(last)):
            dominant = self._wiring(wiring.operands[i], moment, (*node, i))
            if self._dominates(dominant is not None, wiring.windows_ns[i], moment, (*node, i)):
                inferior = None
            match wiring.relation:
                case "suppresses":
                    inferior = inferior if dominant is None else dominant
                case "inhibits":
                    pass
                case _:
                    assert_never(wiring.relation)
        return inferior

    def _dominates(self, active: bool, window_ns: int, moment: Moment, node: tuple[str | int, ...]) -> bool:
        """Return True if the dominant side is active, or was less than the time constant ago."""
        if active:
            self._dominated[node] = moment.t_ns
        return active or (node in self._dominated and moment.t_ns - self._dominated[node] < window_ns)

    # --- what is sent ----------------------------------------------------------------------------

    def _limits(self) -> list[tuple[ir.Limit, float]]:
        """Return the limits that apply in this frame with their bounds, in the order written."""
        applying = []
        for limit in self.program.limits:
            condition = True if limit.condition is None else self.value_of(limit.condition)
            bound = self.value_of(limit.bound)
            applies = condition is None or bound is None or bool(condition)
            if applies:
                number = 0.0 if bound is None else scalar(bound)
                applying.append((limit, number if math.isfinite(number) else 0.0))
        return applying

    def _decide(
        self,
        actuator: ir.Actuator,
        moment: Moment,
        limits: list[tuple[ir.Limit, float]],
        records: list[Record],
    ) -> Decision:
        winner = moment.winners[actuator.name]
        if winner is None:
            return self._idle(actuator, None, None, moment)
        command = moment.commands[winner]
        found: list[Record] = []
        sent = tuple(
            self._bounded(actuator, i, x, [(m, b) for m, b in limits if m.actuator == actuator.name], found)
            for i, x in enumerate(command)
        )
        leaving = declared_command(actuator, sent)
        if not all(math.isfinite(x) for x in command + leaving):
            records.append(Record("not finite", winner))
            return self._idle(actuator, winner, "not finite", moment)
        records.extend(found)
        moment.commanded.add(actuator.name)
        moment.sent.update({(actuator.name, i): x for i, x in enumerate(sent)})
        return Decision(actuator.name, winner, leaving)

    def _bounded(
        self,
        actuator: ir.Actuator,
        i: int,
        x: ScalarValue,
        limits: list[tuple[ir.Limit, float]],
        records: list[Record],
    ) -> ScalarValue:
        """Return field `i` of a command within its limits, then within its range; record changes."""
        field, lowered = actuator.fields[i], False
        for limit, bound in limits:
            if limit.field_index == i:
                beyond = x > bound if limit.relation == "<=" else x < bound
                x, lowered = (bound, True) if beyond else (x, lowered)
        inside = clamp(x, field.low, field.high)
        if lowered:
            records.append(Record("limited", f"{actuator.name}.{field.name}"))
        if inside != x:
            records.append(Record("command clamped", f"{actuator.name}.{field.name}"))
        return inside

    def _idle(self, actuator: ir.Actuator, winner: str | None, fault: str | None, moment: Moment) -> Decision:
        """Return the idle command, which is neither limited nor clamped; nothing for `idle hold`."""
        if actuator.idle is None:
            return Decision(actuator.name, winner, None, fault)
        moment.sent.update({(actuator.name, i): x for i, x in enumerate(actuator.idle)})
        return Decision(actuator.name, winner, declared_command(actuator, actuator.idle), fault)


def _memory_cells(program: ir.Program) -> list[tuple[ir.State | ir.Machine, ScalarValue]]:
    """Return every state and machine with its initial value."""
    cells: list[tuple[ir.State | ir.Machine, ScalarValue]] = []
    for derived in program.derived:
        match derived:
            case ir.State():
                cells.append((derived, derived.initial))
            case ir.Machine():
                cells.append((derived, derived.start))
            case ir.Let():
                pass
            case _:
                assert_never(derived)
    for module in program.modules:
        if isinstance(module, ir.Module):
            cells.extend((state, state.initial) for state in module.states)
    return cells
