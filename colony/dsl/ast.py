"""The syntax tree, as written: names are unresolved, units are text, and parentheses are gone."""

from __future__ import annotations

from typing import Literal

from colony.dsl.expression_nodes import Argument as Argument
from colony.dsl.expression_nodes import Boolean as Boolean
from colony.dsl.expression_nodes import By as By
from colony.dsl.expression_nodes import CallNode as CallNode
from colony.dsl.expression_nodes import Comprehension as Comprehension
from colony.dsl.expression_nodes import ElementsComprehension as ElementsComprehension
from colony.dsl.expression_nodes import Expression as Expression
from colony.dsl.expression_nodes import ExpressionNode as ExpressionNode
from colony.dsl.expression_nodes import If as If
from colony.dsl.expression_nodes import IndexNode as IndexNode
from colony.dsl.expression_nodes import Infix as Infix
from colony.dsl.expression_nodes import InRange as InRange
from colony.dsl.expression_nodes import Is as Is
from colony.dsl.expression_nodes import NamedNode as NamedNode
from colony.dsl.expression_nodes import NamedValue as NamedValue
from colony.dsl.expression_nodes import NameNode as NameNode
from colony.dsl.expression_nodes import NumberNode as NumberNode
from colony.dsl.expression_nodes import Prefix as Prefix
from colony.dsl.expression_nodes import Reference as Reference
from colony.dsl.expression_nodes import SliceOf as SliceOf
from colony.dsl.expression_nodes import Status as Status
from colony.dsl.expression_nodes import SyntaxNode as SyntaxNode
from colony.record import record

# --- robot ---------------------------------------------------------------------------------------


@record
class TypeName(SyntaxNode):
    """A unit as written, `bool`, `number`, or the path of an enum."""

    path: tuple[str, ...]


@record
class RangeNode(SyntaxNode):
    """`range low .. high`."""

    low: Expression
    high: Expression


@record
class FrameDecl(SyntaxNode):
    """`frame period`, with or without `jitter`."""

    period: Expression
    jitter: Expression | None = None


@record
class BearingDecl(SyntaxNode):
    """`bearing first step angle`, with or without the step, or `bearing [angle, ...]`."""

    angles: tuple[Expression, ...] | None
    first: Expression | None
    step: Expression | None


@record
class SensorDecl(NamedNode):
    """`sensor name[size] : type ... from server.field ...`; as a declaration of a file, `input name ...`."""

    size: Expression | None
    type: TypeName
    bearing: BearingDecl | None = None
    range: RangeNode | None
    default: Expression | None
    server: NameNode
    field: NameNode
    within: Expression | None


@record
class FieldDecl(NamedNode):
    """`name : type range ... default ...`, in an actuator."""

    type: TypeName
    range: RangeNode | None
    default: Expression | None


@record
class IdleDecl(NamedNode):
    """`idle hold` has no arguments; `idle drive()` has an empty tuple of them."""

    arguments: tuple[Argument, ...] | None


@record
class ActuatorDecl(NamedNode):
    """`actuator name { fields } to server.command idle ... on_loss ...`."""

    fields: tuple[FieldDecl, ...]
    server: NameNode
    command: NameNode
    idle: IdleDecl
    on_loss: Literal["stop", "degrade"] | None


RobotItem = FrameDecl | SensorDecl | ActuatorDecl


@record
class RobotDecl(NamedNode):
    """`robot name { ... }`."""

    items: tuple[RobotItem, ...]


@record
class EnumDecl(NamedNode):
    """`enum name { member = number, ... }`."""

    members: tuple[Argument, ...]


@record
class ImportDecl(SyntaxNode):
    """`import "path" as alias`."""

    path: str
    alias: NameNode | None


@record
class RobotImportDecl(SyntaxNode):
    """`import robot`: the interface of the robot that the program is for."""

    @property
    def alias(self) -> None:
        """None: the names of a robot have no prefix."""
        return None


# --- derived values and modules ------------------------------------------------------------------


@record
class ParamDecl(NamedValue):
    """`param name = value`, or with an interval `tunable param name = value in low .. high`."""

    interval: RangeNode | None = None


@record
class LetDecl(NamedValue):
    """`let name = value`."""


@record
class ParameterNode(NamedNode):
    """`name[size] : type = initial`; an array without `size` is of any length."""

    is_array: bool
    size: Expression | None
    type: TypeName
    initial: Expression | None


@record
class FunctionDecl(NamedValue):
    """`let name(parameter, ...) = value`."""

    parameters: tuple[ParameterNode, ...]


@record
class StateDecl(NamedNode):
    """`state name : type = initial`."""

    type: TypeName | None
    initial: Expression


@record
class NextDecl(NamedValue):
    """`next name = value`."""


@record
class TransitionDecl(SyntaxNode):
    """A transition; `source` is None for `any`. That of a task must also have got `through`."""

    failsafe: bool = False
    source: NameNode | None
    target: NameNode
    condition: Expression
    through: Expression | None = None


@record
class MachineDecl(NamedNode):
    """`machine name { start initial ... }`; that of a sequence has `tasks`, the phases in order."""

    initial: NameNode
    transitions: tuple[TransitionDecl, ...]
    tasks: tuple[NameNode, ...] = ()


@record
class TaskDecl(NamedNode):
    """`name = base(argument, ...) until condition within limit else otherwise`."""

    base: Reference
    arguments: tuple[Argument, ...]
    until: Expression
    within: Expression | None
    otherwise: NameNode | None


