"""The proof that a compiled program does what its network says.

For arbitrary predicates and transfer functions, and any history: in every frame, for every actuator, the
module that the network (`network.py`) lets through is the first client whose guard holds, and the only one
whose exclusive guard holds; so no two exclusive guards hold. Priorities are n, ..., 2, 1. The activities of
wires and modules that contracts read are those of the network. Each form emitted from the clients has the
same winners.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import TypeGuard

from colony.collector import gc_paused
from colony.compile.backends.c.generate import CText
from colony.compile.guards import ClientList
from colony.compile.pipeline import Compilation
from colony.execute.compiled import Compiled
from colony.ir.program import Program
from colony.verify.equivalence.circuit import FALSE, Activity, Circuit
from colony.verify.equivalence.disagreement import (
    Values,
    decide_clauses,
    evaluate,
    frame_of,
    nested_histories,
)
from colony.verify.equivalence.forms import prove_form
from colony.verify.equivalence.formula_index import FormulaIndex
from colony.verify.equivalence.json_text import EmittedFormError, read_json
from colony.verify.equivalence.lowered import read_lowered, views
from colony.verify.equivalence.network import NEVER, InnerNode, NetworkFormulas, Root, encode_network
from colony.verify.equivalence.priorities import PriorityInduction, first_by_structure, gates_of
from colony.verify.equivalence.python_text import PYTHON, read_python
from colony.verify.equivalence.results import (
    Counterexample,
    EquivalenceProved,
    EquivalenceUndecided,
    Result,
    WrongActivity,
    WrongForm,
    WrongWinner,
    merge_results,
)
from colony.verify.equivalence.solver import CircuitSolver, Clause, differ
from colony.verify.equivalence.table import ClientFormulas, encode_list

SECONDS = 60.0
"""Limit of z3 for one question, in seconds counted in its steps."""

CLIENTS = "clients"
JSON = "JSON"


def prove(
    program: Program,
    compilation: Compilation,
    *,
    json: str | None = None,
    sent: Callable[[], Compiled] | None = None,
    python: str | None = None,
    c: CText | None = None,
    seconds: float = SECONDS,
) -> Result:
    """Prove that the compiled clients decide as the program's network, or find a frame in which they do not.

    The same is proved for the forms emitted from them: `json`, `python` and `c` are emitted texts, and `sent`
    gives the program that is executed, saved and sent. `seconds` limits z3 for each question; with 0, z3
    is not used.
    """
    clients = compilation.clients
    proofs: list[Callable[[], Result]] = [lambda: prove_clients(program, clients, seconds=seconds)]
    if json is not None:
        proofs.append(lambda: _prove_json(clients, json))
    if sent is not None:
        proofs.append(lambda: _prove_sent(program, clients, sent(), seconds))
    if python is not None:
        proofs.append(lambda: prove_python(program, clients, python, seconds=seconds))
    if c is not None:
        proofs.append(lambda: prove_c(program, clients, c, seconds=seconds))
    return _all_of(proofs)


def _all_of(proofs: Iterable[Callable[[], Result]]) -> Result:
    """Run proofs; return the combined result, or the first counterexample or question that z3 gave up on."""
    results: list[EquivalenceProved | EquivalenceUndecided] = []
    for proof in proofs:
        result = proof()
        if not isinstance(result, EquivalenceProved) and not _is_unattempted(result):
            return result
        results.append(result)
    return merge_results(results)


def _is_unattempted(result: Result | None) -> TypeGuard[EquivalenceUndecided]:
    """Return True if an obligation is open because z3 is not used; the proof then continues."""
    return isinstance(result, EquivalenceUndecided) and result.seconds <= 0


def prove_json(program: Program, json: str, *, form: str = JSON, seconds: float = SECONDS) -> Result:
    """Prove that a text in the format `colony-clients/1`, of any origin, decides as the program's network."""
    try:
        clients = read_json(json)
    except EmittedFormError as problem:
        return WrongForm(form=form, subject="text", found=problem.found, expected=problem.expected)
    return prove_clients(program, clients, form=form, seconds=seconds)


def _prove_sent(program: Program, clients: ClientList, sent: Compiled, seconds: float) -> Result:
    """Prove that the sent form has the winners of the clients, in any executor."""
    readers = [partial(read_lowered, program, clients, code) for code in views(sent)]
    return _all_of(partial(prove_form, reader, clients, seconds) for reader in readers)


def _prove_json(clients: ClientList, json: str) -> Result:
    """Prove that a text is the client list: one obligation for each client and each named activity."""
    try:
        parsed = read_json(json)
    except EmittedFormError as problem:
        return WrongForm(form=JSON, subject="text", found=problem.found, expected=problem.expected)
    if parsed.guards != clients.guards or parsed.observed != clients.observed:
        return WrongForm(form=JSON, subject="nodes", found="other guards", expected="those of the clients")
    if parsed.actuators != clients.actuators:
        return WrongForm(form=JSON, subject="actuators", found="other clients", expected="those compiled")
    obligations = len(parsed.observed) + sum(len(entry.clients) for entry in parsed.actuators)
    return EquivalenceProved(forms=(JSON,), by_structure=obligations, by_solver=0, questions=0)


