"""One frame of a program as formulas: the transition system that proofs, lints and `colony diff` work on.

All formulas are over constants of three kinds: the *inputs* of the frame (free within `assumptions`), the
*cells* of memory as they were before the frame, and *auxiliary* constants that `definitions` and
`assumptions` tie to the rest. A trace is unrolled by renaming them frame by frame (`unrolling.py`).

Time is an integer (z3's Int) of nanoseconds since the first frame, which is at 0. Numbers are extended reals:
they have NaN, the infinities and the sign of zero, but no rounding and no overflow. A `Reason` states where a
formula depends on this difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto, unique
from fractions import Fraction
from typing import NamedTuple, Protocol, TypeAlias

import z3
from z3 import z3core

from colony.ir.program import Program
from colony.text.source import NOWHERE, Span
from colony.verify.symbolic.logic import FALSE

# --- graph --------------------------------------------------------------------------------------------
#
# The terms of a system as a graph of ids, which is much faster to walk than z3's terms.


class _Cell(Protocol):
    @property
    def old(self) -> z3.ExprRef: ...
    @property
    def next(self) -> z3.ExprRef: ...


class _Fact(Protocol):
    @property
    def formula(self) -> z3.BoolRef: ...


class TermClosure(NamedTuple):
    """The ids of some terms and of all their subterms, and those of the constants and cells among them."""

    visited: frozenset[int]
    leaves: frozenset[int]


class Graph:
    """The structure of terms, recorded when they are first added. Mutable. Keeps terms alive."""

    def __init__(self, cells: Iterable[_Cell]) -> None:
        self._cells = {cell.old.get_id(): cell for cell in cells}
        self._behind: dict[int, tuple[Sequence[_Fact], TermClosure]] = {}
        self._operands: dict[int, tuple[int, ...]] = {}
        self._constants: dict[int, tuple[str, z3.ExprRef]] = {}
        self._kept: list[z3.ExprRef] = []

    def add(self, terms: Iterable[z3.ExprRef]) -> list[int]:
        """Add terms with all their subterms; return the ids of the terms."""
        roots = list(terms)
        self._kept += roots
        context = z3.main_ctx().ref()
        pending = [term.as_ast() for term in roots]
        while pending:  # of z3's own pointers, as wrapping them all takes several times as long
            term = pending.pop()
            key = z3core.Z3_get_ast_id(context, term)
            if key in self._operands:
                continue
            count = z3core.Z3_get_app_num_args(context, term)
            operands = [z3core.Z3_get_app_arg(context, term, i) for i in range(count)]
            self._operands[key] = tuple(z3core.Z3_get_ast_id(context, x) for x in operands)
            pending += operands
            if not operands:
                self._add_constant(key, z3.ExprRef(term))
        return [term.get_id() for term in roots]

    def _add_constant(self, key: int, leaf: z3.ExprRef) -> None:
        declaration = leaf.decl()
        if declaration.kind() == z3.Z3_OP_UNINTERPRETED:
            name = str(declaration.name())
            self._constants[key] = (name, z3.Const(name, leaf.sort()))

    def operands(self, key: int) -> tuple[int, ...]:
        """Return the ids of the operands of the term with this id."""
        return self._operands[key]

    def constant(self, key: int) -> tuple[str, z3.ExprRef]:
        """Return the name and the term of an uninterpreted constant by its id."""
        return self._constants[key]

    def reach(self, keys: Iterable[int]) -> TermClosure:
        """Return what is in the terms with these ids."""
        visited, leaves, pending = set[int](), set[int](), list(keys)
        while pending:
            key = pending.pop()
            if key in visited:
                continue
            visited.add(key)
            pending.extend(self._operands[key])
            if key in self._constants:
                leaves.add(key)
        return TermClosure(frozenset(visited), frozenset(leaves))

    def behind(self, leaf: int, facts: Sequence[_Fact]) -> TermClosure:
        """Return what is in the facts about a constant, and if it is a cell, in its value after the frame."""
        known = self._behind.get(leaf)
        if known is not None and known[0] is facts:
            return known[1]
        formulas = [fact.formula for fact in facts]
        cell = self._cells.get(leaf)
        found = self.reach(self.add(formulas if cell is None else [cell.next, *formulas]))
        self._behind[leaf] = (facts, found)
        return found


# --- system -------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class NumberBounds:
    """Bounds of a number that is not NaN: both included, None for unbounded.

    A bound also rules out the infinity beyond it. With `whole`, the number is an integer, or infinite.
    """

    low: Fraction | None = None
    high: Fraction | None = None
    whole: bool = False


UNBOUNDED = NumberBounds()


@dataclass(frozen=True, slots=True)
class Shape:
    """The range of values that a number in memory can have, found by fixpoint iteration (`shapes.py`)."""

    nan: bool
    infinite: bool
    bounds: NumberBounds


Case: TypeAlias = tuple[float, z3.BoolRef]
"""A possible value of a number, and the condition that the number has it."""


@dataclass(frozen=True, slots=True)
class ExtendedReal:
    """An extended real.

    It is NaN if `nan` holds, else infinite with the sign of `value` (which is then not 0) if `infinite`
    holds, else `value`. `nan` and `infinite` are the constant false wherever that is known.

    Attributes:
        value, nan, infinite: See above.
        bounds: Bounds of the number.
        whole: The same value as a term of sort Int, if it is whole.
        cases: Possible values if they are a few floats (one for a constant); exactly one case applies.
        loose_zero: True if the case 0 may be -0.0 as well.
        nanoseconds: The same value in nanoseconds, if it is a time.
        branches: The two numbers that it is chosen from, if it results from a choice.
    """

    value: z3.ArithRef
    nan: z3.BoolRef
    infinite: z3.BoolRef
    bounds: NumberBounds = UNBOUNDED
    whole: z3.ArithRef | None = None
    cases: tuple[Case, ...] = ()
    loose_zero: bool = False
    nanoseconds: z3.ArithRef | None = None
    branches: tuple[ExtendedReal, ...] = ()


Scalar: TypeAlias = ExtendedReal | z3.BoolRef
"""The value of a scalar expression: quantities and enumerators are numbers."""

Term: TypeAlias = Scalar | tuple[Scalar, ...]
"""The value of any expression; an array is a tuple."""


@unique
class Inexact(Enum):
    """The kinds of difference between a formula and what the program computes, bit for bit."""

    ROUNDING = auto()  # reals in place of floats: the sum, product or quotient could round, or overflow
    ABSTRACTED = auto()  # sin, cos, atan2, sqrt, a product of variables: only bounds and signs are known
    PYTHON = auto()  # a module in Python: it may answer anything


@dataclass(frozen=True, slots=True)
class Reason:
    """A reason for inexactness: `kind`, the span in the program, and a description."""

    kind: Inexact
    span: Span
    text: str


@dataclass(frozen=True, slots=True)
class InexactTerm:
    """An inexact term, the reason, and bounds of the float that the program computes.

    `ambiguous`: it stands for several floats that may differ, as the program computes it in several ways.
    Rounding, being monotone, does not cross 0 or `floats`. `is_sum`: it is a sum of two floats, which does
    not round where it is subnormal. Where `nan`, the float is NaN, and the term may be out of its bounds.
    """

    term: z3.ExprRef
    reason: Reason
    bounds: NumberBounds = UNBOUNDED
    ambiguous: bool = False
    floats: tuple[z3.ArithRef, ...] = ()
    is_sum: bool = False
    nan: z3.BoolRef = FALSE


@dataclass(frozen=True, slots=True, kw_only=True)
class SymbolicCell:
    """A memory cell: `old` is its constant before the frame, `next` the formula for its value after it.

    `initial` is a value of z3; `name` is unique, and names the owner of the memory.
    """

    name: str
    old: z3.ExprRef
    next: z3.ExprRef
    initial: z3.ExprRef


@unique
class Operation(Enum):
    """An operation whose result is an auxiliary constant, arbitrary where the operation is undefined."""

    PRODUCT = auto()
    QUOTIENT = auto()
    MODULO = auto()
    SQRT = auto()
    SIN = auto()
    COS = auto()
    TAN = auto()
    POLE = auto()
    ASIN = auto()
    ACOS = auto()
    ATAN2 = auto()
    FLOOR = auto()
    ROUND = auto()
    OVERFLOW = auto()
    LEAST = auto()
    GREATEST = auto()
    LEAST_IS_INFINITE = auto()
    GREATEST_IS_INFINITE = auto()
    INDEX_OF_LEAST = auto()
    INDEX_OF_GREATEST = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class Auxiliary:
    """The constant for the result of `operation` on `operands`, constrained by assumptions and definitions.

    FLOOR, ROUND, extremes and their indices (of sort Int, but for extremes) are exact. OVERFLOW is a bool:
    the program's float is infinite though the operand is not; it is false for reals. The others are
    abstracted (PRODUCT and QUOTIENT unless `precise`).
    """

    constant: z3.ArithRef | z3.BoolRef
    operation: Operation
    operands: tuple[ExtendedReal, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorInput:
    """The input of a sensor in the frame. `present` is the condition that it has a valid reading.

    `elements` are its values in base units (one for a scalar), within the range; they are arbitrary if the
    sensor has no valid reading.
    """

    present: z3.BoolRef
    elements: tuple[Scalar, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PythonInput:
    """The answer of a module in Python: the condition that it commands, and unconstrained fields.

    `blind` is the condition that there is no answer; it is false of a module that is not failsafe, which is
    then not active, as if it answered "not applicable".
    """

    answers: z3.BoolRef
    blind: z3.BoolRef
    fields: tuple[Scalar, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleTerms:
    """A module in the frame. `applicable` and `command` are arbitrary if it is silent or blind.

    `silent` is the condition that something that it reads is missing. `blind`, false unless the module is
    failsafe, is the condition that it is active without a command. `active` is `blind`, or `applicable` and
    not `silent`.
    """

    silent: z3.BoolRef
    blind: z3.BoolRef
    applicable: z3.BoolRef
    active: z3.BoolRef
    command: tuple[Scalar, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorTerms:
    """The output of an actuator. `wins` gives for each module of its wiring the condition that it wins.

    `commanded` is the condition that a module wins and its command is sent, as all of it is finite. `sent`
    are the fields after limits and clamping, in base units; for `idle hold` they are arbitrary if not
    `commanded`.
    """

    wins: Mapping[str, z3.BoolRef]
    commanded: z3.BoolRef
    sent: tuple[Scalar, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContractFormula:
    """A contract in the frame: the condition that it holds, that is, is known to be true."""

    name: str
    holds: z3.BoolRef
    inexact: tuple[Reason, ...] = ()  # of all terms that it depends on, over all frames
    span: Span = field(default=NOWHERE)


@unique
class Disturbance(Enum):
    """A cause for which an actuator does not get what the network decided, in any frame."""

    LATE = "late"
    """Actuators are idle, as a client is late or a server down; with `on_loss degrade` modules are lost."""

    OPERATORS = "operators"
    """As `LATE`; and connections outside the network command actuators, within their bounds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DisturbanceInputs:
    """The inputs of a disturbance in the frame.

    `idle` gives for each actuator the condition that it is idle whatever the network decided, `lost` for
    each module that can be lost the condition that it is. `outside` are the actuators that connections
    outside the network may command.
    """

    idle: Mapping[str, z3.BoolRef]
    lost: Mapping[str, z3.BoolRef]
    outside: Mapping[str, OutsideInput]


