"""The state of an encoding in progress: constants, facts about them, memory, and reasons for inexactness."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar, cast

import z3

from colony.ir import expression as ir
from colony.text.source import Span
from colony.verify.symbolic.logic import FALSE, any_of, both, either, is_false, is_true, negation
from colony.verify.symbolic.system import (
    UNBOUNDED,
    Auxiliary,
    ExtendedReal,
    Fact,
    FactKind,
    Inexact,
    InexactTerm,
    NumberBounds,
    Operation,
    Reason,
    Scalar,
    Shape,
    SymbolicCell,
    Term,
)

# --- frame values -------------------------------------------------------------------------------------
#
# The values that expressions of a frame may read, as terms.


@dataclass(frozen=False, slots=True, kw_only=True)
class SymbolicValues:
    """The values of one frame. Mutable: filled in the order in which a frame is computed.

    A value has a term even where it is missing; there the term is arbitrary.
    """

    now: z3.ArithRef
    begun: z3.BoolRef  # there was an earlier frame
    last: z3.ArithRef  # time of the previous frame
    restarted: z3.BoolRef  # memory was lost before this frame
    sensors: dict[str, Term] = field(default_factory=dict)
    present: dict[str, z3.BoolRef] = field(default_factory=dict)  # sensors with a reading
    missing: dict[str, z3.BoolRef] = field(default_factory=dict)  # sensors with neither value nor default
    derived: dict[str, tuple[z3.BoolRef, Term]] = field(default_factory=dict)  # missing, value
    states: dict[str, Scalar] = field(default_factory=dict)
    locals: dict[str, tuple[z3.BoolRef, Term]] = field(default_factory=dict)  # missing, value
    active: dict[str, z3.BoolRef] = field(default_factory=dict)
    wins: dict[str, dict[str, z3.BoolRef]] = field(default_factory=dict)  # by actuator and module
    commanded: dict[str, z3.BoolRef] = field(default_factory=dict)
    sent: dict[tuple[str, int], tuple[z3.BoolRef, Scalar]] = field(default_factory=dict)  # missing, value


def missing(e: ir.Expression, frame_values: SymbolicValues, own_lets: Set[str] = frozenset()) -> z3.BoolRef:
    """Return the condition that something `e` needs is missing; `own_lets` count as present."""
    match e:
        case ir.SensorValue(name=name):
            return frame_values.missing[name]
        case ir.DerivedValue(name=name):
            return frame_values.derived[name][0]
        case ir.LocalValue(name=name):
            return FALSE if name in own_lets else frame_values.locals[name][0]
        case ir.SentField(actuator=actuator, field_index=i):
            return frame_values.sent[actuator, i][0]
        case ir.ValueOr(other=other):
            return missing(other, frame_values, own_lets)
        case _:
            return any_of(missing(child, frame_values, own_lets) for child in ir.children(e))


def evaluation_condition(
    condition: z3.BoolRef, e: ir.Expression, frame_values: SymbolicValues, own_lets: Set[str]
) -> z3.BoolRef:
    """Return the condition under which `e` is evaluated: `condition`, and nothing it needs is missing."""
    return both(condition, negation(missing(e, frame_values, own_lets)))


# --- builder ------------------------------------------------------------------------------------------

Result = TypeVar("Result")


@dataclass(frozen=False, slots=True, kw_only=True)
class SystemBuilder:
    """Collects the parts of a `System`. Mutable. Keeps terms alive, so that their ids stay unique."""

    precise: bool
    shapes: Mapping[str, Shape]  # known shapes of numbers in memory, by cell name
    facts: list[Fact] = field(default_factory=list)
    auxiliaries: list[Auxiliary] = field(default_factory=list)
    cells: list[SymbolicCell] = field(default_factory=list)
    inexact: dict[int, InexactTerm] = field(default_factory=dict)
    kept: list[z3.ExprRef] = field(default_factory=list)
    numbers_in_memory: dict[str, tuple[ExtendedReal, ExtendedReal, ExtendedReal]] = field(
        default_factory=dict
    )  # initial, old, new
    _cache: dict[tuple[Any, ...], Any] = field(default_factory=dict)
    _names: dict[str, int] = field(default_factory=dict)
    _open_cells: dict[str, int] = field(
        default_factory=dict
    )  # indices of the cells whose `next` is not set yet, by name

    def name(self, hint: str) -> str:
        """Return a unique name for a constant."""
        count = self._names[hint] = self._names.get(hint, 0) + 1
        return hint if count == 1 else f"{hint}#{count}"

    def once(self, key: tuple[Any, ...], make: Callable[[], Result]) -> Result:
        """Return the result of `make`, which is called once for each `key`."""
        if key not in self._cache:
            self._cache[key] = make()
        return cast(Result, self._cache[key])

    def keep(self, *terms: z3.ExprRef) -> tuple[int, ...]:
        """Return the ids of terms and keep the terms alive, so that no other term gets these ids."""
        self.kept.extend(terms)
        return tuple(x.get_id() for x in terms)

    def key(self, *scalars: Scalar) -> tuple[int, ...]:
        """Return a key that identifies scalars: the ids of their terms."""
        return tuple(i for x in scalars for i in self._key(x))

    def _key(self, x: Scalar) -> tuple[int, ...]:
        return self.keep(x.value, x.nan, x.infinite) if isinstance(x, ExtendedReal) else self.keep(x)

    # --- facts -----------------------------------------------------------------------------------

    def assume(self, subject: z3.ExprRef, formula: z3.BoolRef, only_over_reals: bool = False) -> None:
        """Assume a formula about a term; with `only_over_reals`, it holds only for reals, not for floats."""
        self._add(Fact(FactKind.ASSUMPTION, subject, formula, only_over_reals, len(self.facts)))

    def define(self, subject: z3.ExprRef, formula: z3.BoolRef) -> None:
        """Define a term by a formula."""
        self._add(Fact(FactKind.DEFINITION, subject, formula, position=len(self.facts)))

    def invariant(self, subject: z3.ExprRef, formula: z3.BoolRef) -> None:
        """State an invariant of a term."""
        self._add(Fact(FactKind.INVARIANT, subject, formula, position=len(self.facts)))

    def _add(self, fact: Fact) -> None:
        if not is_true(fact.formula):
            self.facts.append(fact)

    def auxiliary(
        self, operation: Operation, operands: tuple[ExtendedReal, ...], sort: z3.SortRef
    ) -> tuple[z3.ArithRef, bool]:
        """Return the constant for this operation on these operands, and True if it is new."""
        key = (operation, self.key(*operands))
        is_new = key not in self._cache

        def make() -> z3.ArithRef:
            term = cast(z3.ArithRef, z3.Const(self.name(operation.name.lower()), sort))
            self.auxiliaries.append(Auxiliary(constant=term, operation=operation, operands=operands))
            return term

        return self.once(key, make), is_new

    def overflow(self, x: ExtendedReal, span: Span) -> z3.BoolRef:
        """Return the condition that the program's float is infinite but `x` is not; false for reals."""
        constant, is_new = self.auxiliary(Operation.OVERFLOW, (x,), z3.BoolSort())
        overflows = cast(z3.BoolRef, constant)
        if is_new:
            self.assume(overflows, negation(overflows), only_over_reals=True)
            self.mark_inexact(
                overflows, Reason(Inexact.ROUNDING, span, "a number too large for a float becomes infinite")
            )
        return overflows

    def named(self, x: Scalar, hint: str) -> Scalar:
        """Return `x` with a constant in place of its value, unless that is a constant already."""
        if not isinstance(x, ExtendedReal) or x.cases or x.value.num_args() == 0:
            return x
        if x.whole is not None:
            if x.whole.num_args() == 0:
                return x
            whole = self._defined(x.whole, hint)
            return replace(x, whole=whole, value=z3.ToReal(whole))
        return replace(x, value=self._defined(x.value, hint))

    def _defined(self, term: z3.ArithRef, hint: str) -> z3.ArithRef:
        def make() -> z3.ArithRef:
            name = cast(z3.ArithRef, z3.Const(self.name(hint), term.sort()))
            self.define(name, cast(z3.BoolRef, name == term))
            return name

        return self.once(("defined", *self.keep(term)), make)

    # --- reasons ---------------------------------------------------------------------------------

    def mark_number_inexact(
        self, x: ExtendedReal, reason: Reason, floats: tuple[z3.ArithRef, ...] = (), *, is_sum: bool = False
    ) -> None:
        """Record why `x` is inexact; the bounds of a finite value are those of the program's float."""
        term = x.value if x.whole is None else x.whole
        bounds = x.bounds if is_false(x.infinite) else UNBOUNDED
        self.mark_inexact(term, reason, bounds, floats, is_sum=is_sum, nan=x.nan)

    def mark_inexact(
        self,
        term: z3.ExprRef,
        reason: Reason,
        bounds: NumberBounds = UNBOUNDED,
        floats: tuple[z3.ArithRef, ...] = (),
        *,
        is_sum: bool = False,
        nan: z3.BoolRef = FALSE,
    ) -> None:
        """Record why a term is inexact; a numeral is exact, and ignored."""
        if term.num_args() == 0 and term.decl().kind() != z3.Z3_OP_UNINTERPRETED:
            return
        key = term.get_id()
        found = InexactTerm(term, reason, bounds, floats=floats, is_sum=is_sum, nan=nan)
        recorded = self.inexact.setdefault(key, found)
        ambiguous = recorded.ambiguous or recorded.reason.text != reason.text or recorded.bounds != bounds
        self.inexact[key] = replace(recorded, ambiguous=ambiguous, nan=either(recorded.nan, nan))

    # --- memory ----------------------------------------------------------------------------------

    def open_cell(self, name: str, sort: z3.SortRef, initial: z3.ExprRef) -> z3.ExprRef:
        """Add a cell and return its old value; `close_cell` must follow."""
        old = z3.Const(name, sort)
        self._open_cells[name] = len(self.cells)
        self.cells.append(SymbolicCell(name=name, old=old, next=old, initial=initial))
        return old

    def close_cell(self, name: str, next_value: z3.ExprRef) -> None:
        """Set the value of a cell after the frame."""
        index = self._open_cells.pop(name)
        self.cells[index] = replace(self.cells[index], next=next_value)
