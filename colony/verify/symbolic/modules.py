"""Derived values and modules: when they are missing or silent, their values, and their memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import assert_never, cast

import z3

from colony.ir import program as ir
from colony.ir.expression import Expression
from colony.ir.types import Scalar as ScalarType
from colony.ir.types import ScalarValue
from colony.verify.symbolic.builder import Builder
from colony.verify.symbolic.cases import constant
from colony.verify.symbolic.expressions import Expressions
from colony.verify.symbolic.frame_values import FrameValues, missing
from colony.verify.symbolic.inputs import python_answers
from colony.verify.symbolic.logic import FALSE, all_of, any_of, both, either, negation
from colony.verify.symbolic.memory import open_scalar_cell
from colony.verify.symbolic.numbers import select
from colony.verify.symbolic.system import ModuleTerms, Number, PythonInput, Scalar, Term


class DeclarationEncoder:
    """Encodes a program's declarations in the order of a frame. Mutable: fills `frame_values`."""

    def __init__(self, program: ir.Program, builder: Builder, frame_values: FrameValues) -> None:
        self.program = program
        self.builder = builder
        self.frame_values = frame_values
        self._set_next: dict[str, Callable[[Scalar], None]] = {}

    def expressions(
        self, advances: z3.BoolRef, hint: str, own_lets: frozenset[str] = frozenset()
    ) -> Expressions:
        """Return an encoder of expressions whose memory advances where `advances` holds."""
        return Expressions(
            builder=self.builder,
            frame_values=self.frame_values,
            advances=advances,
            hint=hint,
            own_lets=own_lets,
        )

    # --- states ----------------------------------------------------------------------------------

    def encode_states(self) -> None:
        """Read the old values of all states and machines."""
        for derived in self.program.derived:
            match derived:
                case ir.State(name=name, type=type_, initial=initial):
                    self._open_state(name, type_, initial)
                case ir.Machine(name=name, type=phases, start=start):
                    self._open_state(name, phases, start)
                case ir.Let():
                    pass
                case _:
                    assert_never(derived)
        for module in self.program.modules:
            for state in module.states if isinstance(module, ir.Module) else ():
                self._open_state(state.name, state.type, state.initial)

    def _open_state(self, name: str, type_: ScalarType, initial: ScalarValue) -> None:
        self.frame_values.states[name], self._set_next[name] = open_scalar_cell(
            self.builder, name, type_, initial
        )

    def _set_unchanged(self, name: str) -> None:
        self._set_next[name](self.frame_values.states[name])

    # --- derived values --------------------------------------------------------------------------

    def encode_derived(self) -> None:
        """Encode all derived values."""
        for derived in self.program.derived:
            match derived:
                case ir.Let(name=name, expression=expression):
                    absent = missing(expression, self.frame_values)
                    value = self.expressions(negation(absent), name).value(expression)
                    self.frame_values.derived[name] = (absent, self._named(value, name))
                case ir.State(name=name, next=None):
                    self._set_unchanged(name)
                case ir.State(name=name, next=update):
                    assert update is not None
                    present = negation(missing(update, self.frame_values))
                    value = self.expressions(present, name).scalar(update)
                    self._set_next[name](select(present, value, self.frame_values.states[name]))
                case ir.Machine():
                    self._machine(derived)
                case _:
                    assert_never(derived)

    def _named(self, value: Term, name: str) -> Term:
        if isinstance(value, tuple):
            return tuple(self.builder.named(x, f"{name}[{i}]") for i, x in enumerate(value))
        return self.builder.named(value, name)

    def _machine(self, machine: ir.Machine) -> None:
        """Take the first transition from the current phase that applies (see `ir.Machine`)."""
        phase = cast(Number, self.frame_values.states[machine.name])
        result, none_taken, unknown = phase, negation(FALSE), FALSE
        for transition in machine.transitions:
            absent = missing(transition.condition, self.frame_values)
            present = negation(absent)
            holds = self.expressions(present, machine.name).boolean(transition.condition)
            in_source = any_of(c for v, c in phase.cases if v in transition.sources)
            if transition.failsafe:
                taken = all_of((none_taken, in_source, either(absent, holds)))
            else:
                taken = all_of((none_taken, in_source, present, holds, negation(unknown)))
                unknown = either(unknown, both(in_source, absent))
            none_taken = both(none_taken, negation(taken))
            result = cast(Number, select(taken, constant(transition.target), result))
        self._set_next[machine.name](result)

    # --- modules ---------------------------------------------------------------------------------

    def encode_modules(self) -> tuple[dict[str, ModuleTerms], dict[str, PythonInput]]:
        """Encode every module; return their terms and the answers of those in Python."""
        terms_by_module: dict[str, ModuleTerms] = {}
        python: dict[str, PythonInput] = {}
        actuators = {a.name: a for a in self.program.robot.actuators}
        for module in self.program.modules:
            match module:
                case ir.Module():
                    terms = self._module(module)
                case ir.PythonModule():
                    actuator = actuators[module.actuator] if module.actuator else None
                    python_input = python[module.name] = python_answers(module, actuator, self.builder)
                    terms = self._python_module(module, python_input)
                case _:
                    assert_never(module)
            terms_by_module[module.name] = terms
            self.frame_values.active[module.name] = terms.active
        return terms_by_module, python

    def _module(self, module: ir.Module) -> ModuleTerms:
        """Encode a module: unless it is silent, all of it is evaluated, even if its predicate is false."""
        fields = module.command.fields if module.command else ()
        updates = [s.next for s in module.states if s.next is not None]
        evaluated: list[Expression] = [let.expression for let in module.lets]
        evaluated += [module.when, *fields, *updates]
        own_lets = frozenset(let.name for let in module.lets)
        silent = any_of(missing(e, self.frame_values, own_lets) for e in evaluated)
        encoder = self.expressions(negation(silent), module.name, own_lets)
        for let in module.lets:
            self.frame_values.locals[let.name] = (
                silent,
                self._named(encoder.value(let.expression), let.name),
            )
        applicable = encoder.boolean(module.when)
        command = tuple(encoder.scalar(e) for e in fields)
        for state in module.states:
            if state.next is None:
                self._set_unchanged(state.name)
            else:
                old = self.frame_values.states[state.name]
                self._set_next[state.name](select(silent, old, encoder.scalar(state.next)))
        blind = silent if module.failsafe else FALSE
        return ModuleTerms(
            silent=silent,
            blind=blind,
            applicable=applicable,
            active=either(blind, both(applicable, negation(silent))),
            command=command,
        )

    def _python_module(self, module: ir.PythonModule, python_input: PythonInput) -> ModuleTerms:
        silent = any_of(missing(r.expression, self.frame_values) for r in module.reads)
        blind = either(silent, python_input.blind) if module.failsafe else FALSE
        return ModuleTerms(
            silent=silent,
            blind=blind,
            applicable=python_input.answers,
            active=either(blind, both(python_input.answers, negation(silent))),
            command=python_input.fields,
        )
