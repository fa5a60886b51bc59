"""The network as a networkx graph, for custom analyses, and as GraphML, for other tools."""

from __future__ import annotations

from typing import TYPE_CHECKING

from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor
from colony.compile.passes.elaborate import elaborate
from colony.ir.program import Program

if TYPE_CHECKING:
    import networkx


def to_networkx(program_or_network: Program | Network) -> networkx.MultiDiGraph:
    """Return a directed multigraph along the flow of commands, from modules to actuators.

    Nodes have `kind` (module, suppressor, inhibitor, actuator) and `label`; modules also have `failsafe`,
    suppressors and inhibitors `window_ns`. Edges have `side` (dominant, inferior, or output into an
    actuator).
    """
    import networkx

    network = elaborate(program_or_network) if isinstance(program_or_network, Program) else program_or_network
    names = {index: name for name, index in network.wires}
    graph = networkx.MultiDiGraph()
    for index, node in enumerate(network.nodes):
        match node:
            case ModuleLeaf(module=module, failsafe=failsafe):
                graph.add_node(f"n{index}", kind="module", label=module, failsafe=failsafe)
            case Suppressor() | Inhibitor():
                kind = "suppressor" if isinstance(node, Suppressor) else "inhibitor"
                graph.add_node(f"n{index}", kind=kind, label=names.get(index, ""), window_ns=node.window_ns)
                graph.add_edge(f"n{node.dominant}", f"n{index}", side="dominant")
                graph.add_edge(f"n{node.inferior}", f"n{index}", side="inferior")
    for actuator, index in network.outputs:
        graph.add_node(f"actuator:{actuator}", kind="actuator", label=actuator)
        graph.add_edge(f"n{index}", f"actuator:{actuator}", side="output")
    return graph


def to_graphml(program_or_network: Program | Network) -> str:
    """Return the graph of `to_networkx` as a GraphML document."""
    import networkx

    return "\n".join(networkx.generate_graphml(to_networkx(program_or_network))) + "\n"
