"""What terms of a system are for given inputs and memory: exact rationals, with bounds of what floats round.

Independent of z3's solver and simplifier. A real carries how far the float that the program computes may be
from it; whatever that leaves open raises `OpenTermError`. So a formula without anything inexact is
always decided.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import z3

from colony.ir import angles
from colony.ir.expression import Function
from colony.verify.reference import expressions as floats
from colony.verify.symbolic.system import (
    Auxiliary,
    ExtendedReal,
    FactKind,
    Inexact,
    Operation,
    Scalar,
    System,
)

EPSILON = Fraction(1, 2**52)
TINY = Fraction(1, 2**1070)
GREATEST = Fraction(2) ** 1023


class OpenTermError(Exception):
    """Rounding, or what is only known in part, leaves the value open."""


@dataclass(frozen=True, slots=True)
class Real:
    """A real, and how far at most the program's float is from it."""

    value: Fraction
    error: Fraction = Fraction(0)


Known = bool | Real
Node = tuple[int, tuple[int, ...], object]


class Program:
    """The terms of a system, taken apart once. Mutable: grows as terms are asked for."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.nodes: dict[int, Node] = {}
        self.auxiliaries = {a.constant.get_id(): a for a in system.auxiliaries}
        self.definitions: dict[int, int] = {}
        self.rounding = {
            key for key, blamed in system.inexact.items() if blamed.reason.kind is not Inexact.PYTHON
        }
        for key, facts in system.facts.items():
            for fact in facts:
                if fact.kind is FactKind.DEFINITION and key not in self.auxiliaries:
                    self.definitions[key] = self.add(fact.formula.arg(1))
        for auxiliary in system.auxiliaries:
            for x in auxiliary.operands:
                for term in (x.value, x.nan, x.infinite):
                    self.add(term)

    def add(self, root: z3.ExprRef) -> int:
        waiting = [root]
        while waiting:
            term = waiting.pop()
            key = term.get_id()
            if key in self.nodes:
                continue
            operands = term.children()
            kind = term.decl().kind()
            self.nodes[key] = (kind, tuple(x.get_id() for x in operands), _leaf(term, kind))
            waiting.extend(operands)
        return int(root.get_id())


def _leaf(term: z3.ExprRef, kind: int) -> object:
    if z3.is_rational_value(term):
        return Real(Fraction(term.numerator_as_long(), term.denominator_as_long()))
    if z3.is_int_value(term):
        return Real(Fraction(term.as_long()))
    return None


class Values:
    """The values of terms in one frame, as they are asked for. `given` are inputs and cells, by id."""

    def __init__(self, program: Program, given: Mapping[int, Known | OpenTermError]) -> None:
        self.program = program
        self.known: dict[int, Known | OpenTermError] = dict(given)

    def truth(self, term: z3.BoolRef) -> bool:
        value = self._of(self.program.add(term))
        assert isinstance(value, bool)
        return value

    def real(self, term: z3.ArithRef) -> Real:
        value = self._of(self.program.add(term))
        assert isinstance(value, Real)
        return value

    def scalar(self, x: Scalar) -> bool | float | Real:
        """A truth, NaN or an infinity, or a real."""
        if not isinstance(x, ExtendedReal):
            return self.truth(x)
        if self.truth(x.nan):
            return math.nan
        if self.truth(x.infinite):
            value = self.real(x.value)
            if abs(value.value) <= value.error:
                raise OpenTermError
            return math.inf if value.value > 0 else -math.inf
        return self.real(x.value)

    def any(self, term: z3.ExprRef) -> Known:
        return self._of(self.program.add(term))

    # --- terms -----------------------------------------------------------------------------------

    def _of(self, key: int) -> Known:
        if key not in self.known:
            try:
                self.known[key] = self._computed(key)
            except OpenTermError as found:
                self.known[key] = found
        value = self.known[key]
        if isinstance(value, OpenTermError):
            raise value
        return value

    def _computed(self, key: int) -> Known:
        kind, operands, leaf = self.program.nodes[key]
        if leaf is not None:
            assert isinstance(leaf, Real)
            return leaf
        match kind:
            case z3.Z3_OP_TRUE:
                return True
            case z3.Z3_OP_FALSE:
                return False
            case z3.Z3_OP_NOT:
                return not self._of(operands[0])
            case z3.Z3_OP_AND:
                return self._connective(operands, absorbing=False)
            case z3.Z3_OP_OR:
                return self._connective(operands, absorbing=True)
            case z3.Z3_OP_ITE:
                chosen = self._of(operands[1] if self._of(operands[0]) else operands[2])
                return self._rounded(key, chosen) if isinstance(chosen, Real) else chosen
            case z3.Z3_OP_DISTINCT:
                return not self._comparison(z3.Z3_OP_EQ, operands)
            case z3.Z3_OP_EQ | z3.Z3_OP_LE | z3.Z3_OP_GE | z3.Z3_OP_LT | z3.Z3_OP_GT:
                return self._comparison(kind, operands)
            case z3.Z3_OP_UNINTERPRETED:
                return self._constant(key)
            case _:
                return self._rounded(key, self._arithmetic(kind, operands))

    def _connective(self, operands: tuple[int, ...], absorbing: bool) -> bool:
        """One operand may decide, even where another is open."""
        undecided: OpenTermError | None = None
        for operand in operands:
            try:
                if self._of(operand) is absorbing:
                    return absorbing
            except OpenTermError as found:
                undecided = found
        if undecided is not None:
            raise undecided
        return not absorbing

    def _comparison(self, kind: int, operands: tuple[int, ...]) -> bool:
        a, b = (self._of(x) for x in operands)
        if isinstance(a, bool):
            assert kind == z3.Z3_OP_EQ
            return a is b
        assert isinstance(a, Real)
        assert isinstance(b, Real)
        error = a.error + b.error
        if error and abs(a.value - b.value) <= error:
            raise OpenTermError
        match kind:
            case z3.Z3_OP_EQ:
                return a.value == b.value
            case z3.Z3_OP_LE:
                return a.value <= b.value
            case z3.Z3_OP_GE:
                return a.value >= b.value
            case z3.Z3_OP_LT:
                return a.value < b.value
            case _:
                return a.value > b.value

    def _arithmetic(self, kind: int, operands: tuple[int, ...]) -> Real:
        x = []
        for operand in operands:
            value = self._of(operand)
            assert isinstance(value, Real)
            x.append(value)
        match kind:
            case z3.Z3_OP_ADD:
                return Real(sum(v.value for v in x), sum(v.error for v in x))  # type: ignore[arg-type]
            case z3.Z3_OP_SUB:
                return Real(x[0].value - x[1].value, x[0].error + x[1].error)
            case z3.Z3_OP_UMINUS:
                return Real(-x[0].value, x[0].error)
            case z3.Z3_OP_MUL:
                return product(x[0], x[1])
            case z3.Z3_OP_TO_REAL:
                return x[0]
            case z3.Z3_OP_MOD:
                return Real(x[0].value % x[1].value)
            case _:
                raise AssertionError(f"operation {kind} is not known here")

    def _rounded(self, key: int, x: Real) -> Real:
        """With what one rounding may add; where a float could overflow all is open."""
        if key not in self.program.rounding:
            return x
        if abs(x.value) + x.error > GREATEST:
            raise OpenTermError
        return Real(x.value, x.error + (abs(x.value) + x.error) * EPSILON * 4 + TINY)

    # --- constants -------------------------------------------------------------------------------

    def _constant(self, key: int) -> Known:
        if key in self.program.auxiliaries:
            return self._auxiliary(self.program.auxiliaries[key])
        assert key in self.program.definitions, "an input or cell without a value"
        return self._of(self.program.definitions[key])

    def _overflows(self, x: ExtendedReal) -> bool:
        """Open where the float may be infinite; what it is for the real is false."""
        value = self.real(x.value)
        if abs(value.value) + value.error > GREATEST:
            raise OpenTermError
        return False

    def _auxiliary(self, auxiliary: Auxiliary) -> Known:
        """What the program computes in its place."""
        if auxiliary.operation is Operation.OVERFLOW:
            return self._overflows(auxiliary.operands[0])
        x = [self._operand(v) for v in auxiliary.operands]
        if auxiliary.operation is Operation.POLE:
            return self._is_pole(x[0])
        if auxiliary.operation in (Operation.FLOOR, Operation.ROUND):
            return _whole(auxiliary.operation, x[0])
        if auxiliary.operation in _EXTREMES:
            return _extreme(auxiliary.operation, x)
        if any(math.isnan(v) if isinstance(v, float) else v.error for v in x):
            return self._inexactly(auxiliary.operation, x)
        operands = [v if isinstance(v, float) else float(v.value) for v in x]
        if auxiliary.operation is Operation.QUOTIENT and operands[1] == 0:
            raise OpenTermError  # the sign of zero is not known
        if auxiliary.operation is Operation.ATAN2 and operands[0] == 0 and operands[1] < 0:
            raise OpenTermError  # nor here
        result = _FUNCTIONS[auxiliary.operation](*operands)
        if math.isnan(result):
            raise OpenTermError  # means nothing
        if math.isinf(result):
            if not any(isinstance(v, float) for v in x):
                raise OpenTermError  # overflow
            return Real(Fraction(1 if result > 0 else -1))
        exact = Fraction(result)
        if auxiliary.operation in (Operation.PRODUCT, Operation.QUOTIENT, Operation.MODULO):
            return Real(exact, abs(exact) * EPSILON * 4 + TINY)
        return Real(exact)

    def _is_pole(self, x: Real | float) -> bool:
        if isinstance(x, float) or x.error:
            raise OpenTermError
        return math.isinf(angles.tangent(float(x.value)))

    def _operand(self, x: ExtendedReal) -> Real | float:
        value = self.scalar(x)
        assert not isinstance(value, bool)
        return value

    def _inexactly(self, operation: Operation, x: list[Real | float]) -> Real:
        """Of operands of which the program's floats are not known exactly."""
        if operation is Operation.PRODUCT and isinstance(x[0], Real) and isinstance(x[1], Real):
            result = product(x[0], x[1])
            if abs(result.value) + result.error > GREATEST:
                raise OpenTermError
            return Real(result.value, result.error + abs(result.value) * EPSILON * 4 + TINY)
        raise OpenTermError


