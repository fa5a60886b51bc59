"""Candidate invariants of memory: templates, filled with the cells and constants of a program.

A candidate may be false: Houdini keeps those that are invariants. Their number is linear in the number of
cells, except for pairs of cells, of which there are at most `_MAX_PAIRS`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, permutations
from random import Random
from typing import assert_never

import z3

from colony.ir.program import Machine, Module, Program, Robot, State, gaps_ns
from colony.ir.types import Enum
from colony.verify.contracts.slicing import facts, formulas_of, within
from colony.verify.contracts.solver import Budget, IncrementalSolver, SolverAnswer
from colony.verify.symbolic.system import ContractFormula, ExtendedReal, SensorInput, SymbolicCell, System
from colony.verify.symbolic.unrolling import Cone, Substitution

_MAX_PAIRS = 300
_MAX_BOUNDS = 16
_SMALL = 2**48  # sums of up to 32 such numbers are exact

HELD = "assumptions held"
"""Name of the state that all assumptions held in the frames before; names of the language have no blanks."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A condition that may hold before every frame; `text` describes it."""

    text: str
    formula: z3.BoolRef


def candidates(cone: Cone, claims: tuple[ContractFormula, ...]) -> tuple[Candidate, ...]:
    """Return the distinct candidates for a cone that hold in the initial memory.

    Bounds come from the constants that the cells' own formulas and those of `claims` mention.
    """
    system = cone.system
    flags = [c for c in cone.cells if z3.is_bool(c.old)]
    numbers = [c for c in cone.cells if z3.is_arith(c.old) and str(c.old) != str(system.last)]
    contract_constants = numerals([c.holds for c in claims])
    guesses = (
        *_unchanged(system, cone.cells),
        *_phases(system, cone),
        *_timestamps(system, flags, numbers),
        *_bounds(numbers, contract_constants),
        *_pairs_of_flags(system, cone, flags),
        *_pairs_of_numbers(numbers),
    )
    held = next((c for c in flags if HELD in c.name), None)
    return initially_true(cone, guesses if held is None else (_up_to_breach(held, g) for g in guesses))


def _up_to_breach(held: SymbolicCell, guess: Candidate) -> Candidate:
    """Return the guess that something holds while no assumption was broken, which contracts ask for alone."""
    return Candidate(f"{guess.text} while assumptions hold", z3.Or(z3.Not(held.old), guess.formula))


def initially_true(cone: Cone, guesses: Iterable[Candidate]) -> tuple[Candidate, ...]:
    """Return the distinct guesses that hold in the initial memory."""
    in_initial_memory = Substitution([c.old for c in cone.cells], [c.initial for c in cone.cells])
    found: dict[int, Candidate] = {}
    for candidate in guesses:
        if z3.is_true(z3.simplify(in_initial_memory(candidate.formula))):
            found.setdefault(candidate.formula.get_id(), candidate)
    return tuple(found.values())


