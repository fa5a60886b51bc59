"""Known ways for a compiler to go wrong, each as a change to what one of its stages gives.

A `Bug` is planted with monkeypatch: it wraps a pass of the pipeline, the lowering to code, or a function that
executors call. Nothing here depends on how a stage is written, only on what it gives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import pytest

from colony.compile import executor, executor_decisions, executor_machine, pipeline, python_step
from colony.compile.clients import ActuatorClients, Client, ClientList
from colony.compile.code import Apply, Code, Kind, Literal, Op, SensorFresh
from colony.compile.guards import Always, And, Guard, ModuleActive, Not, Or, Recently
from colony.compile.network import Inhibitor, ModuleLeaf, Network, NetworkNode, Suppressor
from colony.compile.operators import FUNCTIONS, Operator
from colony.compile.suppression import GatedSuppressor, Link, SuppressionNetwork
from colony.ir.program import Chain, Program, Wiring
from colony.verify import agreement

Plant = Callable[[pytest.MonkeyPatch], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bug:
    """A mistake; `plant` makes it. It shows in networks alone if `network`, else in whole programs."""

    name: str
    plant: Plant
    network: bool = False


def after(stage: str, change: Callable[[Any], Any]) -> Plant:
    """`change` what a pass of the pipeline gives."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = getattr(pipeline, stage)
        monkeypatch.setattr(pipeline, stage, lambda given: change(original(given)))

    return plant


def before(stage: str, change: Callable[[Any], Any]) -> Plant:
    """`change` what a pass of the pipeline is given."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = getattr(pipeline, stage)
        monkeypatch.setattr(pipeline, stage, lambda given: original(change(given)))

    return plant


# --- wiring --------------------------------------------------------------------------------------


def rewired(change: Callable[[Chain], Wiring]) -> Plant:
    """`change` every chain of the program before it is elaborated."""

    def over(wiring: Wiring) -> Wiring:
        if not isinstance(wiring, Chain):
            return wiring
        return change(replace(wiring, operands=tuple(over(o) for o in wiring.operands)))

    def program(given: Program) -> Program:
        return replace(given, wires=tuple(replace(w, wiring=over(w.wiring)) for w in given.wires))

    return before("elaborate", program)


def left_associated(chain: Chain) -> Wiring:
    first, *rest = chain.operands
    for operand, window_ns in zip(rest, chain.windows_ns, strict=True):
        first = replace(chain, operands=(first, operand), windows_ns=(window_ns,))
    return first


def nodes(change: Callable[[Any], NetworkNode]) -> Plant:
    """`change` every suppressor and inhibitor of the network."""

    def network(given: Network) -> Network:
        return replace(given, nodes=tuple(n if isinstance(n, ModuleLeaf) else change(n) for n in given.nodes))

    return after("elaborate", network)


def swapped(node: Any) -> Any:
    return replace(node, dominant=node.inferior, inferior=node.dominant)


def window(change: Callable[[int], int], of: type = object) -> Plant:
    """`change` the time constants of nodes of one kind."""
    return nodes(
        lambda n: replace(n, window_ns=change(n.window_ns)) if n.window_ns and isinstance(n, of) else n
    )


def suppressing(node: Any) -> Any:
    return Suppressor(dominant=node.dominant, inferior=node.inferior, window_ns=node.window_ns)


def inhibiting_for_long(node: Any) -> Any:
    """A suppressor with a time constant that forgets to let its dominant side through."""
    if isinstance(node, Suppressor) and node.window_ns:
        return Inhibitor(dominant=node.dominant, inferior=node.inferior, window_ns=node.window_ns)
    return node


# --- inhibition elimination ----------------------------------------------------------------------


def links(change: Callable[[GatedSuppressor, SuppressionNetwork], GatedSuppressor]) -> Plant:
    """`change` every suppressor of the suppression network."""

    def network(given: SuppressionNetwork) -> SuppressionNetwork:
        given = replace(given, guards=(*given.guards, Always()))
        return replace(
            given,
            nodes=tuple(change(n, given) if isinstance(n, GatedSuppressor) else n for n in given.nodes),
        )

    return after("eliminate_inhibition", network)


def ungated(node: GatedSuppressor, network: SuppressionNetwork) -> GatedSuppressor:
    always = len(network.guards) - 1
    return replace(
        node, dominant=replace(node.dominant, gate=always), inferior=replace(node.inferior, gate=always)
    )


def gates_swapped(node: GatedSuppressor, network: SuppressionNetwork) -> GatedSuppressor:
    dominant, inferior = node.dominant, node.inferior
    return replace(
        node,
        dominant=replace(dominant, gate=inferior.gate),
        inferior=replace(inferior, gate=dominant.gate),
    )


def dominant_though_inhibited(node: GatedSuppressor, network: SuppressionNetwork) -> GatedSuppressor:
    """The inferior side yields to a module that is active but does not get through."""
    below = network.nodes[node.dominant.node]
    if not isinstance(below, ModuleLeaf):
        return node
    own = [i for i, g in enumerate(network.guards) if g == ModuleActive(below.module)]
    return replace(node, dominant=replace(node.dominant, active=own[0]))


def observed_shifted(given: SuppressionNetwork) -> SuppressionNetwork:
    names = [name for name, _ in given.observed]
    guards = [guard for _, guard in given.observed]
    return replace(given, observed=tuple(zip(names, guards[1:] + guards[:1], strict=True)))


# --- forward traversal ---------------------------------------------------------------------------


def numbered_at_first_visit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shared module gets the number of its first visit, its lowest place, not of its last."""
    original = pipeline.forward_traversal

    def traverse(given: SuppressionNetwork) -> ClientList:
        roots = dict(given.outputs)
        return in_order(original(given), lambda actuator: first_visits(given, roots[actuator]))

    monkeypatch.setattr(pipeline, "forward_traversal", traverse)