def product(x: Real, y: Real) -> Real:
    error = abs(x.value) * y.error + abs(y.value) * x.error + x.error * y.error
    return Real(x.value * y.value, error)


def _whole(operation: Operation, x: Real | float) -> Real:
    if isinstance(x, float):
        raise OpenTermError
    rounding = math.floor if operation is Operation.FLOOR else round
    low, high = rounding(x.value - x.error), rounding(x.value + x.error)
    if low != high:
        raise OpenTermError
    return Real(Fraction(low))


_EXTREMES = {
    Operation.LEAST: min,
    Operation.LEAST_IS_INFINITE: min,
    Operation.INDEX_OF_LEAST: min,
    Operation.GREATEST: max,
    Operation.GREATEST_IS_INFINITE: max,
    Operation.INDEX_OF_GREATEST: max,
}


def _extreme(operation: Operation, x: list[Real | float]) -> Known:
    if any(math.isnan(v) if isinstance(v, float) else v.error for v in x):
        raise OpenTermError  # NaN means nothing, and rounding may choose another
    values = [v if isinstance(v, float) else v.value for v in x]
    best = _EXTREMES[operation](values)
    if operation in (Operation.INDEX_OF_LEAST, Operation.INDEX_OF_GREATEST):
        return Real(Fraction(values.index(best)))
    if operation in (Operation.LEAST_IS_INFINITE, Operation.GREATEST_IS_INFINITE):
        return isinstance(best, float)
    return Real(Fraction((1 if best > 0 else -1) if isinstance(best, float) else best))


_FUNCTIONS = {
    Operation.PRODUCT: lambda x, y: x * y,
    Operation.QUOTIENT: floats.divide,
    Operation.MODULO: floats.modulo,
    Operation.SQRT: lambda x: floats.unary_function(Function.SQRT, x),
    Operation.SIN: lambda x: floats.unary_function(Function.SIN, x),
    Operation.COS: lambda x: floats.unary_function(Function.COS, x),
    Operation.TAN: lambda x: floats.unary_function(Function.TAN, x),
    Operation.ASIN: lambda x: floats.unary_function(Function.ASIN, x),
    Operation.ACOS: lambda x: floats.unary_function(Function.ACOS, x),
    Operation.ATAN2: angles.direction,
}
