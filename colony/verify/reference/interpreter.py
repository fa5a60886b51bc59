"""The reference interpreter: executes the source program, frame by frame and wire by wire.

It defines the meaning of a program, and shares no code with the compiler. It is plain rather than fast:
`Interpreter._run_frame` computes a frame step by step, one section of the language reference after another.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import assert_never

from colony.ir import program as ir
from colony.ir.expression import Expression
from colony.ir.frame import (
    NOTHING_GIVEN,
    Answer,
    Decision,
    Frame,
    FrameEvent,
    Outcome,
    OverriddenCommand,
    Reading,
    RecordKind,
    value_sent,
)
from colony.ir.memory import ProgramMemory
from colony.ir.types import ScalarValue, Value
from colony.ir.walk import idled, in_time, remembered, wired_modules
from colony.verify.reference.boundary import (
    ModuleFrame,
    PythonRunner,
    age_checked,
    clamp,
    declared_command,
    default_of,
    fault_of,
    sense,
)
from colony.verify.reference.expressions import FrameValues, Memory, evaluate, missing, scalar
from colony.verify.reference.kleene import Known, known_value
from colony.verify.reference.memory import (
    RESTORED,
    InterpreterMemory,
    InterpreterState,
    memory_cells,
    restored_memory,
)


class Interpreter:
    """An executor of `program` (see `ir.frame.Executor`). Stateful: holds all of the program's memory.

    With `answers_given` it runs no Python modules: `step` takes their answers instead.

    Raises:
        DiagnosticError: the class of a Python module cannot be imported and built.
    """

    def __init__(self, program: ir.Program, *, answers_given: bool = False) -> None:
        self.program = program
        self._memory: Memory = {}
        self._last_active_ns: dict[
            tuple[str | int, ...], int
        ] = {}  # by node: when its dominant side was last active
        self._states: dict[str, ScalarValue] = {s.name: start for s, start in memory_cells(program)}
        self._next_states: dict[str, ScalarValue] = {}
        actuators = {a.name: a for a in program.robot.actuators}
        self._python = {
            m.name: PythonRunner(m, actuators[m.actuator] if m.actuator else None)
            for m in program.modules
            if isinstance(m, ir.PythonModule) and not answers_given
        }
        self._answers: Mapping[str, Answer] = {}
        self._held: dict[str, dict[tuple[str, int], ScalarValue]] = {}  # the last command sent, by actuator
        self._last: dict[str, ScalarValue] = {}  # values of `last...`, in declared units
        self._wired = wired_modules(program)
        self._moment: FrameValues | None = None
        self._lost: frozenset[str] = frozenset()
        self._given: Mapping[str, OverriddenCommand] = {}
        self._in_time = {c.name: in_time(program.robot, c) for c in program.contracts}
        self._remembered = remembered(self._in_time.values())
        self._late: set[str] = set()  # actuators of `_remembered` that were idle as a client was late
        self._limits: list[tuple[ir.Limit, float | None]] = []
        self._silent: set[str] = set()
        self._blind: set[str] = set()
        self._unknown: set[str] = set()
        self._outputs: dict[tuple[str | int, ...], str | None] = {}  # by node, of the last frame

    def resume(self, memory: ProgramMemory) -> None:
        """Continue from the memory of another executor; call it only before the first frame.

        Raises:
            ValueError: the memory has a cell that the program lacks, or the interpreter runs Python modules,
                which keep memory of their own. `Resuming` checks the rest.
        """
        if self._python:
            raise ValueError("cannot resume a program that runs Python modules: they keep their own memory")
        if memory.first_ns is None:
            return
        restored = restored_memory(self.program, memory, self._states)
        self._memory, self._last_active_ns, self._states, self._held, self._late = restored
        self._last = dict(memory.last)
        self._moment = FrameValues(
            number=RESTORED, t_ns=memory.first_ns, first_ns=memory.first_ns, states=self._states
        )

    @property
    def state(self) -> InterpreterState | None:
        """A copy of all that the interpreter remembers, None before the first frame."""
        if self._moment is None:
            return None
        memory = InterpreterMemory(
            dict(self._memory),
            dict(self._last_active_ns),
            dict(self._states),
            dict(self._held),
            set(self._late),
        )
        moment = self._moment
        return InterpreterState(memory, dict(self._last), moment.number, moment.first_ns, moment.t_ns)

    def restore(self, state: InterpreterState) -> None:
        """Continue from the state of another interpreter of the program, which runs no modules in Python."""
        functions, last_active_ns, states, held, late = state.memory
        self._memory, self._last_active_ns = dict(functions), dict(last_active_ns)
        self._states, self._held, self._last = dict(states), dict(held), dict(state.last)
        self._late = set(late)
        self._moment = FrameValues(
            number=state.number, t_ns=state.t_ns, first_ns=state.first_ns, states=self._states
        )

    @property
    def values(self) -> FrameValues:
        """The values of the last frame, which no later frame changes."""
        assert self._moment is not None, "no frame yet"
        return self._moment

    @property
    def states(self) -> Mapping[str, ScalarValue]:
        """The values that states and machines have after the last frame."""
        return self._states

    @property
    def last(self) -> Mapping[str, ScalarValue]:
        """The values of `last...` that the next frame has without a reading, in declared units."""
        return self._last

    @property
    def limits(self) -> tuple[tuple[ir.Limit, float | None], ...]:
        """The limits that applied in the last frame, each with its bound; None if that was missing."""
        return tuple(self._limits)

    def step(
        self,
        frame: Frame,
        lost: frozenset[str] = frozenset(),
        answers: Mapping[str, Answer] | None = None,
        given: Mapping[str, OverriddenCommand] = NOTHING_GIVEN,
    ) -> Outcome:
        """Execute one frame with readings in declared units.

        `lost` are modules whose clients are lost: their commands do not enter the network, as under
        `on_loss degrade`. `answers` are the answers of all Python modules, if the interpreter runs none.
        `given` is what actuators were given, by actuator, where that is not what the network decided.

        Raises:
            KeyError: `answers` lacks a Python module.
        """
        self._lost, self._answers, self._given = lost, answers or {}, given
        sensors = self.program.robot.sensors
        found = self._last | dict(frame.readings)
        readings = {s.name: age_checked(s, found.get(s.name), frame) for s in sensors}
        factors = {s.name: s.factor for s in sensors}
        return self._run_frame(frame.t_ns, readings, factors, restarted=frame.restarted)

    def step_in_base_units(
        self,
        t_ns: int,
        readings: Mapping[str, Reading],
        lost: frozenset[str] = frozenset(),
        given: Mapping[str, OverriddenCommand] = NOTHING_GIVEN,
        *,
        restarted: bool = False,
    ) -> Outcome:
        """Execute one frame with readings in base units, as tests and proofs give them."""
        self._lost, self._given = lost, given
        sensors = self.program.robot.sensors
        factors = {s.name: s.factor for s in sensors}
        last = {n: x if isinstance(x, bool) else x * factors[n] for n, x in self._last.items()}
        base = {s.name: 1.0 for s in sensors}
        return self._run_frame(t_ns, last | dict(readings), base, restarted=restarted)

    def value_of(self, expression: Expression) -> Known:
        """Return the value of a contract or expectation in the last frame, None where it is unknown.

        Each call advances the memory of the expression: call it at most once a frame.
        """
        assert self._moment is not None, "no frame yet"
        return known_value(expression, self._moment, self._memory)

    def network_decision(self, actuator: ir.Actuator) -> Decision:
        """Return what the network decided in the last frame, whatever the actuator was given."""
        assert self._moment is not None, "no frame yet"
        values = replace(self._moment, winners=dict(self._winners), commanded=set(), sent={})
        given, held = self._given, self._held
        self._given, self._held = NOTHING_GIVEN, dict(held)
        decision = self._decide(actuator, values, self._limits, [])
        self._given, self._held = given, held
        return decision

    def is_unknown(self, contract: str) -> bool:
        """Return True if a contract was unknown in the last frame, not false, which breaks it as well."""
        return contract in self._unknown

    def is_active(self, name: str) -> bool:
        """Return True if a module or wire put a command on its output in the last frame."""
        assert self._moment is not None, "no frame yet"
        return self._moment.outputs[name] is not None

    def is_read(self, sensor: str) -> bool:
        """Return True if a sensor had a valid reading, not older than its `within`, in the last frame."""
        assert self._moment is not None, "no frame yet"
        return sensor in self._moment.fresh

    def node_output(self, wire: str, operands: tuple[int, ...]) -> str | None:
        """Return the module whose output left a node in the last frame, None if none did.

        The node has the dominant operand `operands` in the wiring of `wire`, as in `ir.memory.window_cell`.
        """
        return self._outputs[(wire, *operands)]

    def remaining_ns(self, wire: str, operands: tuple[int, ...], window_ns: int) -> int:
        """Return the time for which an inactive dominant side goes on dominating a node, 0 if it does not."""
        last, moment = self._last_active_ns.get((wire, *operands)), self._moment
        assert moment is not None, "no frame yet"
        return 0 if last is None or last == moment.t_ns else max(0, last + window_ns - moment.t_ns)

    def active_modules(self) -> tuple[str, ...]:
        """Return the modules that were active in the last frame, in the order declared."""
        return tuple(m.name for m in self.program.modules if self.is_active(m.name))

    def is_silent(self, module: str) -> bool:
        """Return True if a module was silent in the last frame because a value that it reads was missing.

        A failsafe module is never silent.
        """
        return module in self._silent

    def is_blind(self, module: str) -> bool:
        """Return True if a failsafe module was active in the last frame without an answer."""
        return module in self._blind

    def bounds(self, actuator: ir.Actuator) -> tuple[tuple[float, float], ...] | None:
        """Return the bounds of an actuator's fields in the last frame, None if they allow no command.

        They do not depend on what actuators are given.
        """
        bounds = [self._bounds(actuator, i, self._limits) for i in range(len(actuator.fields))]
        possible = tuple(b for b in bounds if b is not None and b[0] <= b[1])
        return possible if len(possible) == len(bounds) else None

    def _run_frame(
        self, t_ns: int, readings: Mapping[str, Reading], factors: dict[str, float], *, restarted: bool
    ) -> Outcome:
        last = self._moment
        frame_values = self._moment = FrameValues(
            number=1 if last is None else last.number + 1,
            t_ns=t_ns,
            first_ns=t_ns if last is None else last.first_ns,
            states=self._states,
            restarted=restarted,
        )
        self._next_states, self._silent, self._blind = {}, set(), set()
        records: list[FrameEvent] = []
        self._read_sensors(frame_values, readings, factors, records)
        self._compute_derived_values(frame_values)
        self._run_modules(frame_values, records)
        self._run_network(frame_values)
        limits = self._limits = self._applicable_limits(frame_values)
        self._winners = dict(frame_values.winners)
        decisions = [self._decide(a, frame_values, limits, records) for a in self.program.robot.actuators]
        self._remember_sent(decisions)
        values = {c.name: self.value_of(c.expression) for c in self.program.contracts}
        late = self._late_actuators()
        self._late |= late & self._remembered
        breaches = [n for n, value in values.items() if value is not True and not self._is_excused(n, late)]
        self._unknown = {name for name, value in values.items() if value is None}
        self._states = self._states | self._next_states
        return Outcome(tuple(decisions), tuple(records), tuple(breaches))

    def _late_actuators(self) -> set[str]:
        """Return the actuators that a client that is late or lost keeps from what the network decides."""
        return {a.name for a in self.program.robot.actuators} if self._lost else idled(self._given)

    def _is_excused(self, contract: str, late: set[str]) -> bool:
        rule = self._in_time[contract]
        return rule is not None and rule.excuses(late, self._late)

    def _read_sensors(
        self,
        frame_values: FrameValues,
        readings: Mapping[str, Reading],
        factors: dict[str, float],
        records: list[FrameEvent],
    ) -> None:
        for sensor in self.program.robot.sensors:
            value, kind = sense(sensor, readings.get(sensor.name), factors[sensor.name])
            if kind is not None:
                records.append(FrameEvent(kind, sensor.name))
            if value is not None:
                frame_values.fresh.add(sensor.name)
            else:
                value = default_of(sensor)
            if value is not None:
                frame_values.sensors[sensor.name] = value

    def _remember_sent(self, decisions: list[Decision]) -> None:
        """Remember what is `last...` in the next frame, unless a reading says otherwise."""
        by_name = {decision.actuator: decision for decision in decisions}
        for sensor in self.program.robot.sensors:
            if sensor.sent is not None:
                decision = by_name[sensor.sent.actuator]
                value = ir.value_before(sensor.sent.of, decision.values, decision.by, self._was_client)
                if value is not None:
                    self._last[sensor.name] = value

    def _was_client(self, module: str) -> bool:
        """Return True if a module that is wired to its actuator was active in the last frame."""
        return module in self._wired and self.is_active(module)

    # --- derived values --------------------------------------------------------------------------

    def _compute_derived_values(self, frame_values: FrameValues) -> None:
        for derived in self.program.derived:
            match derived:
                case ir.Let(name=name, expression=expression):
                    if not missing(expression, frame_values):
                        frame_values.derived[name] = evaluate(expression, frame_values, self._memory)
                case ir.State(next=update):
                    if update is not None and not missing(update, frame_values):
                        self._next_states[derived.name] = scalar(evaluate(update, frame_values, self._memory))
                case ir.Machine():
                    self._step_machine(derived, frame_values)
                case _:
                    assert_never(derived)

    def _step_machine(self, machine: ir.Machine, frame_values: FrameValues) -> None:
        """Take the first transition from the current phase; advance the memory of every condition.

        Where the condition of one reads something missing, it is taken if it is failsafe. If it is not,
        nobody knows whether those below it come too early: only failsafe ones among them are taken.
        """
        phase = scalar(frame_values.states[machine.name])
        taken: float | None = None
        unknown = False
        for transition in machine.transitions:
            if missing(transition.condition, frame_values):
                holds = transition.failsafe
                unknown_here = not transition.failsafe
            else:
                holds = bool(evaluate(transition.condition, frame_values, self._memory))
                unknown_here = False
            if phase in transition.sources:
                if holds and taken is None and (transition.failsafe or not unknown):
                    taken = transition.target
                unknown = unknown or unknown_here
        if taken is not None:
            self._next_states[machine.name] = taken

    # --- modules ---------------------------------------------------------------------------------

    def _run_modules(self, frame_values: FrameValues, records: list[FrameEvent]) -> None:
        for module in self.program.modules:
            match module:
                case ir.Module():
                    command = self._run_module(module, frame_values)
                case ir.PythonModule():
                    command = self._run_python_module(module, frame_values, records)
                case _:
                    assert_never(module)
            if command is not None:
                frame_values.commands[module.name] = command
            active = command is not None or module.name in self._blind
            lost = module.actuator is not None and module.name in self._lost and not module.failsafe
            frame_values.outputs[module.name] = module.name if active and not lost else None

    def _record_no_answer(self, module: ir.AnyModule) -> None:
        """Record that a module has no answer: it is silent or, if failsafe, active without a command."""
        (self._blind if module.failsafe else self._silent).add(module.name)

    def _run_module(self, module: ir.Module, frame_values: FrameValues) -> tuple[ScalarValue, ...] | None:
        """Return the module's command, empty if it has no `do`; None if the module is not active.

        Unless the module is silent, everything in it is evaluated, whether or not its predicate holds.
        """
        fields = module.command.fields if module.command else ()
        updates = [(s.name, s.next) for s in module.states if s.next is not None]
        evaluated = [
            *(let.expression for let in module.lets),
            module.when,
            *fields,
            *(e for _, e in updates),
        ]
        own = {let.name for let in module.lets}
        if any(missing(e, frame_values, own) for e in evaluated):
            self._record_no_answer(module)
            return None
        for let in module.lets:
            frame_values.locals[let.name] = evaluate(let.expression, frame_values, self._memory)
        applicable = evaluate(module.when, frame_values, self._memory)
        command = tuple(scalar(evaluate(e, frame_values, self._memory)) for e in fields)
        for name, e in updates:
            self._next_states[name] = scalar(evaluate(e, frame_values, self._memory))
        return command if applicable else None

    def _run_python_module(
        self, module: ir.PythonModule, frame_values: FrameValues, records: list[FrameEvent]
    ) -> tuple[ScalarValue, ...] | None:
        runner = self._python.get(module.name)
        if any(missing(r.expression, frame_values) for r in module.reads):
            if runner is not None:
                runner.miss()
            self._record_no_answer(module)
            return None
        values = {r.name: evaluate(r.expression, frame_values, self._memory) for r in module.reads}
        frame = ModuleFrame((frame_values.t_ns - frame_values.first_ns) / 1e9, values)
        answer = self._answers[module.name] if runner is None else runner.step(frame_values.t_ns, frame)
        if answer.error:
            records.append(FrameEvent("python error", module.name))
        if answer.blind and module.failsafe:
            self._record_no_answer(module)
        return answer.values

    # --- network ---------------------------------------------------------------------------------

    def _run_network(self, frame_values: FrameValues) -> None:
        for actuator in self.program.robot.actuators:
            frame_values.winners[actuator.name] = None
        for wire in self.program.wires:
            output = self._output_of(wire.wiring, frame_values, (wire.name,))
            if wire.actuator is None:
                frame_values.outputs[wire.name] = output
            else:
                frame_values.winners[wire.actuator] = output

    def _output_of(
        self, wiring: ir.Wiring, frame_values: FrameValues, node: tuple[str | int, ...]
    ) -> str | None:
        """Return the module whose output gets through `wiring`; None if none does."""
        if isinstance(wiring, ir.Use):
            return frame_values.outputs[wiring.name]
        last = len(wiring.operands) - 1
        inferior = self._output_of(wiring.operands[last], frame_values, (*node, last))
        for i in reversed(range(last)):
            dominant = self._output_of(wiring.operands[i], frame_values, (*node, i))
            if self._dominates(dominant is not None, wiring.windows_ns[i], frame_values, (*node, i)):
                inferior = None
            match wiring.relation:
                case "suppresses":
                    inferior = inferior if dominant is None else dominant
                case "inhibits":
                    pass
                case _:
                    assert_never(wiring.relation)
            self._outputs[(*node, i)] = inferior
        return inferior

    def _dominates(
        self, active: bool, window_ns: int, frame_values: FrameValues, node: tuple[str | int, ...]
    ) -> bool:
        """Return True if the dominant side is active, or was active less than `window_ns` ago."""
        if active:
            self._last_active_ns[node] = frame_values.t_ns
        return active or (
            node in self._last_active_ns and frame_values.t_ns - self._last_active_ns[node] < window_ns
        )

    # --- commands --------------------------------------------------------------------------------

    def _applicable_limits(self, frame_values: FrameValues) -> list[tuple[ir.Limit, float | None]]:
        """Return the limits that apply in this frame, each with its bound; None if that is missing.

        A limit whose condition or bound reads something missing applies. A bound that is not finite is
        missing.
        """
        applying: list[tuple[ir.Limit, float | None]] = []
        for limit in self.program.limits:
            condition = True if limit.condition is None else self._strict_value(limit.condition, frame_values)
            value = self._strict_value(limit.bound, frame_values)
            bound = None if value is None or not math.isfinite(scalar(value)) else scalar(value)
            if condition is None or value is None or condition:
                applying.append((limit, bound))
        return applying

    def _strict_value(self, expression: Expression, frame_values: FrameValues) -> Value | None:
        """Return the value of an expression, None if it reads something missing."""
        return None if missing(expression, frame_values) else evaluate(expression, frame_values, self._memory)

    def _decide(
        self,
        actuator: ir.Actuator,
        frame_values: FrameValues,
        limits: list[tuple[ir.Limit, float | None]],
        records: list[FrameEvent],
    ) -> Decision:
        """Send the winner's command within its bounds, or the idle command where there is no such command."""
        if actuator.name in self._given:
            return self._decide_given(actuator, self._given[actuator.name], frame_values, limits)
        winner = frame_values.winners[actuator.name]
        if winner in self._lost:  # failsafe: nobody sends its command, and nobody else's gets through
            winner = frame_values.winners[actuator.name] = None
        if winner is None:
            return self._decide_idle(actuator, None, None, frame_values)
        if winner in self._blind:
            records.append(FrameEvent("missing", winner))
            return self._decide_idle(actuator, winner, "missing", frame_values)
        command = frame_values.commands[winner]
        bounds = [self._bounds(actuator, i, limits) for i in range(len(actuator.fields))]
        fault = fault_of(actuator, winner, command, bounds)
        if fault is None:
            sent = tuple(x if b is None else clamp(x, *b) for x, b in zip(command, bounds, strict=True))
            declared = declared_command(actuator, sent)
            if not all(math.isfinite(x) for x in declared):
                fault = FrameEvent("not finite", winner)
        if fault is not None:
            records.append(fault)
            return self._decide_idle(actuator, winner, fault.kind, frame_values)
        for field, x, bounded in zip(actuator.fields, command, sent, strict=True):
            if bounded != x:
                by_range = bounded == (field.high if x > bounded else field.low)
                kind: RecordKind = "command clamped" if by_range else "limited"
                records.append(FrameEvent(kind, f"{actuator.name}.{field.name}"))
        self._hold(actuator, sent, frame_values)
        return Decision(actuator.name, winner, declared)

    def _decide_given(
        self,
        actuator: ir.Actuator,
        given: OverriddenCommand,
        frame_values: FrameValues,
        limits: list[tuple[ir.Limit, float | None]],
    ) -> Decision:
        """Return the decision for an actuator that was given something else than the network decided."""
        frame_values.winners[actuator.name] = None
        if given.values is None:
            return self._decide_idle(actuator, None, None, frame_values)
        sent = []
        for i, (field, value) in enumerate(zip(actuator.fields, given.values, strict=True)):
            low, high = self._bounds(actuator, i, limits) or (None, None)
            sent.append(value_sent(value, field.factor, low, high))
        self._hold(actuator, tuple(sent), frame_values)
        return Decision(actuator.name, None, declared_command(actuator, tuple(sent)))

    def _hold(self, actuator: ir.Actuator, sent: tuple[ScalarValue, ...], frame_values: FrameValues) -> None:
        """Record that an actuator was sent a command."""
        frame_values.commanded.add(actuator.name)
        self._held[actuator.name] = {(actuator.name, i): x for i, x in enumerate(sent)}
        frame_values.sent.update(self._held[actuator.name])

    def _bounds(
        self, actuator: ir.Actuator, i: int, limits: list[tuple[ir.Limit, float | None]]
    ) -> tuple[float, float] | None:
        """Return the greatest lower and the least upper bound of a field, of its range and its limits.

        A missing bound stands at the value that the idle command has. None if there is no idle command.
        """
        field = actuator.fields[i]
        lower = -math.inf if field.low is None else field.low
        upper = math.inf if field.high is None else field.high
        for limit, bound in limits:
            if limit.actuator == actuator.name and limit.field_index == i:
                if bound is None:
                    if actuator.idle is None:
                        return None
                    bound = actuator.idle[i]
                if limit.relation == "<=":
                    upper = min(upper, bound)
                else:
                    lower = max(lower, bound)
        return lower, upper

    def _decide_idle(
        self, actuator: ir.Actuator, winner: str | None, fault: str | None, frame_values: FrameValues
    ) -> Decision:
        """Return the decision for the idle command, unlimited and unclamped; no command for `idle hold`.

        Then the actuator holds the last command sent, if there was one.
        """
        if actuator.idle is None:
            frame_values.sent.update(self._held.get(actuator.name, {}))
            return Decision(actuator.name, winner, None, fault)
        frame_values.sent.update({(actuator.name, i): x for i, x in enumerate(actuator.idle)})
        return Decision(actuator.name, winner, declared_command(actuator, actuator.idle), fault)
