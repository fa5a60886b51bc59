"""The syntax tree, as written: names unresolved, units as text, parentheses gone.

`start` and `end` are character offsets in the file and take no part in equality, so that two texts with the
same meaning have equal trees. `depth` is how deep an expression nests: the checker refuses what is too deep
before anything recurses into it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A piece of text."""

    start: int = field(default=0, compare=False, repr=False)
    end: int = field(default=0, compare=False, repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Name(Node):
    """One identifier where it is declared or named."""

    text: str


# --- expressions ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpressionNode(Node):
    depth: int = field(default=1, compare=False, repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Number(ExpressionNode):
    """A number as written, and the unit that belongs to it."""

    digits: str
    unit: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Boolean(ExpressionNode):
    value: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference(ExpressionNode):
    """`name`, `name.name` ...: whatever it turns out to name."""

    path: tuple[str, ...]

    @property
    def text(self) -> str:
        return ".".join(self.path)


@dataclass(frozen=True, slots=True, kw_only=True)
class Prefix(ExpressionNode):
    operator: Literal["-", "not"]
    operand: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class Infix(ExpressionNode):
    """Two operands and an arithmetic, relational or Boolean operator, by its spelling."""

    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class If(ExpressionNode):
    condition: Expression
    yes: Expression
    no: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class InRange(ExpressionNode):
    """`operand in low .. high`."""

    operand: Expression
    low: Expression
    high: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class Index(ExpressionNode):
    array: Expression
    index: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class SliceOf(ExpressionNode):
    array: Expression
    first: Expression
    last: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class Call(ExpressionNode):
    function: Name
    arguments: tuple[Expression, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Comprehension(ExpressionNode):
    """`function(body for variable in low .. high [if condition])`."""

    function: Name
    body: Expression
    variable: Name
    low: Expression
    high: Expression
    condition: Expression | None


@dataclass(frozen=True, slots=True, kw_only=True)
class By(ExpressionNode):
    """`actuator by module`."""

    actuator: Expression
    module: Expression


Status = Literal["active", "commanded", "idle"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Is(ExpressionNode):
    """`name is active`, `actuator is commanded`, `actuator is idle`."""

    subject: Expression
    status: Status


Expression = (
    Number
    | Boolean
    | Reference
    | Prefix
    | Infix
    | If
    | InRange
    | Index
    | SliceOf
    | Call
    | Comprehension
    | By
    | Is
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Argument(Node):
    """`name = value`."""

    name: Name
    value: Expression


# --- robot ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class TypeName(Node):
    """A unit as written, `bool`, `number`, or the path of an enum."""

    path: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Range(Node):
    low: Expression
    high: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameDecl(Node):
    period: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorDecl(Node):
    name: Name
    size: Expression | None
    type: TypeName
    range: Range | None
    default: Expression | None
    server: Name
    field: Name
    within: Expression | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldDecl(Node):
    name: Name
    type: TypeName
    range: Range | None


@dataclass(frozen=True, slots=True, kw_only=True)
class IdleDecl(Node):
    """`idle hold` has no arguments; `idle drive()` has an empty tuple of them."""

    name: Name
    arguments: tuple[Argument, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorDecl(Node):
    name: Name
    fields: tuple[FieldDecl, ...]
    server: Name
    command: Name
    idle: IdleDecl
    on_loss: Literal["stop", "degrade"] | None


RobotItem = FrameDecl | SensorDecl | ActuatorDecl


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotDecl(Node):
    name: Name
    items: tuple[RobotItem, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class EnumDecl(Node):
    name: Name
    members: tuple[Argument, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportDecl(Node):
    path: str
    alias: Name | None


# --- derived values and modules ------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class ParamDecl(Node):
    name: Name
    value: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class LetDecl(Node):
    name: Name
    value: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class StateDecl(Node):
    name: Name
    type: TypeName | None
    initial: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class NextDecl(Node):
    name: Name
    value: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionDecl(Node):
    """`source` is None for `any`."""

    source: Name | None
    target: Name
    condition: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineDecl(Node):
    name: Name
    initial: Name
    transitions: tuple[TransitionDecl, ...]


Clause = ParamDecl | LetDecl | StateDecl | NextDecl


@dataclass(frozen=True, slots=True, kw_only=True)
class DoDecl(Node):
    actuator: Name
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModuleDecl(Node):
    name: Name
    clauses: tuple[Clause, ...]
    when: Expression
    do: DoDecl | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DerivedModuleDecl(Node):
    """`module name = base(param = constant, ...)`."""

    name: Name
    base: Reference
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadsDecl(Node):
    names: tuple[Reference, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandsDecl(Node):
    actuator: Name


@dataclass(frozen=True, slots=True, kw_only=True)
class RateDecl(Node):
    period: Expression


PythonClause = ParamDecl | ReadsDecl | CommandsDecl | RateDecl


@dataclass(frozen=True, slots=True, kw_only=True)
class PythonModuleDecl(Node):
    name: Name
    path: str
    clauses: tuple[PythonClause, ...]


# --- network -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Link(Node):
    """The relation between an operand of a chain and what follows it, with its time constant."""

    relation: Literal["suppresses", "inhibits"]
    window: Expression | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain(Node):
    """`operands[0] links[0] operands[1] links[1] ...`, as written; kept flat however long it is."""

    operands: tuple[Wiring, ...]
    links: tuple[Link, ...]


Wiring = Reference | Chain


@dataclass(frozen=True, slots=True, kw_only=True)
class WireDecl(Node):
    name: Name
    wiring: Wiring


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkDecl(Node):
    wires: tuple[WireDecl, ...]


# --- limits, contracts, tests --------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitDecl(Node):
    actuator: Name
    field: Name
    relation: Literal["<=", ">="]
    bound: Expression
    condition: Expression | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ContractDecl(Node):
    name: Name
    expression: Expression


@dataclass(frozen=True, slots=True, kw_only=True)
class Missing(Node):
    """`missing`, as a given value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Elements(Node):
    """`[v, v, ...]`, as a given value."""

    values: tuple[Expression, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenDecl(Node):
    sensor: Name
    index: Expression | None
    value: Expression | Missing | Elements


@dataclass(frozen=True, slots=True, kw_only=True)
class StepDecl(Node):
    """`at first`, or `from first to last every period`."""

    first: Expression
    last: Expression | None
    period: Expression | None
    given: tuple[GivenDecl, ...]
    expect: tuple[Expression, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class TestDecl(Node):
    __test__ = False  # not a test of pytest's

    title: str
    steps: tuple[StepDecl, ...]


Declaration = (
    RobotDecl
    | EnumDecl
    | ImportDecl
    | ParamDecl
    | LetDecl
    | StateDecl
    | NextDecl
    | MachineDecl
    | ModuleDecl
    | DerivedModuleDecl
    | PythonModuleDecl
    | NetworkDecl
    | LimitDecl
    | ContractDecl
    | TestDecl
)


@dataclass(frozen=True, slots=True, kw_only=True)
class File(Node):
    declarations: tuple[Declaration, ...]
