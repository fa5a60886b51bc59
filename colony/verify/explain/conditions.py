"""Formulas of conditions: what makes an expression true or false in a moment.

A boolean operation is a group of its operands, and a `let` the group of its expression. Whatever else is true
or false is a leaf, with the values that it reads.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Iterable, Mapping
from typing import Any, Protocol

from colony.ir import expression as ir
from colony.ir.program import Let, Module
from colony.ir.types import Array, Bool
from colony.verify.explain.causes import Constant, Present, Reading, Remembered, Unknown
from colony.verify.explain.comparisons import comparison, inputs_text
from colony.verify.explain.formula import Formula, Key, Leaf, all_leaves, group, negation
from colony.verify.explain.memory import past_recently, past_sustained, remembered, rests_on_past_alone
from colony.verify.explain.moment import Moment
from colony.verify.explain.values import value_text
from colony.verify.reference.boundary import default_of
from colony.verify.reference.expressions import evaluate, missing
from colony.verify.reference.kleene import Known, known_value
from colony.verify.source_text import source_text

MAX_NESTED_LETS = 40
"""Maximum number of lets that are looked into, one within the other."""


class NetworkFormulas(Protocol):
    """The formulas of what contracts say about the network."""

    def active(self, name: str) -> Formula:
        """Return the formula of "this module or wire is active"."""
        ...

    def is_by(self, actuator: str, module: str) -> Formula:
        """Return the formula of "the actuator is by this module"."""
        ...

    def is_commanded(self, actuator: str) -> Formula:
        """Return the formula of "a module's command is sent to this actuator"."""
        ...


class Conditions:
    """Builds the formulas of expressions in one moment. Stateful: remembers those of lets.

    `network` gives the formulas of what contracts say about the network.
    """

    def __init__(self, moment: Moment, network: NetworkFormulas) -> None:
        self._moment, self._network = moment, network
        self._lets: dict[str, Formula] = {}
        self._nested = 0
        self._numbers: dict[ir.Expression, int] = {}
        self._file_lets = {d.name: d for d in moment.program.derived if isinstance(d, Let)}
        modules = (m for m in moment.program.modules if isinstance(m, Module))
        self._local_lets = {let.name: let for m in modules for let in m.lets}

    def value(self, e: ir.Expression) -> Known:
        """Return the value of an expression; it advances no memory."""
        memory: Any = ChainMap({}, self._moment.memory)
        if missing(e, self._moment.values):
            return known_value(e, self._moment.values, memory)
        return evaluate(e, self._moment.values, memory)

    def formula(self, e: ir.Expression) -> Formula:
        """Return the formula of a scalar boolean expression."""
        match e:
            case ir.UnaryOperation(operator=ir.Unary.NOT, operand=operand):
                return negation(self.formula(operand))
            case ir.BinaryOperation():
                return self._operation(e)
            case ir.Within():
                return self._compared(e)
            case ir.Conditional(condition=condition, yes=yes, no=no):
                chosen = self.formula(condition)
                taken = group("all", (chosen, self.formula(yes)))
                return group("any", (taken, group("all", (negation(chosen), self.formula(no)))))
            case ir.Call(function=ir.Function.ANY | ir.Function.ALL as f, arguments=arguments) if all(
                not isinstance(a.type, Array) for a in arguments
            ):
                return group("any" if f is ir.Function.ANY else "all", [*map(self.formula, arguments)])
            case ir.ValueOr(expression=expression, other=other) if not isinstance(expression, ir.Element):
                return self.formula(other if missing(expression, self._moment.values) else expression)
            case ir.MemoryCall() if not any(isinstance(a.type, Array) for a in e.arguments):
                return self._recalled(e)
            case _:
                return self._named(e)

    def _operation(self, e: ir.BinaryOperation) -> Formula:
        match e.operator:
            case ir.Binary.AND:
                return group("all", self._flat(e.operator, e.left, e.right))
            case ir.Binary.OR:
                return group("any", self._flat(e.operator, e.left, e.right))
            case ir.Binary.IMPLIES:
                return group("any", (negation(self.formula(e.left)), self.formula(e.right)))
            case _:
                return self._compared(e)

    def _named(self, e: ir.Expression) -> Formula:
        """Return the formula of what has a name: a let, a module, a wire, a sensor that is fresh."""
        match e:
            case ir.DerivedValue(name=name):
                return self._let(name, self._file_lets, e)
            case ir.LocalValue(name=name):
                return self._let(name, self._local_lets, e)
            case ir.Fresh(name=name, derived=False):
                return self.present(name)
            case ir.Fresh(name=name, derived=True):
                let = self._file_lets[name]
                return group("all", self.presence([let.expression]), subject="let", name=name, span=let.span)
            case ir.IsActive(name=name):
                return self._agreeing(e, self._network.active(name))
            case ir.WonBy(actuator=actuator, module=module):
                return self._agreeing(e, self._network.is_by(actuator, module))
            case ir.IsCommanded(actuator=actuator):
                return self._agreeing(e, self._network.is_commanded(actuator))
            case ir.IsIdle(actuator=actuator):
                return self._agreeing(e, negation(self._network.is_commanded(actuator)))
            case _:
                return self._leaf(e)

    def _agreeing(self, e: ir.Expression, formula: Formula) -> Formula:
        """Return a formula, if it has the value that the interpreter found; else `e` without its parts."""
        return formula if formula.holds == (self.value(e) is True) else self._leaf(e)

    def _flat(self, operator: ir.Binary, *operands: ir.Expression) -> list[Formula]:
        """Return the formulas of the operands of a chain `a and b and c`."""
        parts: list[Formula] = []
        for operand in operands:
            match operand:
                case ir.BinaryOperation(operator=same, left=left, right=right) if same is operator:
                    parts += self._flat(operator, left, right)
                case _:
                    parts.append(self.formula(operand))
        return parts

    def _let(self, name: str, lets: Mapping[str, Let], e: ir.Expression) -> Formula:
        let = lets.get(name)
        if let is None or self._nested >= MAX_NESTED_LETS:
            return self._leaf(e)
        found = self._lets.get(name)
        if found is None:
            self._nested += 1
            part = self.formula(let.expression)
            self._nested -= 1
            found = group("all", (part,), subject="let", name=name, span=let.span)
            self._lets[name] = found
        return found

    def _key(self, e: ir.Expression) -> Key:
        return "expression", self._number(e)

    def entangled(self, formula: Formula) -> frozenset[Key]:
        """Return the conditions on which others of a formula depend, and those about missing sensors."""
        found = all_leaves(formula)
        numbers = {key: self._number(leaf.node) for key, leaf in found.items() if leaf.node is not None}
        read = {n for leaf in found.values() if leaf.node is not None for n in self._reads(leaf.node)}
        return frozenset(key for key in found if numbers.get(key) in read or key[0] == "present")

    def _reads(self, root: ir.Expression) -> set[int]:
        """Return the numbers of the boolean expressions within one, also by way of lets."""
        found: set[int] = set()
        lets: set[str] = set()
        work = [] if rests_on_past_alone(root) else [*ir.children(root)]
        while work:
            e = work.pop()
            if isinstance(e.type, Bool):
                found.add(self._number(e))
            if isinstance(e, ir.DerivedValue | ir.LocalValue) and e.name not in lets:
                lets.add(e.name)
                lets_of = self._file_lets if isinstance(e, ir.DerivedValue) else self._local_lets
                work.append(lets_of[e.name].expression)
            work.extend(ir.children(e))
        return found

    def _number(self, e: ir.Expression) -> int:
        """Return the number of an expression; equal ones have one value, and change together."""
        return self._numbers.setdefault(e, len(self._numbers))

    # --- leaves ----------------------------------------------------------------------------------

    def _compared(self, e: ir.BinaryOperation | ir.Within) -> Formula:
        value = self.value(e)
        if value is None:
            return self._unknown(e)
        cause = comparison(self._moment, e, self.value)
        return Leaf(holds=value is True, cause=cause, key=self._key(e), span=e.span, node=e)

    def _unknown(self, e: ir.Expression) -> Leaf:
        absent = tuple(str(leaf.key[1]) for leaf in self.presence([e]) if not leaf.holds)
        cause = Unknown(condition=source_text(e), missing=absent)
        return Leaf(holds=False, cause=cause, key=self._key(e), span=e.span, node=e, fixed=True)

    def _leaf(self, e: ir.Expression) -> Leaf:
        """Return a condition without parts."""
        value = self.value(e)
        if value is None:
            return self._unknown(e)
        holds = value is True
        match e:
            case ir.Constant():
                cause = Constant(condition=source_text(e) or ("true" if holds else "false"))
                return Leaf(holds=holds, cause=cause, key=self._key(e), span=e.span, node=e, fixed=True)
            case ir.StateValue(name=name):
                since = self._moment.earlier.states.get(name)
                remembered = Remembered(
                    condition=name,
                    value=value_text(value, e.type),
                    since_ns=None if since is None or since.first else since.t_ns,
                )
                return Leaf(holds=holds, cause=remembered, key=("state", name), span=e.span, node=e)
            case ir.SensorValue(name=name):
                reading = Reading(condition=name)
                return Leaf(holds=holds, cause=reading, key=("sensor", name), span=e.span, node=e)
            case _:
                reading = Reading(condition=source_text(e), detail=inputs_text(e, self.value))
                return Leaf(holds=holds, cause=reading, key=self._key(e), span=e.span, node=e)

    def present(self, sensor: str) -> Leaf:
        """Return the condition that a sensor has a value."""
        moment = self._moment
        declared = next(s for s in moment.program.robot.sensors if s.name == sensor)
        is_fresh = sensor in moment.values.fresh
        since = moment.history.sensors.get(sensor)
        missing_since = None if is_fresh or since is None or since.first else since.t_ns
        return Leaf(
            holds=is_fresh,
            cause=Present(
                sensor=sensor,
                server=declared.server,
                why=None if is_fresh else moment.absent.get(sensor, "no reading"),
                since_ns=missing_since,
                within_ns=declared.within_ns,
            ),
            key=("present", sensor),
            span=declared.span,
        )

    def presence(self, expressions: Iterable[ir.Expression]) -> tuple[Leaf, ...]:
        """Return the conditions that no value is missing that expressions need."""
        found: dict[str, None] = {}
        seen: set[str] = set()
        work = [*expressions]
        while work:
            match work.pop():
                case ir.SensorValue(name=name):
                    found[name] = None
                case ir.DerivedValue(name=name) if name not in seen:
                    seen.add(name)
                    work.append(self._file_lets[name].expression)
                case ir.LocalValue(name=name) if name not in seen:
                    seen.add(name)
                    work.append(self._local_lets[name].expression)
                case ir.ValueOr(other=other):
                    work.append(other)
                case e:
                    work.extend(ir.children(e))
        sensors = self._moment.program.robot.sensors
        return tuple(self.present(s.name) for s in sensors if s.name in found and default_of(s) is None)

    # --- memory ----------------------------------------------------------------------------------

    def _recalled(self, e: ir.MemoryCall) -> Formula:
        """Return the formula of a boolean memory function: what it reads now, and what it remembers."""
        if self.value(e) is None:
            return self._unknown(e)
        moment = self._moment
        last: Any = moment.memory.get((e.cell, (), 0))
        match e.function:
            case ir.MemoryFunction.RECENTLY:
                return group("any", (self.formula(e.arguments[0]), past_recently(moment, e, last)))
            case ir.MemoryFunction.SUSTAINED:
                is_true = self.value(e.arguments[0]) is True
                past = past_sustained(moment, e, last, is_true=is_true)
                return group("all", (self.formula(e.arguments[0]), past))
            case ir.MemoryFunction.LATCH:
                latched = remembered(moment, e, value=bool(last), condition="latched")
                was = group("any", (latched, self.formula(e.arguments[0])))
                return group("all", (was, negation(self.formula(e.arguments[1]))))
            case ir.MemoryFunction.RISING:
                return group("all", (self.formula(e.arguments[0]), negation(self._previous(e, last))))
            case ir.MemoryFunction.FALLING:
                return group("all", (negation(self.formula(e.arguments[0])), self._previous(e, last)))
            case _:
                return remembered(moment, e, value=self.value(e) is True)

    def _previous(self, e: ir.MemoryCall, last: object) -> Leaf:
        """Return the condition that the argument of a memory function was true in the frame before."""
        before = f"previous({source_text(e.arguments[0])})"
        return remembered(self._moment, e, value=bool(last), condition=before)