@record
class SequenceDecl(NamedNode):
    """`sequence name when condition keep { tasks }`; with `restart` in place of `keep` if `restarts`."""

    when: Expression | None
    restarts: bool = False
    tasks: tuple[TaskDecl, ...]


@record
class InputDecl(ParameterNode):
    """`input name[size] : type = initial`."""


Clause = InputDecl | ParamDecl | LetDecl | FunctionDecl | StateDecl | NextDecl


@record
class DoDecl(SyntaxNode):
    """`do actuator(field = value, ...)`."""

    actuator: NameNode
    arguments: tuple[Argument, ...]


@record
class ModuleDecl(NamedNode):
    """`failsafe module name { ... when ... do ... }`."""

    failsafe: bool = False
    clauses: tuple[Clause, ...]
    when: Expression
    do: DoDecl | None


@record
class DerivedModuleDecl(NamedNode):
    """`failsafe module name = base(param = constant, input = expression, ...)`.

    The module of a task, `sequence.task`, applies only where `phase`, a comparison, is true.
    """

    failsafe: bool = False
    base: Reference
    arguments: tuple[Argument, ...]
    phase: Expression | None = None


@record
class ReadsDecl(SyntaxNode):
    """`reads name, ...`."""

    names: tuple[Reference, ...]


@record
class CommandsDecl(SyntaxNode):
    """`commands actuator`."""

    actuator: NameNode


@record
class RateDecl(SyntaxNode):
    """`rate period`."""

    period: Expression


PythonClause = InputDecl | ParamDecl | ReadsDecl | CommandsDecl | RateDecl


@record
class PythonModuleDecl(SyntaxNode):
    """`failsafe module name from python "path" { ... }`."""

    failsafe: bool = False
    name: NameNode
    path: str
    clauses: tuple[PythonClause, ...]


# --- network -------------------------------------------------------------------------------------


@record
class LinkNode(SyntaxNode):
    """The relation between an operand of a chain and the rest of the chain, with its time constant."""

    relation: Literal["suppresses", "inhibits"]
    window: Expression | None


@record
class ChainNode(SyntaxNode):
    """`operands[0] links[0] operands[1] links[1] ...`, as written: flat, whatever its length."""

    operands: tuple[Wiring, ...]
    links: tuple[LinkNode, ...]


Wiring = Reference | ChainNode


@record
class WireDecl(NamedNode):
    """`name = wiring`."""

    wiring: Wiring


@record
class NetworkDecl(SyntaxNode):
    """`network { ... }`."""

    wires: tuple[WireDecl, ...]


# --- limits, contracts, tests --------------------------------------------------------------------


@record
class LimitDecl(SyntaxNode):
    """`limit actuator.field <= bound when condition`."""

    actuator: NameNode
    field: NameNode
    relation: Literal["<=", ">="]
    bound: Expression
    condition: Expression | None


@record
class ContractDecl(NamedNode):
    """`contract name in time requirement "id": expression`, or `reach name requirement "id": expression`."""

    expression: Expression
    in_time: bool = False
    reach: bool = False
    requirements: tuple[str, ...] = ()

    @property
    def keyword(self) -> str:
        """The word that begins the declaration."""
        return "reach" if self.reach else "contract"


@record
class AssumeDecl(ContractDecl):
    """`assume name: expression`."""

    @property
    def keyword(self) -> str:
        """The word that begins the declaration."""
        return "assume"


@record
class Missing(SyntaxNode):
    """`missing`, as a value after `given`."""


@record
class Elements(SyntaxNode):
    """`[value, value, ...]`, as a value after `given`."""

    values: tuple[Expression, ...]


@record
class GivenDecl(SyntaxNode):
    """`sensor[index .. last] = value taken age ago`, after `given`; one element without `last`.

    `sensor` is a `By` or an `Is` for what a module did in the frame before.
    """

    sensor: Reference | By | Is
    index: Expression | None
    last: Expression | None = None
    value: Expression | Missing | Elements
    taken_ago: Expression | None = None


@record
class StepDecl(SyntaxNode):
    """`at <first>`, or `from <first> to <last> every <period>`."""

    first: Expression
    last: Expression | None
    period: Expression | None
    given: tuple[GivenDecl, ...]
    expect: tuple[Expression, ...]


@record
class TestDecl(SyntaxNode):
    """`test "title" { ... }`."""

    __test__ = False  # not a test class for pytest

    title: str
    steps: tuple[StepDecl, ...]


Declaration = (
    RobotDecl
    | EnumDecl
    | ImportDecl
    | RobotImportDecl
    | SensorDecl
    | ParamDecl
    | LetDecl
    | FunctionDecl
    | StateDecl
    | NextDecl
    | MachineDecl
    | SequenceDecl
    | ModuleDecl
    | DerivedModuleDecl
    | PythonModuleDecl
    | NetworkDecl
    | LimitDecl
    | ContractDecl
    | AssumeDecl
    | TestDecl
)


@record
class LanguageDecl(SyntaxNode):
    """`language version`, the first line of a file; `version` is as written."""

    version: str


@record
class File(SyntaxNode):
    """All declarations of a file, in order; `language` is None without that line."""

    language: LanguageDecl | None = None
    declarations: tuple[Declaration, ...]
