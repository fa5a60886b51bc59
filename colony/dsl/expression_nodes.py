"""The syntax tree of expressions; `ast` has all else of the tree, and these nodes, too.

`start` and `end` are character offsets in the file. They are not compared, so two texts that differ only in
layout have equal trees. `depth` is the nesting depth of an expression: the checker rejects expressions that
are too deep before anything recurses into them.
"""

from __future__ import annotations

from dataclasses import field
from typing import Literal

from colony.record import Record, record


@record
class SyntaxNode(Record):
    """A node for a piece of text."""

    start: int = field(default=0, compare=False, repr=False)
    end: int = field(default=0, compare=False, repr=False)


@record
class NameNode(SyntaxNode):
    """An identifier, in its declaration or in a use."""

    text: str


@record
class NamedNode(SyntaxNode):
    """A declaration with a name, which is its first identifier or the one after its keyword."""

    name: NameNode


# --- expressions ---------------------------------------------------------------------------------


@record
class ExpressionNode(SyntaxNode):
    """Any expression; a leaf has depth 1."""

    depth: int = field(default=1, compare=False, repr=False)


@record
class NumberNode(ExpressionNode):
    """A number as written, with its unit, if any."""

    digits: str
    unit: str | None


@record
class Boolean(ExpressionNode):
    """`true` or `false`."""

    value: bool


@record
class Reference(ExpressionNode):
    """`name`, `name.name`, ...; the checker resolves it."""

    path: tuple[str, ...]

    @property
    def text(self) -> str:
        """Return the dotted name as written."""
        return ".".join(self.path)


@record
class Prefix(ExpressionNode):
    """`-x` or `not b`."""

    operator: Literal["-", "not"]
    operand: Expression


@record
class Infix(ExpressionNode):
    """Two operands and an arithmetic, relational or Boolean operator, as written."""

    operator: str
    left: Expression
    right: Expression


@record
class If(ExpressionNode):
    """`if condition then yes else no`."""

    condition: Expression
    yes: Expression
    no: Expression


@record
class InRange(ExpressionNode):
    """`operand in low .. high`."""

    operand: Expression
    low: Expression
    high: Expression


@record
class IndexNode(ExpressionNode):
    """`array[index]`."""

    array: Expression
    index: Expression


@record
class SliceOf(ExpressionNode):
    """`array[first..last]`."""

    array: Expression
    first: Expression
    last: Expression


@record
class CallNode(ExpressionNode):
    """`function(argument, ..., name = argument, ...)`; the function's name may be dotted."""

    function: NameNode
    arguments: tuple[Expression, ...]
    named: tuple[Argument, ...] = ()


@record
class Comprehension(ExpressionNode):
    """`function(body for variable in low .. high [if condition])`."""

    function: NameNode
    body: Expression
    variable: NameNode
    low: Expression
    high: Expression
    condition: Expression | None


@record
class ElementsComprehension(ExpressionNode):
    """`function(body for variable in array [if condition])`, or `for variable, bearing in array`."""

    function: NameNode
    body: Expression
    variable: NameNode
    bearing: NameNode | None
    array: Expression
    condition: Expression | None


@record
class By(ExpressionNode):
    """`actuator by module`."""

    actuator: Expression
    module: Expression


Status = Literal["active", "commanded", "idle"]


@record
class Is(ExpressionNode):
    """`name is active`, `actuator is commanded`, `actuator is idle`."""

    subject: Expression
    status: Status


Expression = (
    NumberNode
    | Boolean
    | Reference
    | Prefix
    | Infix
    | If
    | InRange
    | IndexNode
    | SliceOf
    | CallNode
    | Comprehension
    | ElementsComprehension
    | By
    | Is
)


@record
class NamedValue(NamedNode):
    """A declaration that gives a name a value."""

    value: Expression


@record
class Argument(NamedValue):
    """`name = value`."""
