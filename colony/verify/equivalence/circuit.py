"""And-inverter graphs: the Boolean functions of a proof; equal functions share nodes where possible.

A *literal* is `2 * node`, or `2 * node + 1` for its negation. Node 0 is constantly false; the others are
inputs and conjunctions of two literals. Nodes come after their operands. A few rules of Boolean algebra are
applied to a new conjunction, which is then looked up by its two operands:

    a, true = a      a, false = false      a, a = a      a, not a = false
    a, (a, b) = (a, b)                     not a, (a, b) = false
    a, not (not a, b) = a                  a, not (a, b) = a, not b

So formulas of the same, or nearly the same, structure become one literal. Most of a compilation is proved
this way ("by structure"); the rest is left to a solver.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

FALSE = 0
TRUE = 1

_INPUT = -1


@dataclass(frozen=True, slots=True)
class Activity:
    """An input: a module puts a command on its output. Its predicate is free."""

    module: str


@dataclass(frozen=True, slots=True)
class HeldInput:
    """An input: `operand` (a literal) held in an earlier frame less than `window_ns` ago. Free."""

    operand: int
    window_ns: int


@dataclass(frozen=True, slots=True)
class Opaque:
    """An input: any other condition, identified by its text. Free."""

    text: str


Input = Activity | HeldInput | Opaque


class Circuit:
    """A growing graph. Mutable; the meaning of a literal never changes."""

    def __init__(self) -> None:
        self.left: list[int] = [_INPUT]
        self.right: list[int] = [_INPUT]
        self.inputs: dict[Input, int] = {}
        self._conjunctions: dict[tuple[int, int], int] = {}
        self._wide: dict[tuple[int, ...], int] = {}  # conjunctions of any number of literals
        self._partners: dict[int, list[int]] = {}  # by literal: literals that it is conjoined with

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.left)

    def input(self, key: Input) -> int:
        """Return the literal of a free input; equal inputs have the same literal."""
        literal = self.inputs.get(key)
        if literal is None:
            literal = self.inputs[key] = self._add(_INPUT, _INPUT)
        return literal

    def both(self, a: int, b: int) -> int:
        """Return the conjunction of two literals."""
        if a > b:
            a, b = b, a
        if a <= TRUE:
            return b if a else FALSE
        if a == b:
            return a
        if a ^ b == 1:
            return FALSE
        literal = self._conjunctions.get((a, b))
        if literal is None:
            literal = self._conjunctions[a, b] = self._simplify(a, b)
        return literal

    def either(self, a: int, b: int) -> int:
        """Return the disjunction of two literals."""
        return self.both(a ^ 1, b ^ 1) ^ 1

    def all(self, literals: Iterable[int]) -> int:
        """Return the conjunction of literals, associated so that it reuses existing conjunctions.

        The same literals always give the same conjunction, whatever was added in the meantime.
        """
        remaining = set(literals)
        pending = sorted(remaining)
        key = tuple(pending)
        existing = self._wide.get(key)
        if existing is not None:
            return existing
        while pending:
            literal = pending.pop()
            if literal not in remaining:
                continue
            partner = self._partner(literal, remaining)
            if partner is not None:
                remaining -= {literal, partner}
                joined = self.both(literal, partner)
                if joined not in remaining:
                    remaining.add(joined)
                    pending.append(joined)
        result = TRUE
        for literal in sorted(remaining):
            result = self.both(result, literal)
        self._wide[key] = result
        return result

    def any(self, literals: Iterable[int]) -> int:
        """Return the disjunction of literals; see `all`."""
        return self.all([literal ^ 1 for literal in literals]) ^ 1

    def same(self, a: int, b: int) -> int:
        """Return the literal "`a` equals `b`"."""
        return self.either(self.both(a, b), self.both(a ^ 1, b ^ 1))

    def choice(self, condition: int, yes: int, no: int) -> int:
        """Return the literal "`yes` if the condition holds, otherwise `no`"."""
        return self.either(self.both(condition, yes), self.both(condition ^ 1, no))

    def is_input(self, node: int) -> bool:
        """Return True if a node is an input."""
        return self.left[node] == _INPUT

    def _partner(self, literal: int, candidates: set[int]) -> int | None:
        """Return the latest of `candidates` whose conjunction with `literal` exists already."""
        partners = self._partners.get(literal, ())
        if len(partners) <= len(candidates):
            return max((other for other in partners if other in candidates), default=None)
        conjunctions = self._conjunctions
        return max(
            (
                o
                for o in candidates
                if ((literal, o) if literal < o else (o, literal)) in conjunctions and o != literal
            ),
            default=None,
        )

    def _simplify(self, a: int, b: int) -> int:
        """Apply the rules for operands that are conjunctions; return the result."""
        for one, other in ((a, b), (b, a)):
            left, right = self.left[other >> 1], self.right[other >> 1]
            if left == _INPUT:
                continue
            if other & 1:
                if one ^ 1 in (left, right):
                    return one
                if one == left:
                    return self.both(one, right ^ 1)
                if one == right:
                    return self.both(one, left ^ 1)
            elif one in (left, right):
                return other
            elif one ^ 1 in (left, right):
                return FALSE
        return self._add(a, b)

    def _add(self, left: int, right: int) -> int:
        self.left.append(left)
        self.right.append(right)
        if left != _INPUT:
            self._partners.setdefault(left, []).append(right)
            self._partners.setdefault(right, []).append(left)
        return 2 * (len(self.left) - 1)