def prove_python(
    program: Program,
    clients: ClientList,
    python: str,
    *,
    form: str = PYTHON,
    seconds: float = SECONDS,
) -> Result:
    """Prove that generated Python has the winners of the clients, which are those of the program."""
    try:
        with gc_paused():
            found = prove_form(partial(read_python, program, clients, python, form), clients, seconds)
    except EmittedFormError as problem:
        return WrongForm(form=form, subject="text", found=problem.found, expected=problem.expected)
    return found


def prove_c(
    program: Program,
    clients: ClientList,
    text: CText,
    *,
    form: str = "generated C",
    seconds: float = SECONDS,
) -> Result:
    """Prove that generated C has the winners of the clients, which are those of the program."""
    from colony.verify.equivalence.c_text import CReader  # needs an extra

    try:
        with gc_paused():
            return prove_form(CReader(program, clients, text, form).form, clients, seconds)
    except EmittedFormError as problem:
        return WrongForm(form=form, subject="text", found=problem.found, expected=problem.expected)


def prove_clients(
    program: Program, clients: ClientList, *, form: str = CLIENTS, seconds: float = SECONDS
) -> Result:
    """Prove that a list of clients decides as the program's network; `form` is its name in the result."""
    with gc_paused():
        malformed = _malformed(clients, form)
        return malformed or _Proof(program, clients, form, seconds).result()


def _malformed(clients: ClientList, form: str) -> WrongForm | None:
    """Return a defect of the list: priorities other than n, ..., 1, or a repeated entry."""
    for entry in clients.actuators:
        expected = tuple(range(len(entry.clients), 0, -1))
        found = tuple(client.priority for client in entry.clients)
        if found != expected:
            return WrongForm(
                form=form,
                subject=entry.actuator,
                found=f"the priorities {_listed(found)}",
                expected=_listed(expected),
            )
    duplicate = _duplicate([entry.actuator for entry in clients.actuators])
    if duplicate is not None:
        return WrongForm(form=form, subject=duplicate, found="the actuator twice", expected="it once")
    for entry in clients.actuators:
        duplicate = _duplicate([client.module for client in entry.clients])
        if duplicate is not None:
            found_duplicate = f"the client {duplicate} twice"
            return WrongForm(form=form, subject=entry.actuator, found=found_duplicate, expected="it once")
    return None


def _duplicate(names: Sequence[str]) -> str | None:
    return next((name for name, times in Counter(names).items() if times > 1), None)


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))


@dataclass(slots=True)
class _Count:
    """The number of obligations proved so far. Mutable."""

    structure: int = 0
    solver: int = 0

    def add(self, by_structure: bool) -> None:
        if by_structure:
            self.structure += 1
        else:
            self.solver += 1


def _network(program: Program, order: Sequence[str], seconds: float) -> tuple[Circuit, NetworkFormulas]:
    """Return the network, with one history for all time constants with provably equal dominant inputs.

    Sharing a history makes other formulas equal, so this is repeated until nothing changes.
    """
    history_owners: dict[int, int] = {}
    while True:
        circuit = Circuit()
        source = encode_network(program, circuit, history_owners)
        inner_nodes = [
            node_index
            for node_index, node in enumerate(source.nodes)
            if isinstance(node, InnerNode) and node.window_ns > 0
        ]
        if not inner_nodes:
            return circuit, source
        index = FormulaIndex(circuit, CircuitSolver(circuit, seconds), _active(circuit, order))
        first = index.first_equal([source.dominant(node_index) for node_index in inner_nodes])
        found = {
            node_index: NEVER if i is None else inner_nodes[i]
            for node_index, i in zip(inner_nodes, first, strict=True)
        }
        if found == history_owners or all(node_index == same for node_index, same in found.items()):
            return circuit, source
        history_owners = found


def _active(circuit: Circuit, modules: Sequence[str]) -> list[int]:
    known = (circuit.inputs.get(Activity(module)) for module in modules)
    return [literal for literal in known if literal is not None]


