"""Questions to z3: can these clauses over a circuit all be true?

A clause may depend on many nodes, most of which do not matter. So z3 is first asked only about the nearest
nodes, with all others as free inputs. If this question has no solution, neither have the clauses. Otherwise
it is repeated with more nodes, and finally with all.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum, unique
from heapq import heapify, heappop, heappush
from itertools import chain

from colony.verify.equivalence.circuit import FALSE, Circuit

Clause = tuple[int, ...]
"""Literals of which one must be true."""

NEAR_LIMITS = (20, 200, 2_000)
"""Numbers of nearby conjunctions to consider, in turn, before all are considered."""

RESOURCES_PER_SECOND = 100_000
"""Number of z3's resource units that take its propositional solver about a second on an ordinary machine."""

_MAX_RESOURCES = 2**32 - 1
"""The largest limit that z3 takes."""

BATCH_SIZE = 100
"""Number of small questions that are asked at once."""


@unique
class Unsettled(Enum):
    """No answer: too few nodes were considered, or the solver gave up."""

    TOO_FEW_NODES = "too few nodes"
    GAVE_UP = "gave up"


@dataclass(frozen=True, slots=True)
class Unsatisfiable:
    """The answer that the clauses cannot all be true."""


@dataclass(frozen=True, slots=True)
class Satisfied:
    """A solution: the relevant inputs that are true in it. All others may be false."""

    inputs: frozenset[int]


Answer = Unsatisfiable | Satisfied | Unsettled


class CircuitSolver:
    """z3 for one circuit. Stateful: counts its questions.

    `seconds` limits each question. They are counted in z3's resources, so that a proof that succeeds on one
    machine succeeds on all.
    """

    def __init__(self, circuit: Circuit, seconds: float) -> None:
        self.circuit = circuit
        self.seconds = seconds
        self.question_count = 0

    @property
    def uses_z3(self) -> bool:
        """True if z3 is used at all; if not, only obvious contradictions are refuted."""
        return self.seconds > 0

    @property
    def _resources(self) -> int:
        return min(max(1, round(self.seconds * RESOURCES_PER_SECOND)), _MAX_RESOURCES)

    def refutes(self, clauses: Sequence[Clause], near_limits: Sequence[int] = NEAR_LIMITS) -> bool:
        """Return True if nearby conjunctions suffice to show that the clauses cannot all be true."""
        return obviously_unsatisfiable(clauses) or any(
            isinstance(self._ask(clauses, limit), Unsatisfiable) for limit in near_limits
        )

    def refutes_each(self, questions: Iterable[Sequence[Clause]]) -> bool:
        """Return True if nearby conjunctions refute every question; many questions are asked at once."""
        open_questions = [clauses for clauses in questions if not obviously_unsatisfiable(clauses)]
        for start in range(0, len(open_questions), BATCH_SIZE):
            batch = open_questions[start : start + BATCH_SIZE]
            if not self._refutes_all_at_once(batch) and not all(self.refutes(clauses) for clauses in batch):
                return False
        return True

    def decide(self, clauses: Sequence[Clause]) -> Answer:
        """Decide if the clauses can all be true, considering as many conjunctions as needed."""
        if obviously_unsatisfiable(clauses):
            return Unsatisfiable()
        for limit in NEAR_LIMITS:
            answer = self._ask(clauses, limit)
            if answer is not Unsettled.TOO_FEW_NODES:
                return answer
        return self._ask(clauses, len(self.circuit))

    def _ask(self, clauses: Sequence[Clause], limit: int) -> Answer:
        if not self.uses_z3:
            return Unsettled.GAVE_UP
        self.question_count += 1
        cone = _cone(self.circuit, clauses, limit)
        cnf = _Cnf(self.circuit, cone.inner, cone.leaves)
        for clause in clauses:
            cnf.add(clause)
        complete = all(self.circuit.is_input(node) for node in cone.leaves)
        possible, model = cnf.solve(self._resources, with_model=complete)
        if possible is None:
            return Unsettled.GAVE_UP
        if not possible:
            return Unsatisfiable()
        if not complete:
            return Unsettled.TOO_FEW_NODES
        return Satisfied(frozenset(node for node in cone.leaves if cnf.number[node] in model))

    def _refutes_all_at_once(self, questions: Sequence[Sequence[Clause]]) -> bool:
        """Return True if one call shows that none of the questions has a solution."""
        if not self.uses_z3:
            return False
        self.question_count += 1
        cones = [_cone(self.circuit, clauses, NEAR_LIMITS[0]) for clauses in questions]
        inner = dict.fromkeys(chain.from_iterable(cone.inner for cone in cones))
        leaves = dict.fromkeys(chain.from_iterable(cone.leaves for cone in cones))
        cnf = _Cnf(self.circuit, list(inner), [node for node in leaves if node not in inner])
        cnf.add_one_of(questions)
        return cnf.solve(self._resources, with_model=False)[0] is False


