"""Simplification of guards: sound, local and near-linear. The rules are in `inverter_graph`."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import assert_never

from colony.compile.guards import (
    ActuatorClients,
    Always,
    And,
    ClientList,
    Guard,
    ModuleActive,
    Never,
    Not,
    Or,
    Recently,
    operands,
)

# --- inverter graph -----------------------------------------------------------------------------------
#
# And-inverter graphs: Boolean guards with one connective, and the local rules that simplify them.
#
# A *literal* is `2 * node` for a node and `2 * node + 1` for its negation, so that complementing is `^ 1`.
# Node 0 is constantly true. The other nodes are atoms (the activity of a module, or `recently` of a literal)
# and conjunctions of two or more literals; a disjunction is the negation of a conjunction of negations.
# With that, each rule is written once. In a conjunction, a literal of a conjunction node is a *cube*
# if it is plain, and a *clause* if it is negated. The rules, with a, b, c literals, K a cube, w a window:
#
#     a, a       = a          a, (a or b)           = a              a, recently(a)         = a
#     a, not a   = never      a, (not a or b)       = a, b           not a, not recently(a) = not recently(a)
#     K, a       = K          where K has a         (a or b), (a or c) = a or (b, c)
#     K, not a   = never      where K has a         a, not recently(a) = never
#     K, not a   = K          where K has not recently(a)
#
# The rules do not look into a part with more than `REACH` parts of its own, so that the cost of a conjunction
# is about its length. Implied parts are dropped all at once. Implications go down the graph (from a cube to
# its parts) or up (from a part to clauses that contain it), but never down again after going up, so that no
# part implies itself.

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


# --- simplify -----------------------------------------------------------------------------------------

WORTHWHILE = 0.01
"""Minimum relative reduction in size by a round of rewriting for another round to follow."""


def simplify(clients: ClientList) -> ClientList:
    """Return the same clients with simpler guards, in a table without unused nodes.

    Each guard holds in the same frames as before, whichever modules are active. Clients whose guard is never
    true stay in the list: their priorities are part of the compiled form, and lints report them.
    """
    references = _references(clients)
    graph, literals = rewrite(*_load(clients.guards, references))
    size, saved = size_in_use(graph, literals), 1.0
    while saved > WORTHWHILE:
        simpler, simpler_literals = rewrite(graph, literals)
        simpler_size = size_in_use(simpler, simpler_literals)
        saved = 1 - simpler_size / size
        if saved > 0:
            graph, literals, size = simpler, simpler_literals, simpler_size
    guards, new_references = _unload(graph, literals)
    return _renumbered(clients, guards, dict(zip(references, new_references, strict=True)))


def _references(clients: ClientList) -> list[int]:
    """Return the references of a client list into its table, each once."""
    unique = dict.fromkeys(
        ref for actuator in clients.actuators for c in actuator.clients for ref in (c.guard, c.exclusive)
    )
    unique |= dict.fromkeys(ref for _, ref in clients.observed)
    return list(unique)


def _renumbered(clients: ClientList, guards: tuple[Guard, ...], new: dict[int, int]) -> ClientList:
    """Return the client list over another table; `new` maps old references to new ones."""
    actuators = []
    for actuator in clients.actuators:
        new_references = [
            replace(c, guard=new[c.guard], exclusive=new[c.exclusive]) for c in actuator.clients
        ]
        actuators.append(ActuatorClients(actuator=actuator.actuator, clients=tuple(new_references)))
    observed = tuple((name, new[ref]) for name, ref in clients.observed)
    return ClientList(guards=guards, actuators=tuple(actuators), observed=observed)


def _load(guards: Sequence[Guard], references: Sequence[int]) -> tuple[InverterGraph, list[int]]:
    """Return the graph of all guards that the references need, and their literals."""
    used = bytearray(len(guards))
    for ref in references:
        used[ref] = 1
    for index in range(len(guards) - 1, -1, -1):
        if used[index]:
            for operand in operands(guards[index]):
                used[operand] = 1
    graph = InverterGraph()
    literals = zeros(len(guards))
    for index, guard in enumerate(guards):
        if used[index]:
            literals[index] = _literal(guard, graph, literals)
    return graph, [literals[ref] for ref in references]


def _literal(guard: Guard, graph: InverterGraph, literals: Sequence[int]) -> int:
    match guard:
        case And(operands=parts):
            return graph.raw_conjunction(tuple([literals[part] for part in parts]))
        case Or(operands=parts):
            return graph.raw_conjunction(tuple([literals[part] ^ 1 for part in parts])) ^ 1
        case Not(operand=operand):
            return literals[operand] ^ 1
        case ModuleActive(module=module):
            return graph.module(module)
        case Recently(operand=operand, window_ns=window_ns):
            return graph.recently_literal(literals[operand], window_ns)
        case Always():
            return TRUE
        case Never():
            return FALSE
        case _:
            assert_never(guard)


def _unload(graph: InverterGraph, literals: Sequence[int]) -> tuple[tuple[Guard, ...], list[int]]:
    """Return a table of guards for the graph, and references in place of the literals.

    A conjunction becomes an `And`, or the `Or` of the negated parts, whichever saves more negations.
    """
    flips = _negated_conjunctions(graph, literals)
    guards: list[Guard] = []
    references = zeros(2 * len(flips))  # by literal: one more than its index in the table

    def add(literal: int, guard: Guard) -> int:
        guards.append(guard)
        references[literal] = len(guards)
        return len(guards) - 1

    def reference(literal: int) -> int:
        index = references[literal] - 1
        if index >= 0:
            return index
        if literal <= FALSE:
            return add(literal, Always() if literal == TRUE else Never())
        return add(literal, Not(references[literal ^ 1] - 1))

    for node, (parts, flip) in enumerate(zip(graph.parts, flips, strict=True)):
        if flip < 0 or not node:
            continue
        if parts:
            refs = tuple([reference(part ^ flip) for part in parts])
            add(2 * node + flip, Or(refs) if flip else And(refs))
        elif node in graph.recently:
            literal, window_ns = graph.recently[node]
            add(2 * node, Recently(reference(literal), window_ns))
        else:
            add(2 * node, ModuleActive(graph.modules[node]))
    new_references = [reference(literal) for literal in literals]
    return tuple(guards), new_references


def _negated_conjunctions(graph: InverterGraph, literals: Sequence[int]) -> array[int]:
    """Return, by node, 1 for a conjunction that is mostly used negated, 0 for others, -1 if it is unused.

    Uses are counted in the form in which the using nodes will be written.
    """
    balance, used = zeros(len(graph.parts)), bytearray(len(graph.parts))
    flips = zeros(len(graph.parts))

    def use(literal: int) -> None:
        used[literal >> 1] = 1
        balance[literal >> 1] += 1 if literal & 1 else -1

    for literal in literals:
        use(literal)
    for node in range(len(used) - 1, -1, -1):
        if not used[node]:
            flips[node] = -1
            continue
        parts = graph.parts[node]
        flip = flips[node] = 1 if parts and balance[node] > 0 else 0
        for part in parts:
            use(part ^ flip)
        if node in graph.recently:
            use(graph.recently[node][0])
    return flips
