"""What missing sensors make of expressions: which are missing with them, and what contracts say then."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from itertools import combinations

from colony.ir import expression as ir
from colony.ir.program import AnyModule, Let, Program
from colony.ir.types import Bool
from colony.ir.walk import expressions_of

Names = frozenset[str]
NONE: Names = frozenset()

Outcome = bool | str | None
"""A truth value, `_KNOWN` for any known value that is not a bool, or None for an unknown one."""

Outcomes = frozenset[Outcome]

_KNOWN = "known"
_UNKNOWN: Outcomes = frozenset({None})
_TRUTH: Outcomes = frozenset({True, False})

_EXHAUSTIVE_LIMIT = 6
"""Maximum number of sensors of which all combinations are tried."""


class Missing:
    """A program's sensors that can be missing, and the values that go missing with them."""

    def __init__(self, program: Program) -> None:
        self._sensors = frozenset(s.name for s in program.robot.sensors if s.default is None)
        self._holding = frozenset(a.name for a in program.robot.actuators if a.idle is None)
        self._lets: dict[str, Names] = {}
        for derived in program.derived:  # each after those that it reads
            if isinstance(derived, Let):
                self._lets[derived.name] = self.needs(derived.expression)
        self._modules: dict[str, Names] = {}
        self._local_lets: dict[str, Names] = {}
        self._failsafe = frozenset(m.name for m in program.modules if m.failsafe)
        for module in program.modules:
            self._add_module(module)

    def _add_module(self, module: AnyModule) -> None:
        needs = NONE.union(*(self.needs(e) for e in expressions_of(module)))
        self._modules[module.name] = needs
        for let in getattr(module, "lets", ()):
            self._local_lets[let.name] = needs

    def needs(self, e: ir.Expression) -> Names:
        """Return the sensors without any one of which an expression is missing."""
        match e:
            case ir.SensorValue(name=name):
                return frozenset({name}) & self._sensors
            case ir.DerivedValue(name=name):
                return self._lets[name]
            case ir.ValueOr(other=other):
                return self.needs(other)
            case _:
                return NONE.union(*(self.needs(child) for child in ir.children(e)))

    def unknown_without(self, contract: ir.Expression) -> tuple[str, ...] | None:
        """Return the fewest sensors without which a contract may be unknown, None if there are none.

        The result is empty if the contract may be unknown with all sensors. With many sensors, only single
        ones, pairs and all together are tried.
        """
        read = sorted(self._read(contract))
        sizes = range(len(read) + 1) if len(read) <= _EXHAUSTIVE_LIMIT else (0, 1, 2, len(read))
        for size in sizes:
            for missing in combinations(read, size):
                if None in _Evaluation(self, frozenset(missing)).outcomes(contract):
                    return missing
        return None

    def _read(self, contract: ir.Expression) -> Names:
        found: set[str] = set()
        for e in ir.subexpressions(contract):
            match e:
                case ir.SensorValue(name=name) | ir.Fresh(name=name, derived=False):
                    found |= {name} & self._sensors
                case ir.DerivedValue(name=name) | ir.Fresh(name=name):
                    found |= self._lets[name]
                case ir.LocalValue(name=name):
                    found |= self._local_lets[name]
                case _:
                    pass
        return frozenset(found)

    def is_silent(self, module: str, missing: Names) -> bool:
        """Return True if a module cannot be active without these sensors."""
        return module not in self._failsafe and bool(self._modules.get(module, NONE) & missing)

    def is_unknown(self, e: ir.Expression, missing: Names) -> bool | None:
        """Return True if a value that is read is missing without these sensors, None if it may be."""
        match e:
            case ir.SensorValue(name=name):
                return name in self._sensors & missing
            case ir.DerivedValue(name=name):
                return bool(self._lets[name] & missing)
            case ir.LocalValue(name=name):
                return bool(self._local_lets[name] & missing)
            case ir.SentField(actuator=actuator) if actuator in self._holding:
                return None
            case _:
                return False

    def is_fresh(self, e: ir.Fresh, missing: Names) -> Outcomes:
        """Return the possible values of `fresh`."""
        if e.derived:
            return frozenset({not self._lets[e.name] & missing})
        return frozenset({e.name not in missing}) if e.name in self._sensors else _TRUTH


