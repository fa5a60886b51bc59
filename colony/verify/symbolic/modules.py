"""Derived values and modules: when they are missing or silent, their values, and their memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import assert_never, cast

import z3

from colony.ir import expression as ir
from colony.ir import program as program_ir
from colony.ir.expression import Binary, Expression, Function
from colony.ir.types import Scalar as ScalarType
from colony.ir.types import ScalarValue, element_type
from colony.verify.symbolic.arithmetic import Arithmetic, nearest
from colony.verify.symbolic.builder import SymbolicValues, SystemBuilder, missing
from colony.verify.symbolic.cases import constant
from colony.verify.symbolic.expressions import (
    ExpressionEncoder,
    Positions,
    SymbolicRound,
    element_of,
    index_at,
    size_of,
    within,
)
from colony.verify.symbolic.functions import apply, binary, boolean, index_of, number, reduction, unary
from colony.verify.symbolic.inputs import python_answers
from colony.verify.symbolic.logic import FALSE, TRUE, all_of, any_of, both, either, negation, same
from colony.verify.symbolic.memory import open_scalar_cell, recall
from colony.verify.symbolic.numbers import select
from colony.verify.symbolic.system import ExtendedReal, ModuleTerms, PythonInput, Scalar, Term

# --- kleene -------------------------------------------------------------------------------------------
#
# Encoding of contracts in Kleene's three-valued logic (see `colony.verify.reference.kleene`).
#
# Each scalar has a term for its value and one for the condition that it is known. The value is arbitrary
# where it is not known.


@dataclass(frozen=True, slots=True)
class KnownScalar:
    """A scalar, and the condition that it is known."""

    value: Scalar
    known: z3.BoolRef


KnownTerm = KnownScalar | tuple[KnownScalar, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContractEncoder:
    """Encodes contracts; `expressions` encodes what has no operands, and positions in arrays."""

    expressions: ExpressionEncoder

    def holds(self, e: ir.Expression) -> z3.BoolRef:
        """Return the condition that a contract is known to be true."""
        result = scalar(self._value(e))
        return both(result.known, boolean(result.value))

    def _value(self, e: ir.Expression) -> KnownTerm:
        arithmetic = Arithmetic(self.expressions.builder, e.span)
        match e:
            case ir.UnaryOperation(operator=operator, operand=operand):
                return _each(partial(_strict, partial(unary, operator)), self._value(operand))
            case ir.BinaryOperation(operator=operator_, left=left, right=right):
                return _each(
                    lambda x, y: _binary(operator_, x, y, arithmetic), self._value(left), self._value(right)
                )
            case ir.Conditional(condition=condition, yes=yes, no=no):
                return _each(_choice, self._value(condition), self._value(yes), self._value(no))
            case ir.Within(operand=operand, low=low, high=high):
                return _each(partial(_strict, within), *map(self._value, (operand, low, high)))
            case ir.Nearest(angle=angle):
                x = scalar(self._value(angle))
                return KnownScalar(nearest(number(x.value), e.bearings, arithmetic), x.known)
            case ir.Element() | ir.Slice() | ir.Window():
                return self._array_access(e)
            case ir.ValueOr(expression=expression, other=other):
                return _each(_value_or, self._value(expression), self._value(other))
            case ir.FunctionCall():
                return self._call(e, arithmetic)
            case ir.Reduce():
                return self._reduce(e, arithmetic)
            case ir.MemoryCall():
                return _each(partial(self._memory, e), *map(self._value, e.arguments))
            case _:
                return self._leaf(e)

    def _leaf(self, e: ir.Expression) -> KnownTerm:
        if isinstance(e, ir.LoopElement):
            return cast("KnownScalar", self.expressions.element(e.name))
        known = negation(missing(e, self.expressions.frame_values))
        term = self.expressions.value(e)
        return (
            tuple(KnownScalar(x, known) for x in term)
            if isinstance(term, tuple)
            else KnownScalar(term, known)
        )

    def _memory(self, e: ir.MemoryCall, *x: KnownScalar) -> KnownScalar:
        """Encode a memory function of scalars, which moves on where its arguments are known."""
        types = [element_type(a.type) for a in e.arguments]
        known, own = all_of(v.known for v in x), self.expressions
        value = recall(e, [v.value for v in x], types, own.builder, own.frame_values, known, own.hint)
        return KnownScalar(value, known)

    # --- parts of arrays -------------------------------------------------------------------------

    def _array_access(self, e: ir.Element | ir.Slice | ir.Window) -> KnownTerm:
        array = elements(self._value(e.array))
        match e:
            case ir.Slice(indices=indices):
                return tuple(array[i] for i in indices)
            case ir.Element(index=index):
                return _element(array, *self._positions(index, len(array), e), 0)
            case ir.Window(center=center, reach=reach):
                positions, known = self._positions(center, len(array), e)
                return tuple(_element(array, positions, known, j) for j in range(-reach, reach + 1))

    def _positions(
        self, index: ir.Expression, size: int, e: ir.Element | ir.Window
    ) -> tuple[Positions, z3.BoolRef]:
        """Return the conditions that an index selects each element, and that it is known."""
        x = scalar(self._value(index))
        return self.expressions.positions(number(x.value), index, size, e), x.known

    # --- functions -------------------------------------------------------------------------------

    def _call(self, e: ir.FunctionCall, arithmetic: Arithmetic) -> KnownTerm:
        if e.function in ir.INDEX_FUNCTIONS:
            return self._index_function(e.function, e.arguments[0], arithmetic)
        values = [self._value(a) for a in e.arguments]
        if e.function in ir.REDUCTIONS:
            flat = [x for v in values for x in (v if isinstance(v, tuple) else (v,))]
            return _reduction(e.function, [(_ALWAYS, x) for x in flat], arithmetic)
        return _each(lambda *x: _strict(lambda *v: apply(e.function, v, arithmetic), *x), *values)

    def _index_function(self, function: Function, e: ir.Expression, arithmetic: Arithmetic) -> KnownScalar:
        """Return the index of the least or greatest element; for a slice or window, in the whole array."""
        match e:
            case ir.Slice(indices=sliced):
                values, indices = elements(self._value(e)), [constant(float(i)) for i in sliced]
            case ir.Window(array=array, center=center, reach=reach):
                whole = elements(self._value(array))
                positions, known = self._positions(center, size_of(array), e)
                reached = range(-reach, reach + 1)
                values = tuple(_element(whole, positions, known, j) for j in reached)
                indices = [index_at(positions, j) for j in reached]
            case _:
                values = elements(self._value(e))
                indices = [constant(float(i)) for i in range(len(values))]
        index = index_of(function, [number(x.value) for x in values], indices, arithmetic)
        return KnownScalar(index, all_of(x.known for x in values))

    def _reduce(self, e: ir.Reduce, arithmetic: Arithmetic) -> KnownScalar:
        items = []
        arrays = {name: elements(self._value(array)) for name, array in e.arrays}
        for k in range(e.low, e.high + 1):
            turn = SymbolicRound(e.variable, k, {name: array[k] for name, array in arrays.items()})
            loop = (*self.expressions.loop, turn)
            inner = replace(self, expressions=replace(self.expressions, loop=loop))
            condition = _ALWAYS if e.condition is None else scalar(inner._value(e.condition))
            items.append((condition, scalar(inner._value(e.body))))
        return _reduction(e.function, items, arithmetic)


_ALWAYS = KnownScalar(TRUE, TRUE)


def scalar(x: KnownTerm) -> KnownScalar:
    """Return a term that is a scalar."""
    assert isinstance(x, KnownScalar)
    return x


def elements(x: KnownTerm) -> tuple[KnownScalar, ...]:
    """Return the elements of an array's term."""
    assert isinstance(x, tuple)
    return x


