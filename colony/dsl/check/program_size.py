"""The size of a program as calls of functions let it grow, counted while it is checked.

A call puts the body of its function in its place. If each of twenty functions calls the one before it twice,
the last stands for a million bodies. So nodes of expressions are counted, and a call that exceeds a limit is
refused before its body is checked, by the least size and depth that its function has.

An *outermost* call stands where people wrote it: in the program, or in the declaration of a function, whose
body is checked once to find its errors. A call in a body that is called is part of the outermost one, which
reports that all of it is too large or too deep.

Calls in the program share one budget, since their nodes stay in the program. Calls in declarations add
nothing to it: each may be as large as a program, and a budget of their own bounds the time that all of them
take. Once it is used up, calls in declarations are counted without checking their bodies.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from colony.ir.expression import NESTING_LIMIT

MAX_NODES = 100_000
"""Maximum number of nodes that calls of functions add to a program."""

_MAX_NODES_IN_DECLARATIONS = 20_000
"""Number of nodes after which calls in declarations of functions are no longer checked."""


class Excess(Enum):
    """The limit that a call exceeds."""

    DEPTH = auto()
    SIZE = auto()


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
