"""The network as written, in Boolean formulas: the reference for every compiled form.

This is part of what a proof trusts, so it stays close to the language reference and shares nothing with the
compiler. For every module and wire there is a formula for "puts a command on its output":

    active(A suppresses[T] B) = active(A) or active(B) and not dominates
    active(A inhibits[T] B)   = active(B) and not dominates
    dominates                 = active(A) now, or in an earlier frame less than T ago

and, from the wiring that drives an actuator down to the modules, one for "what it puts there gets through":

    through(wiring of the actuator) = true
    through(A) = through(A suppresses B)                         (of an inhibitor's dominant side, nothing)
    through(B) = through(A suppresses B) and not dominates       (the same of an inhibitor)

or, for a wiring that is used several times, through one of the uses. A module wins if it is active and
through. In every frame the nodes that are both active and through form one path from the actuator to one
module, since exactly one of the two inputs of a node on the path is the next; so no two modules win.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from colony.ir.program import Program
from colony.ir.walk import wiring_graph
from colony.verify.equivalence.circuit import FALSE, TRUE, Activity, Circuit, HeldInput


@dataclass(frozen=True, slots=True, kw_only=True)
class InnerNode:
    """A suppressor or inhibitor, with references to its inputs, which come before it."""

    suppresses: bool
    dominant: int
    inferior: int
    window_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Root:
    """An actuator: the node that drives it, and the formulas of the nodes below.

    The formulas say when each node gets through to it, and when each module wins.
    """

    node: int
    through: Mapping[int, int]
    wins: Mapping[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkFormulas:
    """The formulas of a network.

    Attributes:
        nodes: modules (strings), and suppressors and inhibitors after their inputs.
        active: the formula of each node's activity.
        dominates: by node, the formula for "its dominant input dominates".
        names: the node of each module and wire.
        roots: the actuators that are driven.
    """

    nodes: tuple[str | InnerNode, ...]
    active: tuple[int, ...]
    dominates: tuple[int, ...]
    names: Mapping[str, int]
    roots: Mapping[str, Root]

    def dominant(self, index: int) -> int:
        """Return the formula of the dominant input of a suppressor or inhibitor."""
        return self.active[_inner_node(self.nodes[index]).dominant]

    def activity(self, name: str) -> int:
        """Return the formula of a module's or wire's activity."""
        return self.active[self.names[name]]


NEVER = -1
"""Stands for a node whose dominant input is never active, so that it has no history."""


def encode_network(
    program: Program, circuit: Circuit, history_owners: Mapping[int, int] = MappingProxyType({})
) -> NetworkFormulas:
    """Encode all wires of a program as formulas.

    Time constants share a history if their dominant inputs are the same formula. `history_owners` maps a node
    to another one whose dominant input was proved equal, and whose history it therefore shares, or to `NEVER`
    if the dominant input is never active.
    """
    wired = _Wired(program)
    active: list[int] = []
    dominates: list[int] = []
    for index, node in enumerate(wired.nodes):
        if isinstance(node, str):
            active.append(circuit.input(Activity(node)))
            dominates.append(FALSE)
            continue
        dominant, inferior = active[node.dominant], active[node.inferior]
        owner = history_owners.get(index, index)
        remembered = FALSE if owner == NEVER else active[_inner_node(wired.nodes[owner]).dominant]
        dominating = _recently(circuit, dominant, remembered, node.window_ns)
        passing = circuit.both(inferior, dominating ^ 1)
        active.append(circuit.either(dominant, passing) if node.suppresses else passing)
        dominates.append(dominating)
    roots = {
        actuator: _root(wired.nodes, root, active, dominates, circuit)
        for actuator, root in wired.driving.items()
    }
    return NetworkFormulas(
        nodes=tuple(wired.nodes),
        active=tuple(active),
        dominates=tuple(dominates),
        names=wired.names,
        roots=roots,
    )


def _inner_node(node: str | InnerNode) -> InnerNode:
    assert isinstance(node, InnerNode), "only suppressors and inhibitors have time constants"
    return node


def _recently(circuit: Circuit, now: int, remembered: int, window_ns: int) -> int:
    """Return "holds `now`, or held less than the window ago"; `remembered` is the condition in the past.

    A condition that never holds, or always holds, has no history.
    """
    if window_ns <= 0 or remembered in (FALSE, TRUE):
        return now
    return circuit.either(now, circuit.input(HeldInput(remembered, window_ns)))


def _root(
    nodes: list[str | InnerNode], root: int, active: list[int], dominates: list[int], circuit: Circuit
) -> Root:
    through = {root: TRUE}
    wins: dict[str, int] = {}
    for index in range(root, -1, -1):  # a node comes after its inputs, so all its uses are known
        node = nodes[index]
        if index not in through:
            continue
        if isinstance(node, str):
            wins[node] = circuit.both(through[index], active[index])
            continue
        if node.suppresses:
            through[node.dominant] = circuit.either(through.get(node.dominant, FALSE), through[index])
        passing = circuit.both(through[index], dominates[index] ^ 1)
        through[node.inferior] = circuit.either(through.get(node.inferior, FALSE), passing)
    return Root(node=root, through=through, wins=wins)


class _Wired:
    """The wires as one table of nodes: all modules, then each suppressor and inhibitor after its inputs."""

    def __init__(self, program: Program) -> None:
        wired = wiring_graph(program)
        names = [
            *(module.name for module in program.modules),
            *(inner_node.name for inner_node in wired.nodes),
        ]
        index = {name: i for i, name in enumerate(names)}
        self.nodes: list[str | InnerNode] = [module.name for module in program.modules]
        self.nodes += [
            InnerNode(
                suppresses=inner_node.relation == "suppresses",
                dominant=index[inner_node.dominant],
                inferior=index[inner_node.inferior],
                window_ns=inner_node.window_ns,
            )
            for inner_node in wired.nodes
        ]
        self.names = {module.name: index[module.name] for module in program.modules}
        self.names |= {wire: index[stands_for] for wire, stands_for in wired.wires.items()}
        self.driving = {actuator: index[root] for actuator, root in wired.roots.items()}