def _each(operation: Callable[..., KnownScalar], *operands: KnownTerm) -> KnownTerm:
    """Apply `operation` element by element where an operand is an array; a scalar stands for all elements."""
    sizes = [len(x) for x in operands if isinstance(x, tuple)]
    if not sizes:
        return operation(*operands)
    return tuple(operation(*(x[i] if isinstance(x, tuple) else x for x in operands)) for i in range(sizes[0]))


def _strict(operation: Callable[..., Scalar], *x: KnownScalar) -> KnownScalar:
    """Apply an operation to values, unknown if one of them is."""
    return KnownScalar(operation(*(v.value for v in x)), all_of(v.known for v in x))


def _binary(operator: Binary, x: KnownScalar, y: KnownScalar, arithmetic: Arithmetic) -> KnownScalar:
    match operator:
        case Binary.AND:
            return _all((x, y))
        case Binary.OR:
            return _any((x, y))
        case Binary.IMPLIES:
            return _any((_not(x), y))
        case _:
            return _strict(lambda a, b: binary(operator, a, b, arithmetic), x, y)


def _not(x: KnownScalar) -> KnownScalar:
    return KnownScalar(negation(boolean(x.value)), x.known)


def _all(x: Sequence[KnownScalar]) -> KnownScalar:
    """Return the conjunction: known if all operands are, or if one is known to be false."""
    refuted = any_of(both(v.known, negation(boolean(v.value))) for v in x)
    return KnownScalar(all_of(boolean(v.value) for v in x), either(all_of(v.known for v in x), refuted))


def _any(x: Sequence[KnownScalar]) -> KnownScalar:
    """Return the disjunction: known if all operands are, or if one is known to be true."""
    proved = any_of(both(v.known, boolean(v.value)) for v in x)
    return KnownScalar(any_of(boolean(v.value) for v in x), either(all_of(v.known for v in x), proved))


def _choice(condition: KnownScalar, yes: KnownScalar, no: KnownScalar) -> KnownScalar:
    chosen = boolean(condition.value)
    known = both(condition.known, cast(z3.BoolRef, select(chosen, yes.known, no.known)))
    return KnownScalar(select(chosen, yes.value, no.value), known)