class _Proof:
    """The proof for one program and one list of clients. Stateful: its circuit grows."""

    def __init__(self, program: Program, clients: ClientList, form: str, seconds: float) -> None:
        self.form = form
        order = [client.module for entry in clients.actuators for client in entry.clients]
        self.circuit, self.source = _network(program, order, seconds)
        self.gates = {
            actuator: gates_of(self.source, root, self.circuit)
            for actuator, root in self.source.roots.items()
        }
        self.solver = CircuitSolver(self.circuit, seconds)
        index = FormulaIndex(self.circuit, self.solver, _active(self.circuit, order))
        self.formulas = encode_list(clients, self.circuit, index)
        self.count = _Count()

    def result(self) -> Result:
        listed = dict(self.formulas.actuators)
        actuators = dict.fromkeys((*self.source.roots, *listed))
        undecided = []
        for found in chain(
            (self._actuator(actuator, listed.get(actuator, ())) for actuator in actuators),
            (self._check_activity(name, literal) for name, literal in self.formulas.observed),
        ):
            if _is_unattempted(found):
                undecided.append(found)
            elif found is not None:
                return found
        proved = EquivalenceProved(
            forms=(self.form,),
            by_structure=self.count.structure,
            by_solver=self.count.solver,
            questions=self.solver.question_count,
        )
        return merge_results([proved, *undecided])

    # --- actuators -------------------------------------------------------------------------------

    def _actuator(
        self, actuator: str, clients: tuple[ClientFormulas, ...]
    ) -> Counterexample | EquivalenceUndecided | None:
        root = self.source.roots.get(actuator)
        wins = root.wins if root is not None else {}
        check = _ActuatorCheck(self, actuator, clients, wins)
        listed = {client.module for client in clients}
        wrong = [win for module, win in wins.items() if module not in listed]
        for client in clients:
            win = wins.get(client.module, FALSE)
            self.count.add(client.exclusive == win and not client.solved)
            if client.exclusive != win and not self.solver.refutes(differ(client.exclusive, win)):
                wrong.append(self.circuit.same(client.exclusive, win) ^ 1)
        found = check.find_counterexample(wrong)
        if found is not None:
            return found
        same = tuple(_settled(client, wins.get(client.module, FALSE)) for client in clients)
        return self._order(actuator, root, check, same)

    def _order(
        self, actuator: str, root: Root | None, check: _ActuatorCheck, clients: tuple[ClientFormulas, ...]
    ) -> Counterexample | EquivalenceUndecided | None:
        """Check that the first guard that holds wins; exclusive guards are known to be the network's."""
        structure = first_by_structure(clients, check.wins, self.circuit)
        for client in clients:
            self.count.add(structure and not client.solved)
        if structure:
            return None
        if root is not None:
            steps = PriorityInduction(self.source, root, self.gates[actuator], clients, self.solver)
            if steps.is_proved():
                return None
        return check.find_counterexample(list(check.disorder(clients)))

    # --- activities that contracts and tests read -------------------------------------------------

    def _check_activity(self, name: str, literal: int) -> Counterexample | EquivalenceUndecided | None:
        if name not in self.source.names:
            expected = "a wire or module of the program"
            return WrongForm(form=self.form, subject="observed", found=f"`{name}`", expected=expected)
        active = self.source.activity(name)
        self.count.add(active == literal)
        clauses = [*differ(active, literal), *nested_histories(self.circuit)]
        if active == literal or self.solver.refutes(clauses[:2]):
            return None

        def describe(inputs: frozenset[int]) -> WrongActivity:
            network = evaluate(self.circuit, inputs)(active)
            frame = frame_of(self.circuit, inputs, self.source)
            return WrongActivity(form=self.form, name=name, frame=frame, network=network, found=not network)

        return decide_clauses(self.solver, clauses, self.undecided(name), describe)

    def undecided(self, subject: str) -> EquivalenceUndecided:
        """Return the result for when z3 gives up."""
        return EquivalenceUndecided(subjects=((self.form, subject),), seconds=self.solver.seconds)


def _settled(client: ClientFormulas, win: int) -> ClientFormulas:
    """Return the client with its exclusive guard replaced by the formula that it was proved equal to."""
    guard = win if client.guard == client.exclusive else client.guard
    solved = client.solved or client.exclusive != win
    return replace(client, guard=guard, exclusive=win, solved=solved)


@dataclass(frozen=True, slots=True)
class _ActuatorCheck:
    """The comparison of the winners of one actuator in the network and among the clients."""

    proof: _Proof
    actuator: str
    clients: tuple[ClientFormulas, ...]
    wins: Mapping[str, int]

    def find_counterexample(self, wrong: list[int]) -> Counterexample | EquivalenceUndecided | None:
        """Return a frame in which one of these literals is true, if there is one."""
        proof = self.proof
        wrong = [literal for literal in wrong if literal != FALSE]
        if not wrong:
            return None
        clauses: list[Clause] = [tuple(wrong)]
        if proof.solver.refutes(clauses):
            return None
        clauses += nested_histories(proof.circuit)
        return decide_clauses(proof.solver, clauses, proof.undecided(self.actuator), self._wrong_winner)

    def disorder(self, clients: tuple[ClientFormulas, ...]) -> list[int]:
        """Return a formula per client: it is the first whose guard holds and does not win, or vice versa."""
        circuit, above, wrong = self.proof.circuit, FALSE, []
        for client in clients:
            first = circuit.both(client.guard, above ^ 1)
            wrong.append(circuit.same(first, self.wins.get(client.module, FALSE)) ^ 1)
            above = circuit.either(above, client.guard)
        return wrong

    def _wrong_winner(self, inputs: frozenset[int]) -> WrongWinner:
        values: Values = evaluate(self.proof.circuit, inputs)
        return WrongWinner(
            form=self.proof.form,
            actuator=self.actuator,
            frame=frame_of(self.proof.circuit, inputs, self.proof.source),
            network=next((module for module, win in self.wins.items() if values(win)), None),
            by_priority=next((c.module for c in self.clients if values(c.guard)), None),
            by_exclusive=tuple(c.module for c in self.clients if values(c.exclusive)),
        )
