"""Numbers for contents, and the contents of operations on scalars."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from functools import partial, reduce

from colony.ir.expression import Binary, Function, Unary
from colony.ir.types import ScalarValue
from colony.verify.reference import functions

Values = tuple[int, ...]
"""The contents of an expression's elements; a single one for a scalar."""


class Table:
    """Numbers for contents. Mutable; shared by all programs that are compared.

    Equal numbers stand for equal values in every frame, bit for bit.
    """

    def __init__(self) -> None:
        self._numbers: dict[Hashable, int] = {}
        self._constants: dict[int, ScalarValue] = {}

    def number(self, *content: Hashable) -> int:
        """Return the number of a content; a new content gets a new number."""
        return self._numbers.setdefault(content, len(self._numbers))

    def constant(self, value: ScalarValue) -> int:
        """Return the content of a constant; true and 1 differ, 0 and -0 too."""
        number = self.number("constant", repr(value))
        self._constants[number] = value
        return number

    def known(self, content: int) -> ScalarValue | None:
        """Return the value of a constant; None for all other contents."""
        return self._constants.get(content)

    # --- operations on scalars -------------------------------------------------------------------

    def apply(self, name: Hashable, function: Callable[..., ScalarValue], *operands: int) -> int:
        """Return the content of a pure function of scalars; `name` identifies the function."""
        values = [self._constants[x] for x in operands if x in self._constants]
        if len(values) == len(operands):
            return self.constant(function(*values))
        return self.number(name, *operands)

    def unary(self, operator: Unary, x: int) -> int:
        """Return the content of `operator x`."""
        return self.apply(operator, lambda value: functions.unary(operator, value), x)

    def binary(self, operator: Binary, x: int, y: int) -> int:
        """Return the content of `x operator y`."""
        return self.apply(operator, lambda a, b: functions.binary(operator, a, b), x, y)

    def call(self, function: Function, *x: int) -> int:
        """Return the content of a function of scalars, or of a reduction of them; a sum is that of `+`."""
        if function is Function.SUM and x:
            return reduce(partial(self.binary, Binary.ADD), x)
        return self.apply(function, lambda *values: functions.function(function, values), *x)

    def within(self, x: int, low: int, high: int) -> int:
        """Return the content of `x in low .. high`."""
        return self.apply("within", lambda v, lo, hi: lo <= v <= hi, x, low, high)

    def select(self, condition: int, yes: int, no: int) -> int:
        """Return the content of `if condition then yes else no`."""
        value = self.known(condition)
        if value is None:
            return yes if yes == no else self.number("select", condition, yes, no)
        return yes if value else no

    def reduction(self, function: Function, rounds: Sequence[tuple[int, int]]) -> int:
        """Return the content of a reduction, given (condition, value) of each round."""
        taken = [(c, x) for c, x in rounds if self.known(c) is not False]
        if all(self.known(c) is True for c, _ in taken):
            return self.call(function, *[x for _, x in taken])
        return self.number("reduction", function, *taken)

    # --- arrays ----------------------------------------------------------------------------------

    def is_inside(self, index: int, size: int, *, wraps: bool) -> bool | None:
        """Return whether an index is inside an array; None if it is not constant."""
        value = self.known(index)
        return None if value is None else functions.position(value, size, wraps) is not None

    def element(self, array: Values, index: int, *, wraps: bool, are_bools: bool) -> int:
        """Return the content of `array[index]`; NaN or false where the index is outside."""
        value = self.known(index)
        if value is None:
            return self.number("element", wraps, index, array)
        place = functions.position(value, len(array), wraps)
        if place is None:
            return self.constant(False if are_bools else functions.NAN)
        return array[place]