def first_visits(given: SuppressionNetwork, root: Link) -> list[str]:
    """Modules in the order of a forward traversal, each at its first visit."""
    visited: dict[str, None] = {}
    stack = [root.node]
    while stack:
        node = given.nodes[stack.pop()]
        if isinstance(node, ModuleLeaf):
            visited[node.module] = None
        else:
            stack += (node.dominant.node, node.inferior.node)
    return list(visited)


def in_order(clients: ClientList, visits: Callable[[str], list[str]]) -> ClientList:
    """The same clients, numbered by another order of visit."""
    actuators = []
    for actuator in clients.actuators:
        order = visits(actuator.actuator)
        by_priority = sorted(actuator.clients, key=lambda c: -order.index(c.module))
        actuators.append(replace(actuator, clients=renumbered(by_priority)))
    return replace(clients, actuators=tuple(actuators))


def renumbered(clients: Sequence[Client]) -> tuple[Client, ...]:
    return tuple(replace(c, priority=p) for p, c in zip(range(len(clients), 0, -1), clients, strict=True))


def lists(change: Callable[[ActuatorClients], ActuatorClients]) -> Plant:
    """`change` the clients of every actuator."""
    return after("simplify", lambda given: replace(given, actuators=tuple(map(change, given.actuators))))


def reversed_priorities(actuator: ActuatorClients) -> ActuatorClients:
    return replace(actuator, clients=renumbered(actuator.clients[::-1]))


def lowest_lost(actuator: ActuatorClients) -> ActuatorClients:
    return replace(actuator, clients=actuator.clients[:-1])


def not_exclusive(actuator: ActuatorClients) -> ActuatorClients:
    return replace(actuator, clients=tuple(replace(c, exclusive=c.guard) for c in actuator.clients))


def one_use_forgotten(given: ClientList) -> ClientList:
    """A client with several uses gets through by the first of them only."""
    guards = list(given.guards)
    for root in {ref for a in given.actuators for c in a.clients for ref in (c.guard, c.exclusive)}:
        top = guards[root]
        for part in top.operands if isinstance(top, And) else ():
            uses = guards[part]
            if isinstance(uses, Or):
                guards[part] = And((uses.operands[0], uses.operands[0]))
    return replace(given, guards=tuple(guards))


def table(change: Callable[[Guard], Guard], stage: str = "simplify") -> Plant:
    """`change` every guard of the table."""
    return after(stage, lambda given: replace(given, guards=tuple(map(change, given.guards))))


