"""Obligations: what tests should have exercised, each with its place in the text.

A **goal** is a condition of one frame. An obligation is covered as soon as all goals of one of its ways were
true in some frame each: most have one way with one goal. A condition of a decision has two, for its two
values, and two ways if the decision can be true by either. Goals read an instrumented program, in which
nodes, commands, bounds and conditions have names. The interpreter, the follower of a
recording and the prover use the same expressions. Only those of contracts have memory if it is written there.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from typing import Literal, NamedTuple

from colony.dsl.check.compatibility import with_new_cells
from colony.ir import expression as ir
from colony.ir.expression import Binary, Expression
from colony.ir.program import (
    Contract,
    Derived,
    Let,
    Limit,
    Machine,
    Module,
    Program,
    PythonModule,
    State,
    Transition,
    assumptions,
)
from colony.ir.types import BOOL, Bool
from colony.ir.walk import WiringNode, all_subexpressions
from colony.text.source import Source, Span
from colony.text.wording import one_line, quoted
from colony.verify.claims import (
    FALSE,
    TRUE,
    active,
    all_of,
    any_of,
    binary,
    constant,
    fresh,
    implies,
    negation,
    source_text,
    value_or,
    won,
)
from colony.verify.contracts.assumptions import held_so_far
from colony.verify.contracts.candidates import HELD
from colony.verify.coverage.decisions import AtomicDecision, decision, is_composed
from colony.verify.lints.case import (
    Case,
    all_bounds,
    case_of,
    command_of,
    condition_of,
    limit_condition_name,
    span_of,
    text_of,
)
from colony.verify.lints.contracts import premise

Kind = Literal["module", "node", "condition", "limit", "machine", "sensor", "contract"]

KINDS: tuple[Kind, ...] = ("module", "node", "condition", "limit", "machine", "sensor", "contract")


class CoverageGoal(NamedTuple):
    """A condition that should be true in some frame; `text` completes "a frame in which"."""

    name: str
    condition: Expression
    text: str


class Obligation(NamedTuple):
    """An obligation of a kind about `subject`: all goals of one of `ways` are to be seen. `text` names it.

    `of` is the declaration that it belongs to: a module, wire, actuator, derived value, sensor or contract.
    """

    kind: Kind
    subject: str
    text: str
    span: Span
    ways: tuple[tuple[CoverageGoal, ...], ...]
    of: str


@dataclass(frozen=True, slots=False, kw_only=True)
class CoveragePlan:
    """The obligations of a program, in the order of the text, and the program that their goals read."""

    program: Program
    instrumented: Program
    case: Case
    obligations: tuple[Obligation, ...]

    @cached_property
    def goals(self) -> dict[str, CoverageGoal]:
        """All goals by name."""
        return {goal.name: goal for o in self.obligations for way in o.ways for goal in way}

    @cached_property
    def _held(self) -> dict[str, tuple[State, Expression]]:
        """By assumption, the state that remembers whether it held, and that it holds up to now."""
        return {a.name: held_so_far(f"{HELD} {a.name}", [a.expression]) for a in assumptions(self.program)}

    @cached_property
    def watching(self) -> Program:
        """The instrumented program with the states that `claim` and `holds` read."""
        states = (state for state, _ in self._held.values())
        return replace(self.instrumented, derived=(*self.instrumented.derived, *states))

    @property
    def assumed(self) -> tuple[str, ...]:
        """The names of the assumptions of the program."""
        return tuple(self._held)

    def holds(self, assuming: Collection[str]) -> Expression:
        """Return the condition that assumptions hold in all frames up to this one."""
        return all_of(self._held[name][1] for name in assuming)

    def claim(self, goal: CoverageGoal, assuming: Collection[str]) -> Expression:
        """Return the claim that a goal is never true while assumptions hold."""
        never = negation(goal.condition)
        return implies(self.holds(assuming), never) if assuming else never


def plan_of(program: Program, *, everywhere: bool = False) -> CoveragePlan:
    """Return the obligations of the main file and, with `everywhere`, of imported files."""
    case = case_of(program)
    planner = _Planner(case, None if everywhere or not program.files else program.files[-1][1])
    instrumented = planner.instrumented()
    found = sorted(planner.obligations(), key=lambda o: (KINDS.index(o.kind), o.span.start))
    return CoveragePlan(program=program, instrumented=instrumented, case=case, obligations=tuple(found))


def _one(
    kind: Kind,
    subject: str,
    text: str,
    span: Span,
    condition: Expression,
    hint: str,
    key: str = "",
    of: str = "",
) -> Obligation:
    """Return an obligation with one goal; `key` sets apart those of the same subject and text.

    It belongs to the declaration `of`, by default to `subject`.
    """
    goal = CoverageGoal(f"{kind} {key or subject} {text}", value_or(condition, FALSE), hint)
    return Obligation(kind, subject, text, span, ((goal,),), of or subject)


class _Decision(NamedTuple):
    """A decision of a declaration, with its name in texts and the condition under which it counts."""

    of: str
    owner: str
    made: AtomicDecision
    counts: Expression


class _Planner:
    """Collects the obligations of a case. Mutable: `instrumented` comes first, and finds the decisions."""

    def __init__(self, case: Case, main: Source | None) -> None:
        self._case, self._main = case, main
        self._decisions: list[_Decision] = []

    def _is_own(self, span: Span) -> bool:
        return self._main is None or span.source is self._main

    def obligations(self) -> Iterator[Obligation]:
        """Yield all obligations."""
        for name, module in self._case.wired_modules.items():
            if self._is_own(module.span):
                yield from self._of_module(name, module)
        for node in self._case.network.nodes.values():
            if self._is_own(span_of(node)):
                yield from self._of_node(node)
        for found in self._decisions:
            yield from _of_decision(found)
        for number, limit in enumerate(self._case.program.limits):
            if self._is_own(limit.span):
                yield from self._of_limit(number, limit)
        for machine in self._case.program.derived:
            if isinstance(machine, Machine) and self._is_own(machine.span):
                yield from _of_machine(machine)
        yield from self._of_sensors()
        calls = (x for x in all_subexpressions(self._case.program) if isinstance(x, ir.MemoryCall))
        cells = count(1 + max((call.cell for call in calls), default=0))
        for contract in self._case.program.contracts:
            if self._is_own(contract.span) and not contract.assumed:
                yield from _of_contract(contract, cells)

    # --- decisions -------------------------------------------------------------------------------

    def instrumented(self) -> Program:
        """Return the program of the case with a name for each condition of a decision of the main file."""
        program = self._case.instrumented
        derived: list[Derived] = []
        machines = {m.name: m for m in self._case.program.derived if isinstance(m, Machine)}
        conditions = {
            condition_of(m, i).name: (m, i) for m in machines.values() for i in range(len(m.transitions))
        }
        limits = {limit_condition_name(i): limit for i, limit in enumerate(self._case.program.limits)}
        unwritten = {f"{m.name}.{name}" for m in machines.values() if m.tasks for name in ("held", "time")}
        unwritten |= {a.name for a in assumptions(self._case.program)}  # of the world, not of the program
        for item in program.derived:
            if isinstance(item, Let) and item.name in conditions:
                machine, i = conditions[item.name]
                is_limit = bool(machine.tasks) and machine.transitions[i].failsafe  # of the time of a task
                if self._is_own(machine.span) and not is_limit:
                    owner = f"{machine.name}: {transition_text(machine, machine.transitions[i])}"
                    counts = _considered(machine, i)
                    item = self._of_let(item, machine.name, owner, derived, counts)
            elif isinstance(item, Let) and item.name in limits:
                limit = limits[item.name]
                if self._is_own(limit.span):
                    item = self._of_let(item, limit.actuator, _limit_text(limit), derived)
            elif isinstance(item, Let) and self._is_own(item.span) and item.name not in unwritten:
                item = self._of_let(item, item.name, item.name, derived)
            derived.append(item)
        modules = tuple(self._of_text(m) if isinstance(m, Module) else m for m in program.modules)
        return replace(program, derived=tuple(derived), modules=modules)

    def _of_let(
        self, let: Let, of: str, owner: str, derived: list[Derived], counts: Expression | None = None
    ) -> Let:
        """Return a let with a name for each condition; a single one has one if it `counts` alone."""
        is_single = counts is not None and isinstance(let.expression.type, Bool)
        if not (is_composed(let.expression) or is_single):
            return let
        made = decision(let.expression, lambda k: f"{let.name} condition {k}", in_module=False)
        derived += (Let(name=name, expression=e) for name, e in made.lets)
        self._decisions.append(_Decision(of, owner, made, TRUE if counts is None else counts))
        return replace(let, expression=made.outcome)

    def _of_text(self, module: Module) -> Module:
        """Return a wired module with a let for each condition of its lets, its command and its predicate."""
        if module.name not in self._case.modules or not self._is_own(module.span):
            return module
        owners = {}
        if module.command is not None:
            actuator = self._case.actuators[module.command.actuator]
            for i, field in enumerate(actuator.fields):
                owners[f"{module.name}. {i}"] = f"{module.name}: {actuator.name}.{field.name}"
        lets: list[Let] = []
        for let in module.lets:
            if is_composed(let.expression):
                made = decision(let.expression, lambda k, x=let.name: f"{x} condition {k}", in_module=True)  # type: ignore[misc]
                owner = owners.get(let.name, let.name)
                self._decisions.append(_Decision(module.name, owner, made, TRUE))
                lets += (Let(name=name, expression=e) for name, e in made.lets)
                let = replace(let, expression=made.outcome)
            lets.append(let)
        made = decision(module.when, lambda k: f"{module.name}. when {k}", in_module=True)
        self._decisions.append(_Decision(module.name, module.name, made, TRUE))
        lets += (Let(name=name, expression=e) for name, e in made.lets)
        return replace(module, lets=tuple(lets), when=made.outcome)

    # --- modules and nodes -----------------------------------------------------------------------

    def _of_module(self, name: str, module: Module | PythonModule) -> Iterator[Obligation]:
        network = self._case.network
        yield _one("module", name, "active", module.span, active(name), f"`{name}` is active")
        driven = [a for a, root in network.roots.items() if network.is_under(name, root)]
        wins = any_of(won(a, name) for a in driven if module.actuator == a)
        if wins is not FALSE:
            yield _one("module", name, "wins", module.span, wins, f"`{name}` wins")
            if any(network.nodes_above(name)):
                beaten = all_of((active(name), negation(wins)))
                hint = f"`{name}` is active, and another module dominates it"
                yield _one("module", name, "dominated", module.span, beaten, hint)
        needed = sorted(self._case.contents.needs(module))
        if module.failsafe and needed:
            blind = all_of((active(name), any_of(negation(fresh(s)) for s in needed)))
            hint = f"`{name}` is blind: {quoted(needed, 'or')} is missing"
            yield _one("module", name, "blind", module.span, blind, hint)

    def _of_node(self, node: WiringNode) -> Iterator[Obligation]:
        dominant, inferior, passes = active(node.dominant), active(node.inferior), active(node.name)
        text = text_of(node)
        of = next(w.actuator or w.name for w in self._case.program.wires if w.name == node.path[0])

        def one(what: str, condition: Expression, hint: str) -> Obligation:
            return _one("node", text, what, span_of(node), condition, hint, node.name, of)

        if node.relation == "suppresses":
            yield one("dominant side", dominant, f"the left side of `{text}` is active")
        else:
            yield one("inhibits", all_of((dominant, inferior)), f"both sides of `{text}` are active")
        through = all_of((passes, negation(dominant)))
        yield one("inferior side", through, f"the right side of `{text}` gets through")
        if node.window_ns:
            held = all_of((inferior, negation(dominant), negation(passes)))
            yield one("time constant", held, f"the time constant of `{text}` holds its right side back")

    # --- limits, sensors -------------------------------------------------------------------------

    def _of_limit(self, number: int, limit: Limit) -> Iterator[Obligation]:
        actuator = self._case.actuators[limit.actuator]
        bounds = all_bounds(self._case.program, actuator, limit.field_index)
        bound = next(b for b in bounds if b.limit is limit)
        operator = Binary.GREATER if bound.is_upper else Binary.LESS
        text = _limit_text(limit)
        root = self._case.network.roots.get(actuator.name)
        names = () if root is None else self._case.network.modules_under(root)
        modules = [self._case.modules[name] for name in names if name in self._case.modules]
        commands = [m for m in modules if m.actuator == actuator.name]  # others inhibit them
        exceeds = any_of(
            all_of(
                (
                    won(actuator.name, m.name),
                    binary(operator, command_of(m, limit.field_index), bound.value),
                )
            )
            for m in commands
        )
        if exceeds is not FALSE:
            sent = ir.IsCommanded(type=BOOL, actuator=actuator.name)
            cuts = all_of((sent, bound.applies, exceeds))
            hint = f"a command goes beyond `{text}`, which applies"
            yield _one("limit", text, "cuts", limit.span, cuts, hint, str(number), actuator.name)
        if limit.condition is not None:
            off = negation(bound.applies)
            hint = f"`{text}` does not apply"
            yield _one("limit", text, "does not apply", limit.span, off, hint, str(number), actuator.name)

    def _of_sensors(self) -> Iterator[Obligation]:
        case = self._case
        needed = frozenset[str]().union(*(case.contents.needs(m) for m in case.wired_modules.values()))
        for e in (e for limit in case.program.limits for e in (limit.bound, limit.condition) if e):
            needed |= case.contents.needed_sensors(e)
        for machine in (m for m in case.program.derived if isinstance(m, Machine)):
            for t in machine.transitions:
                needed |= case.contents.needed_sensors(t.condition)
        for sensor in case.program.robot.sensors:
            if sensor.name in needed and not sensor.tunable and sensor.sent is None:
                span = self._first_reading(sensor.name)
                if span is not None:
                    gone = negation(fresh(sensor.name))
                    hint = f"`{sensor.name}` is missing"
                    yield _one("sensor", sensor.name, "missing", span, gone, hint)

    def _first_reading(self, sensor: str) -> Span | None:
        """Return the first place at which a file that counts reads a sensor, None if none does."""
        program, assumed = self._case.program, {a.name for a in assumptions(self._case.program)}
        derived = tuple(d for d in program.derived if d.name not in assumed)
        places = [
            x.span
            for x in all_subexpressions(replace(program, derived=derived, contracts=()))
            if isinstance(x, ir.SensorValue) and x.name == sensor and self._is_own(x.span)
        ]
        reads = (
            m.span
            for m in self._case.program.modules
            if isinstance(m, PythonModule) and self._is_own(m.span)
            for r in m.reads
            if isinstance(r.expression, ir.SensorValue) and r.expression.name == sensor
        )
        return min(places, key=lambda s: s.start, default=next(reads, None))


def _of_contract(contract: Contract, cells: Iterator[int]) -> Iterator[Obligation]:
    """Yield that the left side of an `implies` is true: in all other frames the contract asks for nothing."""
    left = premise(contract.expression)
    if left is not None:
        text = source_text(left)
        hint = f"`{text}`, the condition of contract `{contract.name}`, is true"
        own = with_new_cells(left, lambda: next(cells))
        yield _one("contract", contract.name, text, left.span, own, hint)


def _limit_text(limit: Limit) -> str:
    return one_line(limit.span.text).removeprefix("limit ")


def _of_decision(found: _Decision) -> Iterator[Obligation]:
    of, owner, made, counts = found
    for number, c in enumerate(made.conditions):
        text = source_text(c.atom)
        ways = []
        for sign in c.signs:
            outcome = made.outcome if sign else negation(made.outcome)
            way = []
            for value in (True, False):
                is_value = c.value if value else negation(c.value)
                decided = outcome if value else negation(outcome)
                more = (counts, c.unmasked, *((decided,) if len(c.signs) > 1 else ()))
                condition = all_of((is_value, *(x for x in more if x is not TRUE)))
                alone = f"`{text}` is {str(value).lower()}"
                if len(made.conditions) > 1:
                    alone += f" and decides `{owner}`"
                name = f"condition {owner} {number} {c.atom.span.start} {sign} {value}"
                way.append(CoverageGoal(name, value_or(condition, FALSE), alone))
            ways.append(tuple(way))
        yield Obligation("condition", owner, text, c.atom.span, tuple(ways), of)


# --- machines ------------------------------------------------------------------------------------------


def _phase(machine: Machine, phase: float) -> Expression:
    """Return the condition that a machine is in a phase."""
    state = ir.StateValue(type=machine.type, name=machine.name)
    return binary(Binary.EQUAL, state, constant(phase, machine.type))


def transition_text(machine: Machine, transition: Transition) -> str:
    """Return `roaming -> resting`; `any` for all phases but the target."""
    names = {number: name for name, number in machine.type.members}
    sources = [names[s] for s in sorted(transition.sources)]
    is_any = len(sources) > 1 and len(sources) == len(names) - (transition.target not in transition.sources)
    return f"{'any' if is_any else ' or '.join(sources)} -> {names[transition.target]}"


def _considered(machine: Machine, i: int) -> Expression:
    """Return the condition that no transition above number `i` keeps it from being taken in this phase."""
    transition = machine.transitions[i]
    above = (
        all_of(
            (
                any_of(_phase(machine, s) for s in sorted(t.sources & transition.sources)),
                value_or(condition_of(machine, j), TRUE if t.failsafe or not transition.failsafe else FALSE),
            )
        )
        for j, t in enumerate(machine.transitions[:i])
        if t.sources & transition.sources
    )
    here = any_of(_phase(machine, s) for s in sorted(transition.sources))
    return all_of((here, *(negation(x) for x in above)))


def _of_machine(machine: Machine) -> Iterator[Obligation]:
    for name, number in machine.type.members:
        entered = _phase(machine, number)
        hint = f"`{machine.name}` is in `{name}`"
        yield _one("machine", machine.name, name, machine.span, entered, hint)
    for i, t in enumerate(machine.transitions):
        text = transition_text(machine, t)
        holds = value_or(condition_of(machine, i), TRUE if t.failsafe else FALSE)
        hint = f"`{machine.name}` takes `{text}`"
        taken = all_of((_considered(machine, i), holds))
        goal = CoverageGoal(f"machine {machine.name} transition {i}", value_or(taken, FALSE), hint)
        yield Obligation("machine", machine.name, text, t.span, ((goal,),), machine.name)
