"""Guards: one table of hash-consed Boolean nodes over the activity of modules.

A guard is a reference (an index) into the table, so that parts that clients have in common are stored once
and the output stays near-linear in the network, in memory and in JSON. Operands always come before the node
that uses them: a table is evaluated in one pass, without recursion.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Always:
    """The guard that is always true."""


@dataclass(frozen=True, slots=True)
class Never:
    """The guard that is never true."""


@dataclass(frozen=True, slots=True)
class ModuleActive:
    """The module puts a command on its output: its predicate holds, and it is not silent."""

    module: str


@dataclass(frozen=True, slots=True)
class Not:
    """The negation of a guard."""

    operand: int


@dataclass(frozen=True, slots=True)
class And:
    """The conjunction of two or more operands."""

    operands: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Or:
    """The disjunction of two or more operands."""

    operands: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Recently:
    """True from a frame in which the operand is, until, and not including, `window_ns` after the last one.

    It has memory, which moves on in every frame.
    """

    operand: int
    window_ns: int


Guard = Always | Never | ModuleActive | Not | And | Or | Recently


def operands(guard: Guard) -> tuple[int, ...]:
    """Return the operands of a guard, in order."""
    match guard:
        case And(operands=several) | Or(operands=several):
            return several
        case Not(operand=one) | Recently(operand=one):
            return (one,)
        case Always() | Never() | ModuleActive():
            return ()


@dataclass(slots=True)
class GuardTable:
    """A growing table that gives equal nodes one reference. Mutable: a builder, frozen by `freeze`."""

    nodes: list[Guard]
    _index: dict[Guard, int]
    _always: int

    def __init__(self, nodes: tuple[Guard, ...] = ()) -> None:
        self.nodes = list(nodes)
        self._index = {node: i for i, node in enumerate(nodes)}
        self._always = self._index.get(Always(), -1)

    def add(self, node: Guard) -> int:
        """Return the reference of `node`, added if it is new; its operands must be in the table."""
        at = self._index.get(node)
        if at is None:
            at = self._index[node] = len(self.nodes)
            self.nodes.append(node)
            if isinstance(node, Always):
                self._always = at
        return at

    def negation(self, operand: int) -> int:
        """Return `not operand`."""
        return self.add(Not(operand))

    def conjunction(self, parts: tuple[int, ...]) -> int:
        """Return the conjunction of `parts`, without those that are `Always`."""
        always = self._always
        kept = tuple([part for part in parts if part != always])
        if len(kept) > 1:
            return self.add(And(kept))
        return kept[0] if kept else self.add(Always())

    def disjunction(self, parts: tuple[int, ...]) -> int:
        """Return the disjunction of `parts`."""
        if len(parts) > 1:
            return self.add(Or(parts))
        return parts[0] if parts else self.add(Never())

    def recently(self, operand: int, window_ns: int) -> int:
        """Return the guard "`operand` held within the window"; without a window, `operand` itself."""
        return self.add(Recently(operand, window_ns)) if window_ns > 0 else operand

    def freeze(self) -> tuple[Guard, ...]:
        """Return the guards of the table so far."""
        return tuple(self.nodes)
