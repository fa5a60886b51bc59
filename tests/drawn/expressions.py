"""Random expressions of a given type, as text that the front end accepts.

Types, dimensions and array lengths are correct by construction. Compound expressions are in parentheses, so
that precedence does not matter here (the parser's own tests cover it).
"""

from __future__ import annotations

from collections.abc import Callable

from colony.ir.types import BOOL, Array, Bool, Enum, Quantity, Scalar, Type, element_type
from colony.text.units import ANGLE, LENGTH, NUMBER, TIME, Dimension
from tests.drawn.array_expressions import ArrayExpressions
from tests.drawn.bearings import angle_text
from tests.drawn.scope import (
    DURATIONS_MS,
    LITERALS,
    ODD_NUMBERS,
    SPEED,
    TURN_RATE,
    Scope,
)


class Expressions(ArrayExpressions):
    """Draws expressions over one scope. `depth` bounds the nesting of operators."""

    def inside(self, scope: Scope) -> Expressions:
        """Return what draws expressions over another scope."""
        return Expressions(self.choices, scope)

    def any_scalar(self) -> Scalar:
        """Draw a type that expressions of this scope can have."""
        scalars: list[Scalar] = [BOOL, *(Quantity(d) for d in LITERALS), *self.scope.enums]
        return self.choices.pick(scalars)

    def scalar(self, of: Scalar, depth: int) -> str:
        """Return the text of an expression of a scalar type."""
        match of:
            case Bool():
                return self.bool(depth)
            case Enum():
                return self.enum(of, depth)
            case Quantity(dimension=dimension):
                return self.quantity(dimension, depth)

    def any_value(self, of: Type, depth: int) -> str:
        """Draw an expression of a scalar type, or of an array type with the length of an array in scope."""
        if isinstance(of, Array):
            return self.array(element_type(of), of.size, depth)
        return self.scalar(of, depth)

    # --- bools -----------------------------------------------------------------------------------

    def bool(self, depth: int) -> str:
        """Return the text of a condition."""
        if depth <= 0 or self.choices.one_in(5):
            fresh = [f"fresh({n.text})" for n in self.scope.names if n.fresh]
            if fresh and self.choices.one_in(6):
                return self.choices.pick(fresh)
            read = [*self.atoms(BOOL), *self.scope.contract_conditions]
            constants = ("true", "false", "restarted")
            return self.choices.pick(constants if not read or self.choices.one_in(8) else read)
        makers: list[Callable[[int], str]] = [self._comparison, self._logic, self._comparison]
        if self.scope.memory:
            makers += [self._bool_memory, self._bool_memory]
        makers += [self._bool_reduction, self._in_range, self._bool_other]
        return self.choices.pick(makers)(depth - 1)

    def _logic(self, depth: int) -> str:
        operator = self.choices.pick(("not", "and", "or", "implies", "==", "!="))
        if operator == "not":
            return f"(not {self.bool(depth)})"
        return f"({self.bool(depth)} {operator} {self.bool(depth)})"

    def _comparison(self, depth: int) -> str:
        enums = [n for n in self.scope.names if isinstance(n.type, Enum)]
        operators = ("<", "<=", ">", ">=", "==", "!=")
        if enums and self.choices.one_in(3):
            one = self.choices.pick(enums)
            assert isinstance(one.type, Enum)
            return f"({one.text} {self.choices.pick(operators[-2:])} {self.member(one.type)})"
        dimension = self.dimension()
        right = "0" if self.choices.one_in(4) else self.quantity(dimension, depth - 1)
        return f"({self.quantity(dimension, depth)} {self.choices.pick(operators)} {right})"

    def _in_range(self, depth: int) -> str:
        d = self.dimension()
        low, high = self.quantity(d, depth - 1), self.quantity(d, depth - 1)
        return f"({self.quantity(d, depth)} in {low} .. {high})"

    def _bool_reduction(self, depth: int) -> str:
        function = self.choices.pick(("any", "all"))
        array = self.some_array(BOOL, depth)
        if array is not None and not self.choices.one_in(4):
            return f"{function}({array})"
        return self.comprehension(function, BOOL, depth)

    def _bool_memory(self, depth: int) -> str:
        kind = self.choices.pick(
            (
                "recently",
                "sustained",
                "rising",
                "latch",
                "changed",
                "falling",
                "every",
                "previous",
                "captured",
            )
        )
        match kind:
            case "recently" | "sustained":
                return f"{kind}({self.bool(depth)}, {self.duration()})"
            case "every":
                return f"every({self.duration()})"
            case "latch":
                return f"latch({self.bool(depth)}, {self.bool(depth - 1)})"
            case "changed":
                return f"changed({self.scalar(self.any_scalar(), depth)})"
            case "previous":
                return f"previous({self.bool(depth)}, {self.bool(0)})"
            case "captured":
                return f"captured({self.bool(depth)}, {self.key(depth)})"
            case _:
                return f"{kind}({self.bool(depth)})"

    def _bool_other(self, depth: int) -> str:
        arrays = self.arrays(BOOL)
        which = self.choices.up_to(3)
        if which <= 1 and arrays:
            return self.element_or(BOOL, self.choices.pick(arrays), depth)
        if which == 2:
            return f"value_or({self.bool(depth)}, {self.bool(depth - 1)})"
        return f"(if {self.bool(depth - 1)} then {self.bool(depth)} else {self.bool(depth)})"

    # --- enums -----------------------------------------------------------------------------------

    def member(self, of: Enum) -> str:
        """Return the text of an enumerator."""
        return f"{of.name}.{self.choices.pick(of.members)[0]}"

    def enum(self, of: Enum, depth: int) -> str:
        """Return the text of an expression of an enum."""
        if depth <= 0 or of.kind == "machine" or self.choices.one_in(3):
            arrays = self.arrays(of)
            if arrays and depth > 0 and self.choices.one_in(2):
                return self.element_or(of, self.choices.pick(arrays), depth - 1)
            return self.choices.pick((*self.atoms(of), f"{of.name}.{of.members[0][0]}", self.member(of)))
        condition, yes, no = self.bool(depth - 1), self.enum(of, depth - 1), self.enum(of, depth - 1)
        if self.scope.memory and self.choices.one_in(3):
            return f"captured({yes}, {condition})"
        return f"(if {condition} then {yes} else {no})"

    # --- numbers ---------------------------------------------------------------------------------

    def dimension(self) -> Dimension:
        """Draw a dimension, most often one that something readable has."""
        read = [e.dimension for n in self.scope.names if isinstance(e := element_type(n.type), Quantity)]
        known = [d for d in read if d in LITERALS]
        return (
            self.choices.pick(known)
            if known and not self.choices.one_in(5)
            else self.choices.pick([*LITERALS])
        )

    def literal(self, of: Dimension) -> str:
        """Return the text of a constant of a dimension."""
        text = self.choices.pick(LITERALS[of])
        return f"(-{text})" if self.choices.one_in(4) else text

    def quantity(self, of: Dimension, depth: int) -> str:
        """Return the text of an expression of a dimension."""
        if depth <= 0 or self.choices.one_in(5):
            return self._quantity_leaf(of)
        makers: list[Callable[[Dimension, int], str]] = [self._sum, self._product, self._several]
        makers += [self._choice, self._array_reduction, self._own, self._own]
        if self.scope.memory:
            makers += [self._quantity_memory]
        return self.choices.pick(makers)(of, depth - 1)

    def _quantity_leaf(self, of: Dimension) -> str:
        """Return mostly a value that changes each frame; made from a bool if nothing has the dimension."""
        params = self.scope.constants.get(of, ())
        if self.choices.one_in(4):
            return self.choices.pick(params) if params else self.literal(of)
        if self.choices.one_in(8):
            return f"({self.choices.pick(ODD_NUMBERS)} * {self.literal(of)})"
        atoms, arrays = self.atoms(Quantity(of)), self.arrays(Quantity(of))
        if arrays and self.choices.one_in(4):
            return self.element_or(Quantity(of), self.choices.pick(arrays), 0)
        if atoms:
            return self.choices.pick(atoms)
        if of == TIME:
            return self.choices.pick(("now", "now()"))
        bools = self.atoms(BOOL) or ["true"]
        return f"(if {self.choices.pick(bools)} then {self.literal(of)} else {self.literal(of)})"

    def atoms(self, of: Scalar) -> list[str]:
        """Return what can be read of a scalar type: names, and elements of arrays."""
        arrays = self.arrays(of)
        ahead = [f"{a.text}[{angle_text(a.type.bearings.angles[0])}]" for a in arrays if a.type.bearings]
        first = [f"{a.text}[0]" for a in arrays]
        last = [f"{a.text}[{a.type.size - 1}]" for a in arrays if a.type.size > 1]
        return [*self.scope.of(of), *first, *last, *ahead]

    def _sum(self, of: Dimension, depth: int) -> str:
        left, right = self.quantity(of, depth), self.quantity(of, depth)
        match self.choices.up_to(4):
            case 0:
                return f"({left} + {right})"
            case 1:
                return f"({left} - {right})"
            case 2:
                return f"(-{left})"
            case 3:
                return f"mod({left}, {right})"
            case _:
                return f"({left} + 0)"

    def _product(self, of: Dimension, depth: int) -> str:
        match self.choices.up_to(3):
            case 0:
                return f"({self.quantity(of, depth)} * {self.quantity(NUMBER, depth - 1)})"
            case 1:
                return f"({self.quantity(of, depth)} / {self.quantity(NUMBER, depth - 1)})"
            case 2 if of in (SPEED, TURN_RATE):
                return f"({self.quantity(of.times(TIME), depth)} / {self.quantity(TIME, depth - 1)})"
            case 2 if of in (LENGTH, ANGLE):
                return f"({self.quantity(of.over(TIME), depth)} * {self.quantity(TIME, depth - 1)})"
            case _:
                return f"({self.quantity(NUMBER, depth - 1)} * {self.quantity(of, depth)})"

    def _several(self, of: Dimension, depth: int) -> str:
        """Return a function of numbers of one dimension that gives one of it."""
        function = self.choices.pick(
            ("min", "max", "round", "sum", "abs", "clamp", "max", "ceil", "min", "mean", "sqrt", "floor")
        )
        count = {"abs": 1, "round": 1, "floor": 1, "ceil": 1, "clamp": 3}.get(function, 2)
        arguments = [self.quantity(of, depth if i == 0 else depth - 1) for i in range(count)]
        if function == "sqrt":
            return f"sqrt({arguments[0]} * {arguments[1]})"
        return f"{function}({', '.join(arguments)})"

    def _choice(self, of: Dimension, depth: int) -> str:
        one, other = self.quantity(of, depth), self.quantity(of, depth - 1)
        if self.choices.one_in(3):
            return f"value_or({one}, {other})"
        return f"(if {self.bool(depth)} then {one} else {other})"

    def _array_reduction(self, of: Dimension, depth: int) -> str:
        arrays = self.arrays(Quantity(of))
        which = self.choices.up_to(4)
        if arrays and which <= 1:
            return self.element_or(Quantity(of), self.choices.pick(arrays), depth)
        function = self.choices.pick(("min", "max", "sum", "mean"))
        array = self.some_array(Quantity(of), depth)
        if array is not None and which <= 3:
            return f"{function}({array})"
        return self.comprehension(function, Quantity(of), depth)

    def _own(self, of: Dimension, depth: int) -> str:
        """Return the text of an expression that exists only for numbers, angles or times."""
        if of == ANGLE:
            d = self.dimension()
            match self.choices.up_to(4):
                case 0 | 1:
                    return f"atan2({self.quantity(d, depth)}, {self.quantity(d, depth)})"
                case 2:
                    return f"{self.choices.pick(('asin', 'acos'))}({self.quantity(NUMBER, depth)})"
                case _:
                    return f"angle_difference({self.quantity(ANGLE, depth)}, {self.quantity(ANGLE, depth)})"
        if of == TIME:
            return f"elapsed({self.bool(depth)})" if self.scope.memory else "now()"
        if of != NUMBER:
            return self._sum(of, depth)
        match self.choices.up_to(9):
            case 8:
                return f"round({self.quantity(NUMBER, depth)} + 0.5)"  # halves: where roundings differ
            case 0 | 6:
                array = self.some_array(BOOL, depth)
                return self.comprehension("count", BOOL, depth) if array is None else f"count({array})"
            case 1 | 7:
                return self.index_function(depth)
            case 2:
                return f"{self.choices.pick(('sin', 'cos', 'tan'))}({self.quantity(ANGLE, depth)})"
            case 3:
                return f"sign({self.quantity(self.dimension(), depth)})"
            case 4 | 9:
                d = self.dimension()
                return f"({self.quantity(d, depth)} / {self.quantity(d, depth - 1)})"
            case _:
                return f"count({self.bool(depth)}, {self.bool(depth - 1)})"

    def _quantity_memory(self, of: Dimension, depth: int) -> str:
        if self.choices.one_in(2):
            return f"captured({self.quantity(of, depth)}, {self.key(depth)})"
        return f"previous({self.quantity(of, depth)}, {self.quantity(of, 0)})"

    # --- parts -----------------------------------------------------------------------------------

    def duration(self) -> str:
        """Return the text of a duration."""
        return f"{self.choices.pick(DURATIONS_MS)} ms"

    def key(self, depth: int) -> str:
        """Draw the key of `captured`, whose change it waits for."""
        return self.scalar(self.any_scalar(), depth - 1)