def _value_or(x: KnownScalar, other: KnownScalar) -> KnownScalar:
    return KnownScalar(select(x.known, x.value, other.value), either(x.known, other.known))


def _reduction(
    function: Function, items: Sequence[tuple[KnownScalar, KnownScalar]], arithmetic: Arithmetic
) -> KnownScalar:
    """Return `any` and `all` as `or` and `and`; any other reduction is unknown if a part is."""
    match function:
        case Function.ANY:
            return _any([_all(item) for item in items])
        case Function.ALL:
            return _all([_any((_not(condition), body)) for condition, body in items])
        case _:
            included = [(body.value, boolean(condition.value)) for condition, body in items]
            known = all_of(x.known for item in items for x in item)
            return KnownScalar(reduction(function, included, arithmetic), known)


def _element(
    array: Sequence[KnownScalar], positions: Positions, index_known: z3.BoolRef, offset: int
) -> KnownScalar:
    """Return the element `offset` after the selected one, unknown if there is none."""
    value = element_of([x.value for x in array], positions, offset)
    known = array[0].known
    if not all(same(x.known, known) for x in array):
        known = boolean(element_of([x.known for x in array], positions, offset))
    return KnownScalar(value, all_of((index_known, positions.is_inside(offset), known)))


# --- modules ------------------------------------------------------------------------------------------


class DeclarationEncoder:
    """Encodes a program's declarations in the order of a frame. Mutable: fills `frame_values`."""

    def __init__(
        self, program: program_ir.Program, builder: SystemBuilder, frame_values: SymbolicValues
    ) -> None:
        self.program = program
        self.builder = builder
        self.frame_values = frame_values
        self._set_next: dict[str, Callable[[Scalar], None]] = {}

    def expressions(
        self, advances: z3.BoolRef, hint: str, own_lets: frozenset[str] = frozenset()
    ) -> ExpressionEncoder:
        """Return an encoder of expressions whose memory advances where `advances` holds."""
        return ExpressionEncoder(
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
                case program_ir.State(name=name, type=type_, initial=initial):
                    self._open_state(name, type_, initial)
                case program_ir.Machine(name=name, type=phases, start=start):
                    self._open_state(name, phases, start)
                case program_ir.Let():
                    pass
                case _:
                    assert_never(derived)
        for module in self.program.modules:
            for state in module.states if isinstance(module, program_ir.Module) else ():
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
                case program_ir.Let(name=name, expression=expression):
                    absent = missing(expression, self.frame_values)
                    value = self.expressions(negation(absent), name).value(expression)
                    self.frame_values.derived[name] = (absent, self._named(value, name))
                case program_ir.State(name=name, next=None):
                    self._set_unchanged(name)
                case program_ir.State(name=name, next=update):
                    assert update is not None
                    present = negation(missing(update, self.frame_values))
                    value = self.expressions(present, name).scalar(update)
                    self._set_next[name](select(present, value, self.frame_values.states[name]))
                case program_ir.Machine():
                    self._machine(derived)
                case _:
                    assert_never(derived)

    def _named(self, value: Term, name: str) -> Term:
        if isinstance(value, tuple):
            return tuple(self.builder.named(x, f"{name}[{i}]") for i, x in enumerate(value))
        return self.builder.named(value, name)

    def _machine(self, machine: program_ir.Machine) -> None:
        """Take the first transition from the current phase that applies (see `program_ir.Machine`)."""
        phase = cast(ExtendedReal, self.frame_values.states[machine.name])
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
            result = cast(ExtendedReal, select(taken, constant(transition.target), result))
        self._set_next[machine.name](result)

    # --- modules ---------------------------------------------------------------------------------

    def encode_modules(self) -> tuple[dict[str, ModuleTerms], dict[str, PythonInput]]:
        """Encode every module; return their terms and the answers of those in Python."""
        terms_by_module: dict[str, ModuleTerms] = {}
        python: dict[str, PythonInput] = {}
        actuators = {a.name: a for a in self.program.robot.actuators}
        for module in self.program.modules:
            match module:
                case program_ir.Module():
                    terms = self._module(module)
                case program_ir.PythonModule():
                    actuator = actuators[module.actuator] if module.actuator else None
                    python_input = python[module.name] = python_answers(module, actuator, self.builder)
                    terms = self._python_module(module, python_input)
                case _:
                    assert_never(module)
            terms_by_module[module.name] = terms
            self.frame_values.active[module.name] = terms.active
        return terms_by_module, python

    def _module(self, module: program_ir.Module) -> ModuleTerms:
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

    def _python_module(self, module: program_ir.PythonModule, python_input: PythonInput) -> ModuleTerms:
        silent = any_of(missing(r.expression, self.frame_values) for r in module.reads)
        blind = either(silent, python_input.blind) if module.failsafe else FALSE
        return ModuleTerms(
            silent=silent,
            blind=blind,
            applicable=python_input.answers,
            active=either(blind, both(python_input.answers, negation(silent))),
            command=python_input.fields,
        )