def differ(a: int, b: int) -> tuple[Clause, Clause]:
    """Return the clauses that state that two literals are not equal."""
    return ((a, b), (a ^ 1, b ^ 1))


def obviously_unsatisfiable(clauses: Sequence[Clause]) -> bool:
    """Return True if clauses with a single literal contradict all literals of some clause."""
    units = {clause[0] for clause in clauses if len(clause) == 1}
    return any(all(i == FALSE or i ^ 1 in units for i in clause) for clause in clauses)


class _Cnf:
    """A formula in conjunctive normal form, as text for z3. Mutable."""

    def __init__(self, circuit: Circuit, inner: Sequence[int], leaves: Sequence[int]) -> None:
        self.number = {node: i for i, node in enumerate((0, *inner, *leaves), start=1)}
        self._variables = len(self.number)
        self._lines = ["-1 0"]
        self._clauses = 1 + 3 * len(inner)
        for node in inner:
            number = self.number[node]
            left, right = self._signed(circuit.left[node]), self._signed(circuit.right[node])
            self._lines.append(f"-{number} {left} 0\n-{number} {right} 0\n{number} {-left} {-right} 0")

    def _signed(self, literal: int) -> int:
        number = self.number[literal >> 1]
        return -number if literal & 1 else number

    def add(self, clause: Clause, unless: str = "") -> None:
        """Add a clause, which need not hold if `unless` does."""
        self._lines.append(f"{unless} {' '.join(str(self._signed(i)) for i in clause)} 0")
        self._clauses += 1

    def add_one_of(self, questions: Sequence[Sequence[Clause]]) -> None:
        """Add the condition that all clauses of at least one of the questions hold."""
        choices = range(self._variables + 1, self._variables + len(questions) + 1)
        self._variables += len(questions)
        for choice, clauses in zip(choices, questions, strict=True):
            for clause in clauses:
                self.add(clause, unless=f"-{choice}")
        self._lines.append(f"{' '.join(map(str, choices))} 0")
        self._clauses += 1

    def solve(self, resources: int, with_model: bool) -> tuple[bool | None, frozenset[int]]:
        """Return True if all clauses can be true (None if z3 gives up), and the variables that are true."""
        import z3

        solver = z3.SolverFor("QF_FD")
        solver.set("rlimit", resources)
        solver.from_string(f"p cnf {self._variables} {self._clauses}\n" + "\n".join(self._lines) + "\n")
        result = solver.check()
        if result != z3.sat or not with_model:
            return (None if result == z3.unknown else result == z3.sat), frozenset()
        model = solver.model()
        true = (decl.name() for decl in model.decls() if z3.is_true(model[decl]))
        return True, frozenset(int(name.removeprefix("k!")) for name in true)


# --- cones of influence --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Cone:
    """Conjunctions to encode (`inner`), and their other operands, inputs or not, as free variables."""

    inner: list[int]
    leaves: list[int]


def _cone(circuit: Circuit, clauses: Sequence[Clause], limit: int) -> _Cone:
    """Return the conjunctions of which the clauses' literals consist, up to a limit.

    Parts of a single literal come first: if two formulas are compared, their common parts are mostly better
    left free. Among these, with a small limit the nearest come first, otherwise those behind the fewest
    negations, so that conjunctions of the same parts in a different order can be compared.
    """
    nearest = limit <= NEAR_LIMITS[0]
    sides = {literal >> 1: 1 << i for i, literal in enumerate(chain.from_iterable(clauses))}
    sides.pop(0, None)
    heap = [(_shared(side), 0, -node) for node, side in sides.items()]
    heapify(heap)
    cone, visited = _Cone([], []), set[int]()
    while heap:
        shared, distance, negative = heappop(heap)
        node = -negative
        if node in visited:
            continue
        if not shared and _shared(sides[node]):
            heappush(heap, (True, distance, negative))
            continue
        visited.add(node)
        if circuit.is_input(node) or len(cone.inner) >= limit:
            cone.leaves.append(node)
            continue
        cone.inner.append(node)
        for literal in (circuit.left[node], circuit.right[node]):
            part = literal >> 1
            before = sides.get(part, 0)
            if part not in visited:
                sides[part] = before | sides[node]
                if not before:
                    heappush(heap, (_shared(sides[part]), distance + (1 if nearest else literal & 1), -part))
    return cone


def _shared(sides: int) -> bool:
    """Return True if more than one bit is set."""
    return sides & (sides - 1) != 0
