"""Proof that an emitted form (lowered code, generated Python) does what the proved client list does.

Such a form computes predicates and has no condition "module m is active". So its formulas range over the
conditions that it does compute (comparisons, sensors, memory), each of them opaque. The formulas for the
activity of modules come from the same form of the same program with an additional contract for each module,
`MODULE is active`. With these activities, the client list must have the same winners as the form.

In such forms a time constant is a memory cell: the time until which something dominates, which is set in
every frame in which it is active. Comparing the frame's time with that end gives the history of the condition
under which it is set.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from colony.compile.guards import ClientList
from colony.ir.program import Contract, Program
from colony.verify.claims import active
from colony.verify.equivalence.circuit import FALSE, Circuit
from colony.verify.equivalence.disagreement import Values, decide_clauses, evaluate
from colony.verify.equivalence.formula_index import FormulaIndex
from colony.verify.equivalence.results import (
    Activation,
    Counterexample,
    EquivalenceProved,
    EquivalenceUndecided,
    Recent,
    WrongWinner,
    merge_results,
)
from colony.verify.equivalence.solver import NEAR_LIMITS, CircuitSolver, Clause, differ
from colony.verify.equivalence.table import ClientFormulas, encode_list

_ACTIVE = "active: "

MAX_ACTIVITY_NODES = 50
"""Maximum number of nodes of a module's activity in which to search for inputs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Timer:
    """A memory cell with a history, which is true less than `window_ns` after a frame with `operand`."""

    cell: str
    operand: int
    window_ns: int
    history: int


@dataclass(frozen=True, slots=True, kw_only=True)
class WinnerFormulas:
    """The formulas by which a module wins: by priority and, if the form has exclusive guards, by its own."""

    module: str
    by_priority: int
    by_exclusive: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """The behavior of an emitted form, over one circuit; `activity` has each module's formula."""

    name: str
    circuit: Circuit
    winners: Mapping[str, tuple[WinnerFormulas, ...]]
    timers: tuple[Timer, ...]
    activity: Mapping[str, int]


TimerClasses = Mapping[str, str | None]
"""The cell whose timer is provably the same, by cell; None for a cell whose timer never runs."""


def with_activities(program: Program) -> Program:
    """Return the program with a contract added for each module, which holds while the module is active."""
    activity_contracts = tuple(
        Contract(name=f"{_ACTIVE}{module.name}", expression=active(module.name)) for module in program.modules
    )
    return replace(program, contracts=(*program.contracts, *activity_contracts))


def module_of(contract: str) -> str | None:
    """Return the module whose activity a contract of `with_activities` states."""
    return contract.removeprefix(_ACTIVE) if contract.startswith(_ACTIVE) else None


def prove_form(
    read_form: Callable[[TimerClasses], Form], clients: ClientList, seconds: float
) -> EquivalenceProved | Counterexample | EquivalenceUndecided:
    """Prove that the form has the winners of the client list.

    Usually the form has the same formulas as the list; equal ones are searched for only where they differ.
    """
    modules = [client.module for actuator in clients.actuators for client in actuator.clients]
    merged_form = _with_merged_timers(read_form, modules, seconds)
    claims = _claims(merged_form, clients, near_limits=())
    if any(claim.found != claim.expected for claim in claims):
        claims = _claims(merged_form, clients, near_limits=NEAR_LIMITS[:2])
    solver = merged_form.solver
    wrong = [c for c in claims if c.found != c.expected and not solver.refutes(differ(c.found, c.expected))]
    undecided = []
    for actuator in dict.fromkeys(claim.actuator for claim in wrong):
        answer = _find_counterexample(
            merged_form, clients, actuator, [c for c in wrong if c.actuator == actuator]
        )
        if isinstance(answer, EquivalenceUndecided) and not solver.uses_z3:
            undecided.append(answer)
        elif answer is not None:
            return answer
    structure = sum(claim.found == claim.expected and not claim.solved for claim in claims)
    proved = EquivalenceProved(
        forms=(merged_form.form.name,),
        by_structure=structure,
        by_solver=len(claims) - structure,
        questions=solver.question_count,
    )
    return merge_results([proved, *undecided])


@dataclass(frozen=True, slots=True)
class _MergedForm:
    """A form with one history for all timers of provably the same condition and window."""

    form: Form
    solver: CircuitSolver
    order: Sequence[int]

    def index(self, near_limits: Sequence[int]) -> FormulaIndex:
        rare = [timer.history for timer in self.form.timers]
        index = FormulaIndex(self.form.circuit, self.solver, self.order, rare, near_limits)
        for timer in self.form.timers:
            index.remember(timer.operand, timer.window_ns, timer.history)
        return index


def _with_merged_timers(
    read_form: Callable[[TimerClasses], Form], modules: Sequence[str], seconds: float
) -> _MergedForm:
    """Read the form again and again, until no more timers are found to be equal."""
    timer_classes: dict[str, str | None] = {}
    while True:
        form = read_form(timer_classes)
        merged_form = _MergedForm(
            form, CircuitSolver(form.circuit, seconds), _activity_conditions(form, modules)
        )
        index = merged_form.index(near_limits=())
        found: dict[str, str | None] = {}
        for window_ns in dict.fromkeys(timer.window_ns for timer in form.timers):
            timers = [timer for timer in form.timers if timer.window_ns == window_ns]
            first = index.first_equal([timer.operand for timer in timers])
            found |= {
                t.cell: None if i is None else timers[i].cell for t, i in zip(timers, first, strict=True)
            }
        if found == timer_classes or all(cell == same for cell, same in found.items()):
            return merged_form
        timer_classes = found