def last_part_dropped(guard: Guard, of: type[And] | type[Or]) -> Guard:
    if isinstance(guard, of) and len(guard.operands) > 1:
        return of(guard.operands[:-1])
    return guard


# --- code ----------------------------------------------------------------------------------------


def code(change: Callable[[Code], Code]) -> Plant:
    """`change` the code that clients execute."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = executor.lower
        monkeypatch.setattr(executor, "lower", lambda *args, **kw: change(original(*args, **kw)))

    return plant


def added(given: Code, op: Op, kind: Kind) -> tuple[Code, int]:
    """The code with one more op, and its number."""
    return replace(given, ops=(*given.ops, op), kinds=(*given.kinds, kind)), len(given.ops)


def moved_while_missing(given: Code) -> Code:
    """Memory moves on in every frame, from placeholders too."""
    given, always = added(given, Literal(True), Kind.BOOL)
    cells = tuple(replace(c, condition=always) if c.kind is not Kind.TIME else c for c in given.cells)
    return replace(given, cells=cells)


def short_circuited(given: Code) -> Code:
    """Serving stops at the first active client, so memory below it stays: here, of all when one is active."""
    cells = list(given.cells)
    for actuator in given.actuators:
        for client in actuator.clients[:1]:
            given, idle = added(given, Apply(Operator.NOT, (client.guard,)), Kind.BOOL)
            for i, cell in enumerate(cells):
                given, both = added(given, Apply(Operator.AND, (cell.condition, idle)), Kind.BOOL)
                cells[i] = replace(cell, condition=both)
    return replace(given, cells=tuple(cells))


def frozen_where_not_winning(given: Code) -> Code:
    """Memory moves on only in frames in which some client wins."""
    guards = tuple(c.guard for a in given.actuators for c in a.clients)
    if not guards:
        return given
    given, winning = added(given, Apply(Operator.OR, guards), Kind.BOOL)
    cells = []
    for cell in given.cells:
        given, both = added(given, Apply(Operator.AND, (cell.condition, winning)), Kind.BOOL)
        cells.append(replace(cell, condition=both))
    return replace(given, cells=tuple(cells))


def other_initial_values(given: Code) -> Code:
    """Memory of bools starts true."""
    cells = tuple(
        replace(c, initial=True) if c.kind is Kind.BOOL and c.initial is False else c for c in given.cells
    )
    return replace(given, cells=cells)


def never_silent(given: Code) -> Code:
    """A module that reads something missing goes on with placeholders."""
    ops = list(given.ops)
    for actuator in given.actuators:
        for client in actuator.clients:
            ops[client.present] = Literal(True)
    return replace(given, ops=tuple(ops))


def limits(change: Callable[[tuple[Any, ...]], tuple[Any, ...]]) -> Plant:
    """`change` the limits of every actuator."""
    return code(
        lambda given: replace(
            given, actuators=tuple(replace(a, limits=change(a.limits)) for a in given.actuators)
        )
    )


def limits_without_condition(given: Code) -> Code:
    given, always = added(given, Literal(True), Kind.BOOL)
    actuators = tuple(
        replace(a, limits=tuple(replace(m, applies=always) for m in a.limits)) for a in given.actuators
    )
    return replace(given, actuators=actuators)


def contracts_always_there(given: Code) -> Code:
    given, always = added(given, Literal(True), Kind.BOOL)
    return replace(given, contracts=tuple(replace(c, present=always) for c in given.contracts))


def defaults_fresh(given: Code) -> Code:
    """A sensor counts as fresh where only its default stands in."""
    with_default = {s.name for s in given.sensors if s.default is not None}
    return replace(
        given,
        ops=tuple(
            Literal(True) if isinstance(op, SensorFresh) and op.sensor in with_default else op
            for op in given.ops
        ),
    )


def sensors_changed(change: Callable[[Any], Any]) -> Plant:
    return code(lambda given: replace(given, sensors=tuple(map(change, given.sensors))))


def operator(which: Operator, function: Callable[..., Any]) -> Plant:
    """Another function for an operator, both where it is executed and where constants are folded."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        functions: Mapping[Operator, Callable[..., Any]] = MappingProxyType({**FUNCTIONS, which: function})
        monkeypatch.setattr(executor_machine, "FUNCTIONS", functions)

    return plant


