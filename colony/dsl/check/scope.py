"""Symbols, and the scopes in which names are looked up.

A file has two namespaces: values (sensors, enums, params, lets, states, machines), which expressions read,
and elements of the network (modules, wires, actuators). The robot is shared by all files of a program.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice

from colony.dsl import ast
from colony.dsl.files import ParsedFile
from colony.dsl.site import SiteValue
from colony.ir import program as ir
from colony.ir.expression import NESTING_LIMIT, Constant, Expression
from colony.ir.types import Array, Enum, Scalar, Type, Value
from colony.record import Record, record
from colony.text.diagnostics import Diagnostic, Label, error
from colony.text.source import Span
from colony.text.wording import did_you_mean

# --- program size -------------------------------------------------------------------------------------
#
# The size of a program as calls of functions let it grow, counted while it is checked.
#
# A call puts the body of its function in its place. If each of twenty functions calls the one before it
# twice, the last stands for a million bodies. So nodes of expressions are counted, and a call that exceeds a
# limit is refused before its body is checked, by the least size and depth that its function has.
#
# An *outermost* call stands where people wrote it: in the program, or in the declaration of a function, whose
# body is checked once to find its errors. A call in a body that is called is part of the outermost one, which
# reports that all of it is too large or too deep.
#
# Calls in the program share one budget, since their nodes stay in the program. Calls in declarations add
# nothing to it: each may be as large as a program, and a budget of their own bounds the time that all of them
# take. Once it is used up, calls in declarations are counted without checking their bodies.

MAX_NODES = 100_000
"""Maximum number of nodes that calls of functions add to a program."""

_MAX_NODES_IN_DECLARATIONS = 20_000
"""Number of nodes after which calls in declarations of functions are no longer checked."""


class Excess(enum.Enum):
    """The limit that a call exceeds."""

    DEPTH = enum.auto()
    SIZE = enum.auto()


@dataclass(slots=True)
class ProgramSize:
    """The nodes of expressions that were checked, and what calls may still add. Changes with each node.

    Attributes:
        nodes: the number of nodes that were checked; those of an argument count wherever it is read.
        deepest: the largest nesting depth of a node since `begin_declaration`.
        is_broken: True if the function being declared calls one that has errors, or calls too much.
        excess: the limit that the present outermost call exceeds, if any.
    """

    nodes: int = 0
    deepest: int = 0
    is_broken: bool = False
    excess: Excess | None = None
    _level: int = 0
    _budget: int = MAX_NODES  # negative once a call exceeded it
    _declaration_budget: int = _MAX_NODES_IN_DECLARATIONS
    _in_declaration: bool = False  # this, and what follows, of the present outermost call
    _first_node: int = 0
    _last_node: int = 0

    # --- nodes

    def enter_node(self) -> bool:
        """Count a node inside those entered, and return False if it is too deep; `leave_node` ends it."""
        self.nodes += 1
        self._level += 1
        self.deepest = max(self.deepest, self._level)
        if self._level > NESTING_LIMIT:
            self.excess = Excess.DEPTH  # of a call: what is written nests less
            return False
        return True

    def leave_node(self) -> None:
        """Go back to the node around the present one."""
        self._level -= 1

    def add_argument(self, nodes: int, depth: int) -> bool:
        """Count the argument that the present node stands for; return False if it exceeds a limit."""
        self.nodes += nodes - 1  # the parameter was counted
        if self.excess is None and self.nodes > self._last_node:
            self.excess = Excess.SIZE
        if self._level + depth - 1 > NESTING_LIMIT:
            self.excess = Excess.DEPTH
        return self.excess is None

    # --- calls

    def begin_declaration(self) -> int:
        """Begin the declaration of a function; return the number of nodes before it."""
        self.deepest, self.is_broken = 0, False
        return self.nodes

    def begin_outermost_call(self, *, in_declaration: bool) -> bool:
        """Begin an outermost call; return False if an earlier error makes its check useless."""
        if self.is_broken if in_declaration else self._budget < 0:
            return False
        self._in_declaration, self.excess = in_declaration, None
        self._first_node = self.nodes
        self._last_node = self.nodes + (MAX_NODES if in_declaration else self._budget)
        return True

    def admits(self, nodes: int, depth: int) -> bool:
        """Return True if a body of at least this size fits into the present outermost call."""
        if self.excess is not None:
            return False
        if self._level + depth > NESTING_LIMIT:
            self.excess = Excess.DEPTH
        elif self.nodes + nodes > self._last_node:
            self.excess = Excess.SIZE
        return self.excess is None

    def count_unchecked(self, nodes: int, depth: int) -> bool:
        """Count an outermost call by its least size if too much was checked in declarations; True if so."""
        if not self._in_declaration or self._declaration_budget >= nodes:
            return False
        self.nodes += nodes
        self.deepest = max(self.deepest, self._level + depth)
        return True

    def end_outermost_call(self) -> Excess | None:
        """Take what the outermost call added from its budget; return the limit that it exceeds, if any."""
        added = self.nodes - self._first_node
        self.is_broken |= self.excess is not None
        if self._in_declaration:
            self._declaration_budget -= added
        else:
            self._budget = -1 if self.excess is Excess.SIZE else self._budget - added
        return self.excess

    # --- templates

    @property
    def budget(self) -> int:
        """Return the number of nodes that calls may still add to the program, negative after an excess."""
        return self._budget

    def refund(self, budget: int) -> None:
        """Go back to an earlier budget, since what was added is no part of the program."""
        if self._budget >= 0:
            self._budget = budget


# --- scope --------------------------------------------------------------------------------------------


@record
class SensorSymbol(Record):
    """A sensor of the robot."""

    sensor: ir.Sensor


@record
class EnumSymbol(Record):
    """An enum, whose members are named `enum.member`."""

    type: Enum


@record
class ParamSymbol(Record):
    """A named constant, in base units."""

    type: Type
    value: Value


@record
class TunableSymbol(ParamSymbol):
    """A param that may change while the program runs: a sensor, and its value at the start of a run."""

    sensor: ir.Sensor


@record
class LetSymbol(Record):
    """A let by its full name; `module` names the module that it is local to, if any."""

    name: str
    type: Type
    module: str | None = None


@record
class StateSymbol(Record):
    """A state by its full name."""

    name: str
    type: Scalar


@record
class MachineSymbol(Record):
    """A machine by its full name; its phases are the members of its type."""

    name: str
    type: Enum


@record
class AssumptionSymbol(Record):
    """An assumption by its full name, which only `broken(NAME)` reads."""

    name: str


@record
class PlaceholderSymbol(Record):
    """A parameter where its function is declared: only its type is known."""

    type: Type


@record
class ArgumentSymbol(Record):
    """A parameter where its function is called: the expression that the call gives it.

    Attributes:
        expression: the argument, checked in the context of the caller; its type is the parameter's.
        nodes: the number of nodes that were checked for it.
        depth: its nesting depth.
        iterations: the largest number of iterations of reductions nested in it.
        loops: the unique names of the variables of reductions in it, or around it.
        has_memory: True if it has memory functions.
    """

    expression: Expression
    nodes: int
    depth: int = 1
    iterations: int = 1
    loops: frozenset[str] = frozenset()
    has_memory: bool = False


@record
class TypedParameter(Record):
    """A parameter of a function or an input of a module; an array without `size` is of any length.

    `unit` is the declared unit of its values, if any. Only parameters of functions have a `default`.
    """

    name: str
    element: Scalar
    unit: str
    is_array: bool
    size: int | None
    default: Constant | None = None

    @property
    def type(self) -> Type | None:
        """Return the type, None if that depends on the length of the argument."""
        if not self.is_array:
            return self.element
        return None if self.size is None else Array(self.element, self.size)


@record
class FunctionSymbol(Record):
    """A function, whose body is checked at each call.

    Attributes:
        declaration: its declaration.
        parameters: its parameters, in order.
        scope: the names of its file.
        local: the names of its module above the declaration; empty for a function of a file.
        module_names: all names that its module declares.
        result: the type of its body, None if that depends on the arguments.
        nodes: the least number of nodes that a call adds to the program.
        depth: the least nesting depth of a call.
    """

    declaration: ast.FunctionDecl
    parameters: tuple[TypedParameter, ...]
    scope: FileScope
    local: Mapping[str, ValueSymbol]
    module_names: frozenset[str]
    result: Type | None = None
    nodes: int = 1
    depth: int = 1


@record
class BrokenSymbol(Record):
    """A name with an invalid or unreadable declaration: its uses report no further errors."""


ValueSymbol = (
    SensorSymbol
    | EnumSymbol
    | ParamSymbol
    | LetSymbol
    | StateSymbol
    | MachineSymbol
    | PlaceholderSymbol
    | ArgumentSymbol
    | FunctionSymbol
    | AssumptionSymbol
    | BrokenSymbol
)


@record
class ModuleSymbol(Record):
    """A module by its full name.

    Attributes:
        name: its full name.
        actuator: the actuator that it commands, if any.
        members: its params, inputs, lets and states, for contracts.
        unbound: its inputs that are not bound; it is only a template if there are any.
        home: the names of the file that its text is in; None before it is checked.
        derivation: its declaration up to further arguments, if it is derived: `module l = t(..., `.
        span: the span of its declaration; None before it is checked.
    """

    name: str
    actuator: str | None
    members: dict[str, ValueSymbol]
    unbound: tuple[str, ...] = ()
    home: FileScope | None = None
    derivation: str | None = None
    span: Span | None = None


@record
class WireSymbol(Record):
    """A wire by its full name."""

    name: str


@record
class SequenceSymbol(Record):
    """A sequence by its full name; its tasks are modules, and its wires wires, called `sequence.name`."""

    name: str


@record
class ActuatorSymbol(Record):
    """An actuator of the robot."""

    actuator: ir.Actuator


NetworkSymbol = ModuleSymbol | WireSymbol | SequenceSymbol | ActuatorSymbol | BrokenSymbol


@dataclass(slots=True)
class RobotScope:
    """Sensors and actuators, which are visible in every file. Filled in when the robot is checked.

    If the program has no robot, or its text cannot be read, unknown names are not reported. `sent` are the
    sensors `last...` that something reads, by name, and `tunables` the tunable params; `roles` is where
    something reads what a module did in the frame before, by file, name and place. `frame_ns` is the frame
    period, None while it is unknown. `renamed` are the sensors to which lets of files give other names, by
    these names in full. `title` is the robot with its file, for messages; `lacks` are the names that files
    with `import robot` read and nothing declares.
    """

    absent: bool = False
    title: str = ""
    lacks: set[str] = field(default_factory=set)
    frame_ns: int | None = None
    sent: dict[str, ir.Sensor] = field(default_factory=dict)
    roles: dict[tuple[object, str, int], tuple[FileScope, ast.By | ast.Is]] = field(default_factory=dict)
    tunables: dict[str, ir.Sensor] = field(default_factory=dict)
    renamed: dict[str, str] = field(default_factory=dict)
    sensor_names: set[str] = field(default_factory=set)
    actuator_names: set[str] = field(default_factory=set)
    values: dict[str, ValueSymbol] = field(default_factory=dict)
    network_symbols: dict[str, NetworkSymbol] = field(default_factory=dict)


@dataclass(slots=True)
class FileScope:
    """The names that are visible in one file. Filled in while the file is checked, then only read.

    `values` and `network_symbols` are the file's own declarations that have been checked. `visible_values`
    and `visible_network_symbols` map their names, and those of plain imports, to the scopes that own them.
    `lost_names` are names that unreadable text seems to declare; `incomplete` is true if an imported file is
    unreadable, so that any name may be declared there. `private_owners` maps the private names of imported
    files to these files' names; `is_read_by_alias` is true for a scope that another file reads through an
    alias.
    """

    file: ParsedFile
    robot: RobotScope
    site: Mapping[str, SiteValue] = field(default_factory=dict)  # by the full names of params
    values: dict[str, ValueSymbol] = field(default_factory=dict)
    network_symbols: dict[str, NetworkSymbol] = field(default_factory=dict)
    visible_values: dict[str, FileScope] = field(default_factory=dict)
    visible_network_symbols: dict[str, FileScope] = field(default_factory=dict)
    actuator_wires: dict[str, WireSymbol] = field(default_factory=dict)  # by name of the actuator
    aliases: dict[str, FileScope] = field(default_factory=dict)
    constant_names: set[str] = field(default_factory=set)  # the file's own params and enums
    lost_names: set[str] = field(default_factory=set)
    incomplete: bool = False
    private_names: dict[str, str] = field(default_factory=dict)  # the file's own, with their full names
    private_owners: dict[str, str] = field(default_factory=dict)
    is_read_by_alias: bool = False

    @property
    def is_for_any_robot(self) -> bool:
        """Return True for a file with `import robot`."""
        return any(isinstance(d, ast.RobotImportDecl) for d in self.file.tree.declarations)

    def value(self, name: str) -> ValueSymbol | None:
        """Return the value of a name, `BrokenSymbol` if it may be lost, None if it is unknown."""
        owner = None if self._hides(name) else self.visible_values.get(name)
        symbol = self.robot.values.get(name) if owner is None else owner.values.get(name)
        return BrokenSymbol() if symbol is None and self.may_be_lost(name) else symbol

    def network_symbol(self, name: str) -> NetworkSymbol | None:
        """Return the module, wire or actuator of a name; `BrokenSymbol` and None are as for `value`."""
        owner = None if self._hides(name) else self.visible_network_symbols.get(name.partition(".")[0])
        symbol = self.robot.network_symbols.get(name) if owner is None else owner.network_symbols.get(name)
        if self.robot.absent and isinstance(symbol, WireSymbol):
            return BrokenSymbol()  # it may be an actuator of the missing robot
        return BrokenSymbol() if symbol is None and self.may_be_lost(name) else symbol

    def _hides(self, name: str) -> bool:
        """Return True for a private name that another file asks for."""
        return self.is_read_by_alias and is_private(name)

    def declares_private(self, name: str) -> bool:
        """Return True if the file declares this private name."""
        return name in self.private_names

    def may_be_lost(self, name: str) -> bool:
        """Return True if the name may be declared in text that could not be read."""
        return self.robot.absent or self.incomplete or name in self.lost_names

    def resolve(self, path: tuple[str, ...]) -> tuple[FileScope, tuple[str, ...]]:
        """Follow aliases at the front of a path: the scope that they lead to, and the rest.

        An alias does not lead to the robot's names: they are never prefixed.
        """
        scope = self
        while len(path) > 1 and path[0] in scope.aliases and (scope is self or not is_private(path[0])):
            scope, path = scope.aliases[path[0]], path[1:]
        return (
            (scope, path)
            if scope is self
            else (replace(scope, robot=RobotScope(), is_read_by_alias=True), path)
        )

    def resolve_part(self, path: tuple[str, ...]) -> tuple[FileScope, tuple[str, ...]]:
        """Follow aliases as `resolve` does; a part of a sequence has one name, `sequence.part`."""
        scope, path = self.resolve(path)
        is_part = len(path) == 2 and isinstance(scope.network_symbol(path[0]), SequenceSymbol)
        return scope, (".".join(path),) if is_part else path

    def full_name(self, name: str) -> str:
        """Return the full name, in the program, of a name declared in this file."""
        head, dot, rest = name.partition(".")  # the parts of a sequence are called `sequence.part`
        return f"{self.private_names.get(head) or self.file.prefix + head}{dot}{rest}"


def is_private(name: str) -> bool:
    """Return True for a name that belongs to its file."""
    return name.startswith("_")


@dataclass(slots=True)
class CheckReport:
    """The findings of all checkers, and the number of memory cells so far.

    `suggestions` is the number of suggestions that may still be made; they are slow to compute. `size` counts
    what calls of functions add to the program.
    """

    diagnostics: list[Diagnostic] = field(default_factory=list)
    cells: int = 0
    suggestions: int = 100
    size: ProgramSize = field(default_factory=ProgramSize)

    def error(
        self,
        scope: FileScope,
        code: str,
        node: ast.SyntaxNode,
        message: str,
        hint: str | None = None,
        *labels: Label,
    ) -> None:
        """Report an error at a node of a scope's file."""
        self.diagnostics.append(error(code, span_of(scope, node), _truncate(message), hint, *labels))

    def suggest(self, name: str, known_names: Iterable[str]) -> str | None:
        """Return a hint with the closest known name, if any is close."""
        if self.suggestions == 0 or len(name) > _MAX_NAME_LENGTH:
            return None
        self.suggestions -= 1
        candidates = islice(
            (k for k in known_names if abs(len(k) - len(name)) <= _MAX_NAME_LENGTH // 8), 20_000
        )
        return did_you_mean(name, candidates)

    def new_cell(self) -> int:
        """Return the number of a new memory cell."""
        self.cells += 1
        return self.cells


def span_of(scope: FileScope, node: ast.SyntaxNode) -> Span:
    """Return the span of a node in a scope's file."""
    return Span(scope.file.source, node.start, node.end)


def label(scope: FileScope, node: ast.SyntaxNode, text: str = "first declared here") -> Label:
    """Return a label for another span that an error refers to."""
    return Label(span_of(scope, node), text)


def _truncate(message: str) -> str:
    """Return a message, truncated if very long names make it too long."""
    return message if len(message) <= _MAX_MESSAGE_LENGTH else f"{message[:_MAX_MESSAGE_LENGTH]} ..."


_MAX_MESSAGE_LENGTH = 1000
_MAX_NAME_LENGTH = 64