def _activity_conditions(form: Form, modules: Sequence[str]) -> list[int]:
    """Return the conditions under which modules are active, in the order of the modules."""
    circuit = form.circuit
    histories = {timer.history >> 1 for timer in form.timers}
    found: dict[int, int] = {}
    for module in modules:
        active = form.activity.get(module, FALSE)
        work, seen = [active], 0
        while work and seen < MAX_ACTIVITY_NODES:
            literal, seen = work.pop(), seen + 1
            node = literal >> 1
            if not node or node in found or node in histories:
                continue
            if circuit.is_input(node):
                found[node] = literal if literal == active else 2 * node
            else:
                work += (circuit.left[node], circuit.right[node])
    return list(found.values())


@dataclass(frozen=True, slots=True)
class _Claim:
    """Two formulas that must be equal; `solved` is true if z3 had to match parts of the expected one."""

    actuator: str
    expected: int
    found: int
    solved: bool


def _claims(merged_form: _MergedForm, clients: ClientList, near_limits: Sequence[int]) -> list[_Claim]:
    """Return the formulas by which each module wins in the list, and in the form."""
    index, form = merged_form.index(near_limits), merged_form.form
    listed_clients = dict(encode_list(clients, form.circuit, index, form.activity).actuators)
    return [
        claim
        for actuator in dict.fromkeys((*form.winners, *listed_clients))
        for claim in _of_actuator(
            index, actuator, listed_clients.get(actuator, ()), form.winners.get(actuator, ())
        )
    ]


def _of_actuator(
    index: FormulaIndex, actuator: str, clients: Sequence[ClientFormulas], winners: Sequence[WinnerFormulas]
) -> Iterator[_Claim]:
    """Yield the claims of one actuator, from the highest client down.

    "No guard above holds" is matched with the form's own formula for it after each client, which keeps every
    step small.
    """
    circuit = index.circuit
    by_module = {winner.module: winner for winner in winners}
    for module in by_module.keys() - {client.module for client in clients}:
        yield _Claim(actuator, FALSE, by_module[module].by_priority, solved=False)
    above, merged = FALSE, index.merged
    for client in clients:
        winner = by_module.get(client.module, WinnerFormulas(module=client.module, by_priority=FALSE))
        solved = client.solved or index.merged > merged
        yield _Claim(actuator, circuit.both(client.guard, above ^ 1), winner.by_priority, solved)
        if winner.by_exclusive is not None:
            yield _Claim(actuator, client.exclusive, winner.by_exclusive, client.solved)
        above = index.find(circuit.either(above, client.guard))


def _find_counterexample(
    merged_form: _MergedForm, clients: ClientList, actuator: str, wrong: Sequence[_Claim]
) -> Counterexample | EquivalenceUndecided | None:
    """Return a frame in which one of the claims on an actuator is false, if there is one."""
    form, solver = merged_form.form, merged_form.solver
    circuit = form.circuit
    clauses: list[Clause] = [tuple(circuit.same(c.expected, c.found) ^ 1 for c in wrong)]

    def describe(inputs: frozenset[int]) -> WrongWinner:
        listed_clients = dict(encode_list(clients, circuit, merged_form.index(()), form.activity).actuators)
        return _wrong_winner(form, actuator, listed_clients.get(actuator, ()), inputs)

    undecided = EquivalenceUndecided(subjects=((form.name, actuator),), seconds=solver.seconds)
    return decide_clauses(solver, clauses, undecided, describe)


def _wrong_winner(
    form: Form, actuator: str, clients: Sequence[ClientFormulas], inputs: frozenset[int]
) -> WrongWinner:
    values = evaluate(form.circuit, inputs)
    winners = form.winners.get(actuator, ())
    exclusive = [w.module for w in winners if w.by_exclusive is not None and values(w.by_exclusive)]
    return WrongWinner(
        form=form.name,
        actuator=actuator,
        frame=_frame(form, values),
        network=next((c.module for c in clients if values(c.guard)), None),
        by_priority=next((w.module for w in winners if values(w.by_priority)), None),
        by_exclusive=tuple(exclusive) if any(w.by_exclusive is not None for w in winners) else None,
    )


def _frame(form: Form, values: Values) -> Activation:
    """Return the active modules, and those active recently enough to dominate still."""
    by_activity = {active: module for module, active in form.activity.items()}
    running = {timer.history: timer for timer in form.timers if values(timer.history)}
    return Activation(
        active=tuple(module for module, active in form.activity.items() if values(active)),
        recent=tuple(
            Recent(
                name=by_activity.get(timer.operand, f"what sets `{timer.cell}`"),
                min_age_ns=0,
                max_age_ns=timer.window_ns,
            )
            for timer in running.values()
        ),
    )
