"""Random expressions over arrays: elements, slices and windows by index or bearing, reductions.

Where the bearings of an array are known here (`NamedArray.type`), angles and slices are drawn that have
elements. Other arrays may have bearings, too, of which nothing is drawn.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace

from colony.ir.bearings import TURN, Bearings, between, nearest, part_by_bearing, part_by_index
from colony.ir.types import BOOL, DEGREES, DIMENSIONLESS, Array, Bool, Enum, Quantity, Scalar, element_type
from colony.text.units import ANGLE, NUMBER, Dimension
from colony.verify.testing.frames import Choices
from tests.drawn.bearings import angle_text, draw_angle
from tests.drawn.scope import Named, NamedArray, Scope

_MAX_ROUNDS = 48
"""Maximum number of rounds of nested reductions."""


class ArrayExpressions(ABC):
    """Draws expressions over the arrays of one scope. `depth` bounds the nesting of operators."""

    def __init__(self, choices: Choices, scope: Scope) -> None:
        self.choices = choices
        self.scope = scope

    @abstractmethod
    def inside(self, scope: Scope) -> ArrayExpressions:
        """Return what draws expressions over another scope."""

    @abstractmethod
    def scalar(self, of: Scalar, depth: int) -> str:
        """Return the text of an expression of a scalar type."""

    @abstractmethod
    def bool(self, depth: int) -> str:
        """Return the text of a condition."""

    @abstractmethod
    def quantity(self, of: Dimension, depth: int) -> str:
        """Return the text of an expression of a dimension."""

    @abstractmethod
    def member(self, of: Enum) -> str:
        """Return the text of an enumerator."""

    @abstractmethod
    def duration(self) -> str:
        """Return the text of a duration."""

    @abstractmethod
    def key(self, depth: int) -> str:
        """Draw the key of `captured`, whose change it waits for."""

    # --- arrays ----------------------------------------------------------------------------------

    def arrays(self, of: Scalar | None = None) -> list[NamedArray]:
        """Return the arrays in scope with elements of this type, or of any."""
        return [
            NamedArray(text=n.text, type=n.type)
            for n in self.scope.names
            if isinstance(n.type, Array) and of in (None, n.type.element)
        ]

    def some_array(self, of: Scalar, depth: int) -> str | None:
        """Draw an array with elements of type `of`, of any available length; None if there is none."""
        sizes = [a.type.size for a in self.arrays()]
        named = self.arrays(of)
        if not named and not (of == BOOL and sizes):
            return None
        match self.choices.up_to(3):
            case 0 if named:
                return self.slice_of(self.choices.pick(named)).text
            case 1 if named:
                return self._window(self.choices.pick(named), depth)
            case _:
                size = self.choices.pick(sizes if of == BOOL else [a.type.size for a in named])
                return self.array(of, size, depth)

    def array(self, of: Scalar, size: int, depth: int) -> str:
        """Draw an array of exactly `size` elements; the scope must have an array of that size."""
        named = [n.text for n in self.scope.names if n.type == Array(of, size)]
        if not named and isinstance(of, Bool):
            return self._compared(size, depth)
        assert named
        if depth <= 0 or self.choices.one_in(2):
            return self.choices.pick(named)
        return self._bool_array(size, depth - 1) if of == BOOL else self._number_array(of, size, depth - 1)

    def looking(self, depth: int, of: Scalar | None = None) -> NamedArray | None:
        """Draw an array whose bearings are known here; None if there is none with such elements."""
        named = [a for a in self.arrays(of) if a.type.bearings is not None]
        if not named:
            return None
        one = self.choices.pick(named)
        while self.choices.one_in(3):
            one = self.slice_of(one)
        if depth > 0 and of is None and self.choices.one_in(2):
            return self._elementwise(one, depth - 1)
        return one

    def _elementwise(self, one: NamedArray, depth: int) -> NamedArray:
        """Return an elementwise result of an array, which has its bearings."""
        text, element = one.text, one.type.element
        compared, kept = replace(one.type, element=BOOL), one.type
        options: list[tuple[str, Array]]
        match element:
            case Bool():
                options = [(f"(not {text})", kept), (f"({text} and {self.bool(depth)})", kept)]
                if self.scope.memory:
                    options += [(f"recently({text}, {self.duration()})", kept), (f"rising({text})", kept)]
            case Enum():
                options = [(f"({text} == {self.member(element)})", compared)]
            case Quantity(dimension=dimension):
                other = self.quantity(dimension, depth)
                options = [(f"({text} < {other})", compared), (f"({text} - {other})", kept)]
                options += [
                    (f"abs({text})", kept),
                    (f"(if {self.bool(depth)} then {text} else {other})", kept),
                ]
                options += [(f"({text} + {text})", kept), (f"value_or({text}, {other})", kept)]
                if self.scope.memory:
                    options += [(f"previous({text}, {other})", kept)]
        text, type_ = self.choices.pick(options)
        return NamedArray(text=text, type=type_)

    # --- parts -----------------------------------------------------------------------------------

    def slice_of(self, one: NamedArray) -> NamedArray:
        """Draw a slice of an array, by bearing or by index."""
        bearings = one.type.bearings
        if bearings is not None and self.choices.one_in(2):
            ends, indices = self._ends_by_bearing(bearings)
            if indices:
                type_ = Array(one.type.element, len(indices), part_by_bearing(bearings, indices))
                return NamedArray(text=f"{one.text}[{ends}]", type=type_)
        first, count = self._first_and_count(one.type)
        indices = tuple(i % one.type.size for i in range(first, first + count))
        last = first + count - 1
        if first >= 0 and last >= one.type.size and self.choices.one_in(2):
            last -= one.type.size  # the first is above the last
        looks = None if bearings is None else part_by_index(bearings, indices)
        return NamedArray(
            text=f"{one.text}[{first}..{last}]", type=Array(one.type.element, len(indices), looks)
        )

    def _ends_by_bearing(self, bearings: Bearings) -> tuple[str, tuple[int, ...]]:
        first, last = draw_angle(self.choices, bearings), draw_angle(self.choices, bearings)
        if self.choices.one_in(10):
            first, last = self.choices.pick(((-180.0, 180.0), (0.0, 360.0), (30.0, 390.0)))
        if last - first > TURN:
            first, last = last, first
        texts = [angle_text(first), angle_text(last)]
        if first == 0 and self.choices.one_in(2):
            texts[0] = "0"
        elif last == 0 and self.choices.one_in(2):
            texts[1] = "0"
        return "..".join(texts), between(bearings, first, last)

    def _first_and_count(self, type_: Array) -> tuple[int, int]:
        """Return where a slice by index begins, and its length, of which a ring that closes has more."""
        size = type_.size
        if type_.closes:
            first = self.choices.up_to(size - 1) + self.choices.pick((0, 0, 0, -size, size, 7 * size))
            return first, self.choices.between(1, size)
        ends = sorted((self.choices.up_to(size - 1), self.choices.up_to(size - 1)))
        return ends[0], ends[1] - ends[0] + 1

    def _window(self, one: NamedArray, depth: int) -> str:
        reach = self.choices.up_to((one.type.size - 1) // 2)
        if self.choices.one_in(2):
            center = self.quantity(NUMBER, min(depth, 1))
        else:
            center = self._whole_index(one, depth)
        return f"window({one.text}, {center}, {reach})"

    def element(self, one: NamedArray, depth: int) -> str:
        """Return an element at a constant or computed index, or along an angle."""
        bearings = one.type.bearings
        if bearings is not None and self.choices.one_in(2):
            return f"{one.text}[{self._angle(bearings, depth)}]"
        if self.choices.one_in(4):
            low, high = (-one.type.size, 3 * one.type.size) if one.type.closes else (0, one.type.size - 1)
            return f"{one.text}[{self.choices.between(low, high)}]"
        return f"{one.text}[{self._whole_index(one, depth)}]"

    def element_or(self, of: Scalar, one: NamedArray, depth: int) -> str:
        """Return an element of an array or of a part of it, perhaps with what stands for one outside."""
        if self.choices.one_in(4):
            one = self.slice_of(one)
        element = self.element(one, depth)
        return f"value_or({element}, {self.scalar(of, depth - 1)})" if self.choices.one_in(3) else element

    def _angle(self, bearings: Bearings, depth: int) -> str:
        """Return a constant angle that has an element, or one that is computed, which may have none."""
        if self.choices.one_in(4):
            angle = draw_angle(self.choices, bearings)
            return angle_text(angle if nearest(bearings, angle) is not None else bearings.angles[0])
        read = self.scope.of(DEGREES)
        computed = self.choices.pick(read) if read else "(now() / 1 s * 40 deg)"
        match self.choices.up_to(6):
            case 0 | 1 | 2 if read:
                return computed
            case 3:
                return f"({computed} + {angle_text(draw_angle(self.choices, bearings))})"
            case 4:
                return f"({computed} * {self.choices.pick(('1e6', '-7', '1e300', '(1 / 0)', '0.5'))})"
            case _:
                return f"({computed} + {self.quantity(ANGLE, depth - 1)})"

    def _whole_index(self, one: NamedArray, depth: int) -> str:
        """Return a computed index, which may be outside."""
        numbers, last = self.scope.of(DIMENSIONLESS), one.type.size - 1
        index = self.choices.pick(numbers) if numbers and self.choices.one_in(2) else None
        index = index or self.index_function(depth)
        match self.choices.up_to(6):
            case 0 | 1:
                return index
            case 2:
                return f"({index} + {self.choices.between(-1, one.type.size)})"
            case 3:
                return f"mod({index}, {one.type.size})"
            case 4:
                return f"clamp({index}, 0, {last})"
            case 5:
                return f"({index} * {self.choices.pick(('0.5', '1e6', '(-1)', '1e300'))})"
            case _:
                return f"({index} + {self.quantity(NUMBER, depth - 1)})"

    def index_function(self, depth: int) -> str:
        """Return the index of the least or greatest element of an array of numbers, or else the time."""
        have = [a.type.element for a in self.arrays() if isinstance(a.type.element, Quantity)]
        if not have:
            return "(now() / 1 s)"
        array = self.some_array(self.choices.pick(have), depth)
        return f"{self.choices.pick(('index_of_min', 'index_of_max'))}({array})"

    # --- elementwise results ---------------------------------------------------------------------

    def _compared(self, size: int, depth: int) -> str:
        """Return an array of bools that compares the elements of an array in scope."""
        one = self.choices.pick(
            [n for n in self.scope.names if isinstance(n.type, Array) and n.type.size == size]
        )
        element = element_type(one.type)
        if isinstance(element, Bool):
            return one.text
        if isinstance(element, Enum):
            return f"({one.text} == {self.member(element)})"
        assert isinstance(element, Quantity)
        operator = self.choices.pick(("<", ">=", "==", "!="))
        compared = f"({one.text} {operator} {self.quantity(element.dimension, depth - 1)})"
        if self.scope.memory and self.choices.one_in(2):
            return self._bool_array_memory(compared, depth)
        return compared

    def _bool_array(self, size: int, depth: int) -> str:
        one = self.array(BOOL, size, depth)
        match self.choices.up_to(4):
            case 0:
                return f"(not {one})"
            case 1:
                return f"({one} {self.choices.pick(('and', 'or', 'implies', '!='))} {self.bool(depth)})"
            case 2 if self.scope.memory:
                return self._bool_array_memory(one, depth)
            case 3:
                return f"(if {self.bool(depth)} then {one} else {self.array(BOOL, size, depth - 1)})"
            case _:
                return f"value_or({one}, {self.bool(depth - 1)})"

    def _bool_array_memory(self, one: str, depth: int) -> str:
        match self.choices.up_to(4):
            case 0:
                return f"{self.choices.pick(('recently', 'sustained'))}({one}, {self.duration()})"
            case 1:
                return f"{self.choices.pick(('rising', 'falling', 'changed'))}({one})"
            case 2:
                return f"latch({one}, {self.bool(depth - 1)})"
            case 3:
                return f"previous({one}, {self.bool(0)})"
            case _:
                return f"captured({self.bool(depth - 1)}, {one})"

    def _number_array(self, of: Scalar, size: int, depth: int) -> str:
        if not isinstance(of, Quantity):
            return self.array(of, size, 0)
        one, other = self.array(of, size, depth), self.quantity(of.dimension, depth - 1)
        match self.choices.up_to(6):
            case 0:
                return f"({one} {self.choices.pick(('+', '-'))} {other})"
            case 1:
                return f"({other} - {one})"
            case 2:
                return f"({one} * {self.quantity(NUMBER, depth - 1)})"
            case 3:
                return f"{self.choices.pick(('abs', 'floor'))}({one})"
            case 4 if self.scope.memory:
                return f"previous({one}, {self.quantity(of.dimension, 0)})"
            case 5 if self.scope.memory:
                return f"captured({one}, {self.key(depth)})"
            case _:
                return f"(if {self.bool(depth)} then {one} else {other})"

    # --- reductions ------------------------------------------------------------------------------

    def comprehension(self, function: str, of: Scalar, depth: int) -> str:
        """Return a reduction of a body for each of some whole numbers, or each element of an array."""
        if self.scope.loops >= 2:
            return self.scalar(DIMENSIONLESS if function == "count" else of, 0)
        if self.choices.one_in(2):
            rounds = self._elements_of_array(depth)
            if rounds is not None:
                return self._reduced(function, of, depth, *rounds)
        low = self.choices.between(-1, 1)
        high = low + self.choices.between(-1, 2)
        variable = Named(text=f"k{self.scope.loops}", type=DIMENSIONLESS)
        return self._reduced(function, of, depth, [variable], f"{low} .. {high}", high - low + 1)

    def _elements_of_array(self, depth: int) -> tuple[list[Named], str, int] | None:
        """Return the names of an element and perhaps its bearing, the text of the array, and its size."""
        one = self.looking(depth) if self.choices.one_in(2) else None
        has_bearing = one is not None and not self.choices.one_in(4)
        if one is None:
            one = self._any_array(depth)
        if one is None or one.type.size * self.scope.rounds > _MAX_ROUNDS:
            return None
        number = self.scope.loops
        variables = [Named(text=f"each{number}", type=one.type.element)]
        variables += [Named(text=f"at{number}", type=DEGREES)] * has_bearing
        return variables, one.text, one.type.size

    def _any_array(self, depth: int) -> NamedArray | None:
        """Draw an array of any type in scope, or return None if there is none."""
        named = self.arrays()
        if not named:
            return None
        one = self.choices.pick(named)
        if self.choices.one_in(2):
            return one
        of, size = one.type.element, one.type.size
        return NamedArray(text=self.array(of, size, depth - 1), type=Array(of, size))

    def _reduced(
        self, function: str, of: Scalar, depth: int, variables: Sequence[Named], values: str, rounds: int
    ) -> str:
        inner = replace(
            self.scope, loops=self.scope.loops + 1, rounds=self.scope.rounds * max(rounds, 1)
        ).with_names(*variables)
        writer = self.inside(inner)
        body = writer.scalar(of, depth)
        condition = f" if {writer.bool(depth - 1)}" if self.choices.one_in(2) else ""
        names = ", ".join(v.text for v in variables)
        return f"{function}({body} for {names} in {values}{condition})"