def rounded_up(x: float) -> float:
    return math.copysign(math.floor(x + 0.5), x) if math.isfinite(x) else x


# --- what surrounds code -------------------------------------------------------------------------


def bad_commands_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("colony.compile.settle.isfinite", lambda x: True)


def range_before_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    original = executor_decisions.settle

    def settle(actuator: str, by: str, command: Any, fields: Any, limits: Any, *rest: Any) -> Any:
        inside = tuple(
            x if isinstance(x, bool) else clamped(x, low, high)
            for x, (_, _, low, high) in zip(command, fields, strict=True)
        )
        return original(actuator, by, inside, fields, limits, *rest)

    monkeypatch.setattr(executor_decisions, "settle", settle)


def clamped(x: float, low: float | None, high: float | None) -> float:
    if low is not None and x < low:
        return low
    return high if high is not None and x > high else x


def answers_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Python module with a rate is called every frame, and its answer stands at once."""
    original = python_step.PythonStep.__init__

    def init(self: Any, module: str, instance: object, fields: Any, rate: int | None) -> None:
        original(self, module, instance, fields, None)

    monkeypatch.setattr(python_step.PythonStep, "__init__", init)


def generated(change: Callable[[str], str]) -> Plant:
    """`change` the text of the generated Python."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = agreement.generate
        monkeypatch.setattr(agreement, "generate", lambda *args: change(original(*args)))

    return plant


def without_memory(source: str) -> str:
    """Generated Python that forgets what it should keep: the last assignment after the mark `# memory`."""
    head, mark, tail = source.partition("# memory\n")
    lines = tail.splitlines()
    kept = [i for i, line in enumerate(lines) if line.lstrip().startswith("self.")]
    if kept:
        at = kept[-1]
        lines[at] = lines[at][: len(lines[at]) - len(lines[at].lstrip())] + "pass"
    return head + mark + "\n".join(lines) + "\n"