class _Evaluation:
    """The possible outcomes of expressions in three-valued logic, without the sensors `missing`."""

    def __init__(self, program: Missing, missing: Names) -> None:
        self._program = program
        self._missing = missing
        self._elements: dict[str, Outcomes] = {}  # of the arrays of the enclosing reductions

    def outcomes(self, e: ir.Expression) -> Outcomes:
        match e:
            case ir.Constant(value=bool() as value):
                return frozenset({value})
            case ir.Fresh():
                return self._program.is_fresh(e, self._missing)
            case ir.WonBy(module=name) | ir.IsActive(name=name) if self._program.is_silent(
                name, self._missing
            ):
                return frozenset({False})
            case ir.ValueOr(expression=expression, other=other):
                found = self.outcomes(expression)
                return (found - _UNKNOWN) | (self.outcomes(other) if None in found else NO_OUTCOMES)
            case ir.UnaryOperation(operator=ir.Unary.NOT) if isinstance(e.type, Bool):
                return frozenset(None if x is None else not x for x in self.outcomes(e.operand))
            case ir.BinaryOperation(operator=operator) if operator in _LOGIC and isinstance(e.type, Bool):
                return _combined(_LOGIC[operator], self.outcomes(e.left), self.outcomes(e.right))
            case ir.Conditional(condition=condition, yes=yes, no=no):
                return self._conditional(self.outcomes(condition), yes, no)
            case ir.Call(function=ir.Function.ANY | ir.Function.ALL) if len(e.arguments) > 1:
                operation = _or if e.function is ir.Function.ANY else _and
                return reduce(
                    lambda a, b: _combined(operation, a, b), (self.outcomes(a) for a in e.arguments)
                )
            case ir.Reduce(function=ir.Function.ANY | ir.Function.ALL):
                return self._reduction(e)
            case ir.LoopElement(name=name) if name in self._elements:
                return self._elements[name]
            case _:
                return self._strict(e)

    def _conditional(self, condition: Outcomes, yes: ir.Expression, no: ir.Expression) -> Outcomes:
        found = condition & _UNKNOWN
        found |= self.outcomes(yes) if True in condition else NO_OUTCOMES
        return found | (self.outcomes(no) if False in condition else NO_OUTCOMES)

    def _reduction(self, e: ir.Reduce) -> Outcomes:
        is_any = e.function is ir.Function.ANY
        self._elements.update({name: self.outcomes(array) for name, array in e.arrays})
        one = self.outcomes(e.body)
        if e.condition is not None:
            one = _combined(_and if is_any else _implies, self.outcomes(e.condition), one)
        if e.low > e.high:
            return frozenset({not is_any})
        return one | _combined(_or if is_any else _and, one, one)

    def _strict(self, e: ir.Expression) -> Outcomes:
        """Return the outcomes of what is unknown if any part of it is."""
        known: Outcomes = _TRUTH if isinstance(e.type, Bool) else frozenset({_KNOWN})
        parts = [self.outcomes(child) for child in ir.children(e)]
        own = self._program.is_unknown(e, self._missing)
        if own or _UNKNOWN in parts:
            return _UNKNOWN
        return known | _UNKNOWN if own is None or any(None in part for part in parts) else known


NO_OUTCOMES: Outcomes = frozenset()


def _and(a: Outcome, b: Outcome) -> Outcome:
    if a is False or b is False:
        return False
    return None if a is None or b is None else True


def _or(a: Outcome, b: Outcome) -> Outcome:
    if a is True or b is True:
        return True
    return None if a is None or b is None else False


def _implies(a: Outcome, b: Outcome) -> Outcome:
    return _or(None if a is None else not a, b)


_LOGIC: dict[ir.Binary, Callable[[Outcome, Outcome], Outcome]] = {
    ir.Binary.AND: _and,
    ir.Binary.OR: _or,
    ir.Binary.IMPLIES: _implies,
}


def _combined(operation: Callable[[Outcome, Outcome], Outcome], a: Outcomes, b: Outcomes) -> Outcomes:
    return frozenset(operation(x, y) for x in a for y in b)