@dataclass(frozen=True, slots=True, kw_only=True)
class OutsideInput:
    """A command from outside the network: the condition that there is one, and its fields, all finite.

    It is sent within the bounds of the frame, unless the actuator is idle or its bounds contradict.
    """

    commands: z3.BoolRef
    fields: tuple[Scalar, ...]


@unique
class FactKind(Enum):
    """The group of a system's formulas that a fact belongs to."""

    ASSUMPTION = auto()
    DEFINITION = auto()
    INVARIANT = auto()


@dataclass(frozen=True, slots=True)
class Fact:
    """A formula that constrains the term `subject`; with `only_over_reals`, floats need not satisfy it."""

    kind: FactKind
    subject: z3.ExprRef
    formula: z3.BoolRef
    only_over_reals: bool = False
    position: int = 0  # among the facts of its system


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """A program as a transition system.

    `now` is the time of the frame and an input, 0 in the first; `begun` is a cell, false before the first
    frame, and `last` the cell with the previous frame's time. `restarted` is an input, true at most in the
    first frame. `assumptions` (sensors in range, increasing time, bounds of abstracted functions) and
    `definitions` (`constant == term`) hold in every frame. `invariants` hold for the cells before every
    reachable frame, and are inductive: they may be assumed in an induction. `facts` gives, by the id of a
    term, the formulas of the three groups that are about it; a formula without the term needs none of them.
    `inexact` gives, by id, the inexact terms. `graph` stores the structure of terms, which makes the search
    for cones fast. `shapes` are those of numbers in memory, `written` their values after the frame.
    `disturbances` is empty but in the systems of `encode.py`, which state each contract once more for
    each disturbance.
    """

    program: Program
    now: z3.ArithRef
    begun: z3.BoolRef
    last: z3.ArithRef
    restarted: z3.BoolRef
    sensors: Mapping[str, SensorInput]
    python: Mapping[str, PythonInput]
    cells: tuple[SymbolicCell, ...]
    assumptions: tuple[z3.BoolRef, ...]
    definitions: tuple[z3.BoolRef, ...]
    invariants: tuple[z3.BoolRef, ...]
    auxiliaries: tuple[Auxiliary, ...]  # each before those that are computed from it
    facts: Mapping[int, tuple[Fact, ...]]
    inexact: Mapping[int, InexactTerm]
    graph: Graph = field(compare=False, repr=False)
    derived: Mapping[str, tuple[z3.BoolRef, Term]]  # lets at file level: missing, value
    states: Mapping[str, Scalar]  # file level `name` and `module.name`: old values
    locals: Mapping[str, Term]  # lets of modules, by full name
    modules: Mapping[str, ModuleTerms]
    active: Mapping[str, z3.BoolRef]  # modules and wires
    actuators: Mapping[str, ActuatorTerms]
    claims: tuple[ContractFormula, ...]
    shapes: Mapping[str, Shape] = field(default_factory=dict)
    written: Mapping[str, ExtendedReal] = field(default_factory=dict)
    disturbances: Mapping[Disturbance, DisturbanceInputs] = field(default_factory=dict)
