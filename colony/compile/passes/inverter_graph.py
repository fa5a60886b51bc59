"""And-inverter graphs: Boolean guards with one connective, and the local rules that simplify them.

A *literal* is `2 * node` for a node and `2 * node + 1` for its negation, so that complementing is `^ 1`.
Node 0 is constantly true. The other nodes are atoms (the activity of a module, or `recently` of a literal)
and conjunctions of two or more literals; a disjunction is the negation of a conjunction of negations.
With that, each rule is written once. In a conjunction, a literal of a conjunction node is a *cube*
if it is plain, and a *clause* if it is negated. The rules, with a, b, c literals, K a cube, w a window:

    a, a       = a          a, (a or b)           = a              a, recently(a)         = a
    a, not a   = never      a, (not a or b)       = a, b           not a, not recently(a) = not recently(a)
    K, a       = K          where K has a         (a or b), (a or c) = a or (b, c)
    K, not a   = never      where K has a         a, not recently(a) = never
    K, not a   = K          where K has not recently(a)

The rules do not look into a part with more than `REACH` parts of its own, so that the cost of a conjunction
is about its length. Implied parts are dropped all at once. Implications go down the graph (from a cube to its
parts) or up (from a part to clauses that contain it), but never down again after going up, so that no part
implies itself.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence

TRUE = 0
FALSE = 1

REACH = 8
"""Maximum number of parts of a conjunction that the rules look into, where it is part of another one."""

Conjunction = tuple[int, ...]

_MODULE, _RECENTLY, _SHORT, _LONG = range(4)  # kinds of nodes: atoms, and conjunctions by length


class InverterGraph:
    """A growing graph in which equal nodes share one number. Nodes come after their parts. Mutable."""

    def __init__(self) -> None:
        self.parts: list[Conjunction] = [()]  # by node; empty for atoms
        self.modules: dict[int, str] = {}
        self.recently: dict[int, tuple[int, int]] = {}  # literal and window
        self._kinds = bytearray([_MODULE])  # for speed: most accesses to a node only need its kind
        self._conjunctions: dict[Conjunction, int] = {}
        self._atoms: dict[str | tuple[int, int], int] = {}

    def __len__(self) -> int:
        """Return the number of nodes."""
        return len(self.parts)

    def module(self, name: str) -> int:
        """Return the literal of a module's activity."""
        node = self._atoms.get(name)
        if node is None:
            node = self._atoms[name] = self._add((), _MODULE)
            self.modules[node] = name
        return 2 * node

    def recently_literal(self, literal: int, window_ns: int) -> int:
        """Return the literal of `recently`; for a constant, or without a window, that of its operand."""
        if literal <= FALSE or window_ns == 0:
            return literal
        node = self._atoms.get((literal, window_ns))
        if node is None:
            node = self._atoms[literal, window_ns] = self._add((), _RECENTLY)
            self.recently[node] = (literal, window_ns)
        return 2 * node

    def raw_conjunction(self, literals: Conjunction) -> int:
        """Return the literal of a new node with these parts: at least one literal, in any order."""
        return 2 * self._add(literals, _LONG)

    def conjunction(self, literals: Iterable[int]) -> int:
        """Return the literal of the conjunction, with only constants, duplicates and complements reduced."""
        present = set(literals)
        present.discard(TRUE)
        if FALSE in present:
            return FALSE
        for literal in present:
            if literal ^ 1 in present:
                return FALSE
        return self._conjunction(present)

    def simpler_conjunction(self, literals: Iterable[int]) -> int:
        """Return the literal of the conjunction, with all rules applied once."""
        present = set(literals)
        present.discard(TRUE)
        facts, clauses = self._facts(present)
        known = present | facts if facts else present
        if FALSE in known:
            return FALSE
        for literal in known:
            if literal ^ 1 in known:
                return FALSE
        if not facts and not clauses:
            return self._conjunction(present)
        kept = present - facts
        kept.difference_update(clauses)
        remaining = {}
        for clause in sorted(clauses):
            if clause in facts:
                continue
            parts = self.parts[clause >> 1]  # the clause holds where one of these is false
            if any(part ^ 1 in known for part in parts):
                continue
            unknown_parts = tuple([part for part in parts if part not in known])
            if len(unknown_parts) < len(parts):
                kept.add(self.conjunction(unknown_parts) ^ 1)
            else:
                remaining[clause] = parts
        if not kept and len(remaining) > 1:
            return self._factor(remaining)
        kept.update(remaining)
        return self.conjunction(kept)

    def _conjunction(self, literals: set[int]) -> int:
        if len(literals) < 2:
            return literals.pop() if literals else TRUE
        parts = tuple(sorted(literals))
        node = self._conjunctions.get(parts)
        if node is None:
            node = self._conjunctions[parts] = self._add(parts, _SHORT if len(parts) <= REACH else _LONG)
        return 2 * node

    def _add(self, parts: Conjunction, kind: int) -> int:
        self.parts.append(parts)
        self._kinds.append(kind)
        return len(self.parts) - 1

    def _facts(self, literals: set[int]) -> tuple[set[int], list[int]]:
        """Return the parts that single literals imply beyond themselves, and the short clauses."""
        facts: set[int] = set()
        clauses: list[int] = []
        kinds = self._kinds
        for literal in literals:
            kind = kinds[literal >> 1]
            if kind == _SHORT:
                if literal & 1:
                    clauses.append(literal)
                    continue
                for part in self.parts[literal >> 1]:
                    facts.add(part)
                    if part & 1 and kinds[part >> 1] == _RECENTLY:
                        facts.add(self.recently[part >> 1][0] ^ 1)
            elif kind == _RECENTLY:
                operand, _ = self.recently[literal >> 1]
                if literal & 1:
                    facts.add(operand ^ 1)
                elif operand in literals:
                    facts.add(literal)
        return facts, clauses

    def _factor(self, clauses: dict[int, Conjunction]) -> int:
        """Factor short clauses that share literals: (a or b), (a or c) = a or (b, c)."""
        common = set.intersection(*map(set, clauses.values()))
        if not common:
            return self._conjunction(set(clauses))
        remainders = [
            self.conjunction([part for part in parts if part not in common]) ^ 1 for parts in clauses.values()
        ]
        return self.conjunction([*common, self.conjunction(remainders) ^ 1]) ^ 1