BUGS: tuple[Bug, ...] = (
    # wiring
    Bug(
        name="children of suppressors swapped",
        network=True,
        plant=nodes(lambda n: swapped(n) if isinstance(n, Suppressor) else n),
    ),
    Bug(
        name="children of inhibitors swapped",
        network=True,
        plant=nodes(lambda n: swapped(n) if isinstance(n, Inhibitor) else n),
    ),
    Bug(name="inhibitors taken for suppressors", network=True, plant=nodes(suppressing)),
    Bug(name="chains associated to the left", network=True, plant=rewired(left_associated)),
    Bug(
        name="time constants of a chain in reverse",
        network=True,
        plant=rewired(lambda c: replace(c, windows_ns=c.windows_ns[::-1])),
    ),
    Bug(name="time constants of suppressors dropped", network=True, plant=window(lambda ns: 0, Suppressor)),
    Bug(name="time constants of inhibitors dropped", network=True, plant=window(lambda ns: 0, Inhibitor)),
    Bug(name="time constants that include their end", network=True, plant=window(lambda ns: ns + 1)),
    Bug(name="time constants that end too soon", network=True, plant=window(lambda ns: ns - 1)),
    Bug(name="time constants off by one frame", network=True, plant=window(lambda ns: ns + 50_000_000)),
    Bug(
        name="a suppressor with a time constant only inhibits", network=True, plant=nodes(inhibiting_for_long)
    ),
    # inhibition elimination
    Bug(name="gates dropped", network=True, plant=links(ungated)),
    Bug(name="gates on the wrong wire", network=True, plant=links(gates_swapped)),
    Bug(name="dominant though inhibited", network=True, plant=links(dominant_though_inhibited)),
    Bug(
        name="activity of another wire observed",
        network=True,
        plant=after("eliminate_inhibition", observed_shifted),
    ),
    # forward traversal
    Bug(name="a shared module numbered at its first visit", network=True, plant=numbered_at_first_visit),
    Bug(
        name="one use forgotten in through", network=True, plant=after("forward_traversal", one_use_forgotten)
    ),
    Bug(name="priorities in reverse", network=True, plant=lists(reversed_priorities)),
    Bug(name="the lowest client lost", network=True, plant=lists(lowest_lost)),
    Bug(name="exclusive guards that are not", network=True, plant=lists(not_exclusive)),
    # guards
    Bug(
        name="a guard's last condition dropped",
        network=True,
        plant=table(lambda g: last_part_dropped(g, And)),
    ),
    Bug(
        name="a guard's last alternative dropped",
        network=True,
        plant=table(lambda g: last_part_dropped(g, Or)),
    ),
    Bug(name="negations dropped", network=True, plant=table(lambda g: Always() if isinstance(g, Not) else g)),
    Bug(
        name="recently taken for now",
        network=True,
        plant=table(lambda g: And((g.operand, g.operand)) if isinstance(g, Recently) else g),
    ),
    # memory
    Bug(name="memory moved on while missing", plant=code(moved_while_missing)),
    Bug(name="short-circuited memory", plant=code(short_circuited)),
    Bug(name="memory frozen where nobody wins", plant=code(frozen_where_not_winning)),
    Bug(name="memory that starts true", plant=code(other_initial_values)),
    Bug(
        name="windows that include their end",
        network=True,
        plant=operator(Operator.TIME_LESS, lambda x, y: x <= y),
    ),
    # missing and defaults
    Bug(name="modules never silent", plant=code(never_silent)),
    Bug(name="defaults taken for fresh", plant=code(defaults_fresh)),
    Bug(name="sensors not clamped", plant=sensors_changed(lambda s: replace(s, low=None, high=None))),
    Bug(name="units of sensors ignored", plant=sensors_changed(lambda s: replace(s, factor=1.0))),
    Bug(name="contracts judged on what is missing", plant=code(contracts_always_there)),
    # what is sent
    Bug(name="limits in reverse", plant=limits(lambda of: of[::-1])),
    Bug(
        name="limits the wrong way round",
        plant=limits(lambda of: tuple(replace(m, relation="<=" if m.relation == ">=" else ">=") for m in of)),
    ),
    Bug(name="limits without their condition", plant=code(limits_without_condition)),
    Bug(name="the range before the limits", plant=range_before_limits),
    Bug(name="commands that are not finite sent", plant=bad_commands_sent),
    Bug(name="Python modules answer at once", plant=answers_at_once),
    # generated Python
    Bug(name="generated Python forgets one memory", plant=generated(without_memory)),
    Bug(name="generated Python compares loosely", plant=generated(lambda s: s.replace(" < ", " <= "))),
    # arithmetic
    Bug(name="NaN ignored by min", plant=operator(Operator.MIN, lambda *x: min(x))),
    Bug(name="NaN ignored by max", plant=operator(Operator.MAX, lambda *x: max(x))),
    Bug(name="sums begun with zero", plant=operator(Operator.SUM, lambda *x: 0.0 + sum(x))),
    Bug(
        name="remainders with the sign of x",
        plant=operator(Operator.MODULO, lambda x, y: math.fmod(x, y) if y and math.isfinite(x) else math.nan),
    ),
    Bug(name="halves rounded up", plant=operator(Operator.ROUND, rounded_up)),
    Bug(
        name="division by zero without its sign",
        plant=operator(
            Operator.DIVIDE, lambda x, y: x / y if y else math.nan if not x or x != x else math.inf
        ),
    ),
    Bug(name="negation by subtraction", plant=operator(Operator.NEGATE, lambda x: 0.0 - x)),
    Bug(
        name="angles in radians",
        plant=operator(Operator.SIN, lambda x: math.sin(x) if math.isfinite(x) else math.nan),
    ),
    Bug(
        name="atan2 with its arguments swapped",
        plant=operator(Operator.ATAN2, lambda y, x: math.degrees(math.atan2(x, y))),
    ),
    Bug(
        name="the last of equals",
        plant=operator(Operator.INDEX_OF_MIN, lambda *x: float(len(x) - 1 - x[::-1].index(min(x)))),
    ),
    Bug(name="less or equal for less", plant=operator(Operator.LESS, lambda x, y: x <= y)),
)