def for_floats(cone: Cone, used: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Return guesses of what holds in floats, from the invariants `used` of a proof over reals.

    Sums of whole numbers are exact only where they are small, and often that is so under a condition on a
    flag. So all of them are guessed, and under each such condition, too, and that numbers are finite, small,
    and not negative.
    """
    flags = [c for c in cone.cells if z3.is_bool(c.old) and c.old.get_id() != cone.system.begun.get_id()]
    numbers = [c for c in cone.cells if z3.is_arith(c.old) and c.old.get_id() != cone.system.last.get_id()]
    special = {f"{c.name}.{kind}" for c in numbers for kind in ("nan", "infinite")}
    always = [*used, *(Candidate(f"not {c.name}", z3.Not(c.old)) for c in flags if c.name in special)]
    for cell in numbers:
        always.append(Candidate(f"{cell.name} >= 0", cell.old >= 0))
        always.append(Candidate(f"{cell.name} >= {-_SMALL}", cell.old >= -_SMALL))
        always.append(Candidate(f"{cell.name} <= {_SMALL}", cell.old <= _SMALL))
    conditions = [
        condition
        for c in flags
        if c.name not in special
        for condition in (Candidate(c.name, c.old), Candidate(f"not {c.name}", z3.Not(c.old)))
    ]
    sometimes = (
        Candidate(f"{condition.text} or {guess.text}", z3.Or(condition.formula, guess.formula))
        for condition in conditions
        for guess in always
    )
    return initially_true(cone, (*always, *sometimes))


def _unchanged(system: System, cells: tuple[SymbolicCell, ...]) -> Iterator[Candidate]:
    """Yield the guesses that a cell keeps its initial value, or keeps it until the first frame."""
    for cell in cells:
        if str(cell.old) == str(system.begun):
            continue
        unchanged = cell.old == cell.initial
        yield Candidate(f"{cell.name} is always {cell.initial}", unchanged)
        yield Candidate(
            f"{cell.name} is {cell.initial} before the first frame", z3.Or(system.begun, unchanged)
        )


def _phases(system: System, cone: Cone) -> Iterator[Candidate]:
    """Yield the guesses that a machine or an enum state has one of its members as its value."""
    for name, members in _enumerated(system.program):
        if name not in system.states:
            continue
        value = formulas_of(system.states[name])[0]
        if within(cone, value):
            text = f"{name} is one of {', '.join(member for member, _ in members)}"
            yield Candidate(text, z3.Or(*(value == number(n) for _, n in members)))


def _enumerated(program: Program) -> Iterator[tuple[str, tuple[tuple[str, float], ...]]]:
    for derived in program.derived:
        match derived:
            case Machine(name=name, type=type_):
                yield name, type_.members
            case State(name=name, type=Enum(members=members)):
                yield name, members
            case _:
                pass
    for module in program.modules:
        if isinstance(module, Module):
            for state in module.states:
                if isinstance(state.type, Enum):
                    yield state.name, state.type.members


def number(x: float) -> z3.RatNumRef:
    """Return a float as z3's exact number."""
    exact = Fraction(x)
    return z3.Q(exact.numerator, exact.denominator)


def _timestamps(
    system: System, flags: list[SymbolicCell], numbers: list[SymbolicCell]
) -> Iterator[Candidate]:
    """Yield the guesses that a flag implies an earlier frame, and that a stored time is in the past."""
    for flag in flags:
        if str(flag.old) != str(system.begun):
            yield Candidate(f"{flag.name} implies an earlier frame", z3.Implies(flag.old, system.begun))
    for cell in numbers:
        if cell.old.sort() == system.last.sort():
            yield Candidate(f"{cell.name} <= time of the last frame", cell.old <= system.last)
            for flag in flags:
                if _stem(flag) == _stem(cell):
                    rule = z3.Implies(flag.old, cell.old <= system.last)
                    yield Candidate(f"{flag.name} implies {cell.name} <= time of the last frame", rule)


def _stem(cell: SymbolicCell) -> str:
    """Return the prefix that the cells of one memory function share in their names."""
    return cell.name.rpartition(" ")[0] or cell.name


def _bounds(numbers: list[SymbolicCell], contract_constants: list[Fraction]) -> Iterator[Candidate]:
    """Yield the guesses that a number is bounded by a constant in its formula or in a contract."""
    for cell in numbers:
        values = dict.fromkeys((*numerals([cell.next, cell.initial]), *contract_constants))
        for value in list(values)[:_MAX_BOUNDS]:
            bound = _constant(value, cell.old.sort())
            if bound is not None:
                yield Candidate(f"{cell.name} <= {float(value):g}", cell.old <= bound)
                yield Candidate(f"{cell.name} >= {float(value):g}", cell.old >= bound)
                yield Candidate(f"{cell.name} < {float(value):g}", cell.old < bound)
                yield Candidate(f"{cell.name} > {float(value):g}", cell.old > bound)


def _constant(value: Fraction, sort: z3.SortRef) -> z3.ArithRef | None:
    """Return the constant as a number of a sort; None for a fraction where the sort has only integers."""
    if sort != z3.IntSort():
        return z3.Q(value.numerator, value.denominator)
    return z3.IntVal(value.numerator) if value.denominator == 1 else None


def numeral(value: z3.ExprRef) -> Fraction:
    """Return the number that a term of z3 is."""
    return Fraction(value.as_long()) if z3.is_int_value(value) else value.as_fraction()


def numerals(formulas: list[z3.ExprRef]) -> list[Fraction]:
    """Return the numbers in formulas, each once."""
    found: dict[Fraction, None] = {}
    seen: set[int] = set()
    todo = list(formulas)
    while todo:
        node = todo.pop()
        if node.get_id() in seen:
            continue
        seen.add(node.get_id())
        if z3.is_rational_value(node) or z3.is_int_value(node):
            found[numeral(node)] = None
        todo += node.children()
    return sorted(found, key=abs)


def _literals(system: System, cone: Cone, flags: list[SymbolicCell]) -> list[Candidate]:
    """Return the flags, including bool states, and the phases of machines."""
    literals = [Candidate(f.name, f.old) for f in flags if str(f.old) != str(system.begun)]
    for name, members in _enumerated(system.program):
        value = formulas_of(system.states[name])[0] if name in system.states else None
        if value is not None and within(cone, value):
            literals += [Candidate(f"{name} == {member}", value == number(n)) for member, n in members]
    return literals


def _pairs_of_flags(system: System, cone: Cone, flags: list[SymbolicCell]) -> Iterator[Candidate]:
    """Yield the guesses that a flag or phase implies or excludes another, or that one of the two is true."""
    literals = _literals(system, cone, flags)
    count = 0
    for a, b in combinations(literals, 2):
        if count >= _MAX_PAIRS:
            return
        count += 4
        yield Candidate(f"not ({a.text} and {b.text})", z3.Not(z3.And(a.formula, b.formula)))
        yield Candidate(f"{a.text} or {b.text}", z3.Or(a.formula, b.formula))
        yield Candidate(f"{a.text} implies {b.text}", z3.Implies(a.formula, b.formula))
        yield Candidate(f"{b.text} implies {a.text}", z3.Implies(b.formula, a.formula))


def _pairs_of_numbers(numbers: list[SymbolicCell]) -> Iterator[Candidate]:
    """Yield the guesses that two numbers are equal, or in order."""
    count = 0
    for a, b in permutations(numbers, 2):
        if count >= _MAX_PAIRS:
            return
        if a.old.sort() == b.old.sort():
            count += 1
            yield Candidate(f"{a.name} <= {b.name}", a.old <= b.old)


# --- walk ---------------------------------------------------------------------------------------------
#
# Random walks through a system, to refute guesses without asking the solver about each.

_WALKS = 5
_STEPS = 8
_PRESENT_PROBABILITY = 0.85
_UNBOUNDED_WIDTH = 1000
"""Width of the range from which readings are drawn if the sensor's range is unbounded."""


def not_refuted(cone: Cone, guesses: Sequence[Candidate], budget: Budget) -> list[Candidate]:
    """Return the guesses that hold before every frame of the walks. Deterministic."""
    remaining = list(guesses)
    for walk in range(_WALKS):
        for model in _walk(cone, Random(walk), budget):
            remaining = [
                g for g in remaining if not z3.is_false(model.eval(g.formula, model_completion=True))
            ]
    return remaining


def _walk(cone: Cone, random: Random, budget: Budget) -> Iterator[z3.ModelRef]:
    """Yield a model for each frame of a run with random readings, until the solver finds none quickly."""
    solver = IncrementalSolver(budget, share=0.1)
    solver.add(facts(cone))
    memory = [cell.initial for cell in cone.cells]
    t_ns = 0
    for _ in range(_STEPS):
        solver.push()
        solver.add(*(c.old == value for c, value in zip(cone.cells, memory, strict=True)))
        solver.add(cone.system.now == t_ns, *_readings(cone, random))
        answer = solver.check()
        if answer is SolverAnswer.SAT:
            model = solver.model()
            memory = [model.eval(cell.next, model_completion=True) for cell in cone.cells]
            yield model
        solver.pop()
        if answer is not SolverAnswer.SAT:
            return
        t_ns += _gap(random, cone.system.program.robot)


def _gap(random: Random, robot: Robot) -> int:
    """Draw the time to the next frame, in nanoseconds."""
    shortest, longest = gaps_ns(robot)
    periods = random.choice((1, 1, 1, 4, 40, 400))
    return periods * robot.frame_ns if longest is None else random.choice((shortest, robot.frame_ns, longest))


def _readings(cone: Cone, random: Random) -> Iterator[z3.BoolRef]:
    """Yield the readings of a cone's sensors: mostly present, anywhere in their ranges."""
    for sensor_input in cone.system.sensors.values():
        if within(cone, sensor_input.present):
            yield sensor_input.present == z3.BoolVal(random.random() < _PRESENT_PROBABILITY)
        yield from _elements(cone, sensor_input, random)


def _elements(cone: Cone, sensor_input: SensorInput, random: Random) -> Iterator[z3.BoolRef]:
    """Yield values of a sensor; elements of an array are close together or spread out."""
    base, spread = random.random(), random.choice((0.0, 0.1, 1.0))
    for element in sensor_input.elements:
        if not isinstance(element, ExtendedReal):
            if within(cone, element):
                yield element == z3.BoolVal(random.random() < 0.5)
        elif within(cone, element.value) and z3.is_const(element.value) and not element.cases:
            low, high = element.bounds.low, element.bounds.high
            low = Fraction(-_UNBOUNDED_WIDTH) if low is None else low
            high = low + _UNBOUNDED_WIDTH if high is None else high
            fraction = Fraction(
                min(1.0, max(0.0, base + spread * (random.random() - 0.5)))
            ).limit_denominator(64)
            value = low + fraction * (high - low)
            yield element.value == z3.Q(value.numerator, value.denominator)


# --- houdini ------------------------------------------------------------------------------------------
#
# Invariants by Houdini: the largest inductive subset of a set of guesses (Flanagan and Leino, 2001).
#
# All guesses hold in the initial memory. While a frame can lead from memory in which all hold to memory in
# which some do not, the latter are dropped. The rest hold before every frame. A contract that follows from
# the guesses in every frame may be assumed when the guesses are checked.

_SHARE = 0.25
"""Share of a full query's resources for each query."""

_MAX_ROUNDS = 200


@dataclass(frozen=True, slots=True)
class Invariants:
    """Conditions that hold before every frame, and the contracts that follow from them."""

    conditions: tuple[Candidate, ...]
    claims: tuple[ContractFormula, ...]


def invariants(
    cone: Cone,
    guesses: Sequence[Candidate],
    claims: Sequence[ContractFormula],
    lemmas: Sequence[z3.BoolRef],
    budget: Budget,
) -> Invariants:
    """Return the guesses that are inductive together, and the `claims` that follow from them.

    `lemmas` are known to hold in every frame. If z3 gives up, fewer guesses are kept; those still hold.
    """
    subset = _GreatestSubset(cone, lemmas, budget)
    after = Substitution([c.old for c in cone.cells], [c.next for c in cone.cells])
    for guess in guesses:
        subset.add_guess(guess.formula, after(guess.formula))
    for claim in claims:
        subset.add_claim(claim.holds)
    subset.shrink()
    return Invariants(
        tuple(guesses[i] for i in sorted(subset.guesses_left)),
        tuple(claims[i] for i in sorted(subset.claims_left)),
    )


class _GreatestSubset:
    """The greatest inductive subset: drops guesses and claims until none can be broken. Mutable.

    `guesses_left`, about memory before a frame, and `claims_left`, about the frame, are indices.
    """

    def __init__(self, cone: Cone, lemmas: Sequence[z3.BoolRef], budget: Budget) -> None:
        self._budget = budget
        self._solver = IncrementalSolver(budget, _SHARE)
        self._solver.add(facts(cone), *lemmas)
        self._guesses_after: list[z3.BoolRef] = []
        self._guess_switches: list[z3.BoolRef] = []
        self._claims: list[z3.BoolRef] = []
        self.guesses_left: set[int] = set()
        self.claims_left: set[int] = set()

    def add_guess(self, formula: z3.BoolRef, after: z3.BoolRef) -> None:
        i = len(self._guess_switches)
        switch = z3.Bool(f"guess {i}")
        self._solver.add(z3.Implies(switch, formula))
        self._guess_switches.append(switch)
        self._guesses_after.append(_named(self._solver, f"after {i}", after))
        self.guesses_left.add(i)

    def add_claim(self, formula: z3.BoolRef) -> None:
        i = len(self._claims)
        self._claims.append(_named(self._solver, f"claim {i}", formula))
        self.claims_left.add(i)

    def shrink(self) -> None:
        """Shrink to the greatest fixpoint, or to a smaller inductive set if z3 gives up."""
        for _ in range(_MAX_ROUNDS):
            assumed = [self._guess_switches[i] for i in sorted(self.guesses_left)]
            if self._drop(self.claims_left, self._claims, assumed):
                continue
            assumed += [self._claims[i] for i in sorted(self.claims_left)]
            if not self._drop(self.guesses_left, self._guesses_after, assumed):
                return
        self.guesses_left.clear()
        self.claims_left.clear()

    def _drop(self, kept: set[int], goals: list[z3.BoolRef], assumed: list[z3.BoolRef]) -> bool:
        """Drop from `kept` the goals that a model of `assumed` breaks; return False if none can be broken."""
        if not kept:
            return False
        self._solver.push()
        self._solver.add(z3.Or(*(z3.Not(goals[i]) for i in sorted(kept))))
        answer = self._solver.check(assumed)
        if answer is SolverAnswer.SAT:
            model = self._solver.model()
            broken = {i for i in kept if not z3.is_true(model.eval(goals[i], model_completion=True))}
        self._solver.pop()
        match answer:
            case SolverAnswer.UNSAT:
                return False
            case SolverAnswer.SAT:
                kept -= broken
                return True
            case SolverAnswer.GAVE_UP:
                return self._drop_one_by_one(kept, goals, assumed)
            case _:
                assert_never(answer)

    def _drop_one_by_one(self, kept: set[int], goals: list[z3.BoolRef], assumed: list[z3.BoolRef]) -> bool:
        """Keep the goals that can be proved one by one; return True if any was dropped.

        Used if z3 gives up on all of them together.
        """
        self._solver.use(self._budget, _SHARE / 8)
        proved = {
            i for i in sorted(kept) if self._solver.check([*assumed, z3.Not(goals[i])]) is SolverAnswer.UNSAT
        }
        self._solver.use(self._budget, _SHARE)
        dropped = kept != proved
        kept &= proved
        return dropped


def _named(solver: IncrementalSolver, name: str, formula: z3.BoolRef) -> z3.BoolRef:
    """Return a constant that stands for a formula, so that a model gives its value directly."""
    constant = z3.Bool(name)
    solver.add(constant == formula)
    return constant