def zeros(length: int) -> array[int]:
    """Return an array of zeros; it is more compact than a list, since large networks exceed the cache."""
    return array("q", bytes(8 * length))


def _count_uses(graph: InverterGraph, roots: Sequence[int]) -> array[int]:
    """Count the uses of each node: 1 for a use as a cube of a used conjunction, 2 for any other."""
    uses = zeros(len(graph.parts))
    all_parts = graph.parts
    for literal in roots:
        uses[literal >> 1] += 2
    for node in range(len(uses) - 1, 0, -1):
        if not uses[node]:
            continue
        parts = all_parts[node]
        for literal in parts:
            uses[literal >> 1] += 2 if literal & 1 else 1
        if not parts and node in graph.recently:
            uses[graph.recently[node][0] >> 1] += 2
    return uses


def size_in_use(graph: InverterGraph, roots: Sequence[int]) -> int:
    """Return the number of nodes and parts of nodes that the roots need, plus one for the constant."""
    uses = _count_uses(graph, roots)
    return 1 + sum(1 + len(graph.parts[node]) for node in range(1, len(graph)) if uses[node])


_PENDING = -1  # instead of a literal: the node is still to be merged


def rewrite(graph: InverterGraph, roots: Sequence[int]) -> tuple[InverterGraph, list[int]]:
    """Apply one round of the rules to all that the roots need; return the new graph and roots.

    A cube that is used in only one other conjunction is merged into it: its literals wait in `pending`, and
    the conjunction extends the longest of these lists with the others. A shared cube stays a node, since
    copying its parts into all conjunctions that use it would be quadratic.
    """
    simpler = InverterGraph()
    uses = _count_uses(graph, roots)
    pending: dict[int, list[int]] = {}
    to = zeros(len(uses))
    for node, parts in enumerate(graph.parts):
        if not parts:
            if node and uses[node]:
                to[node] = _rewrite_atom(graph, node, simpler, to)
        elif uses[node]:
            literals = [to[part >> 1] ^ (part & 1) for part in parts if to[part >> 1] != _PENDING]
            if len(literals) < len(parts):
                merged = [pending.pop(part) for part in parts if to[part >> 1] == _PENDING]
                literals = _concatenate([*merged, literals])
            if uses[node] == 1:
                pending[2 * node] = literals
                to[node] = _PENDING
            else:
                to[node] = simpler.simpler_conjunction(literals)
    return simpler, [to[literal >> 1] ^ (literal & 1) for literal in roots]


def _rewrite_atom(graph: InverterGraph, node: int, simpler: InverterGraph, to: Sequence[int]) -> int:
    if node not in graph.recently:
        return simpler.module(graph.modules[node])
    literal, window_ns = graph.recently[node]
    return simpler.recently_literal(to[literal >> 1] ^ (literal & 1), window_ns)


def _concatenate(lists: list[list[int]]) -> list[int]:
    """Return the longest of the lists, with all others appended."""
    whole = max(lists, key=len)
    for part in lists:
        if part is not whole:
            whole += part
    return whole
