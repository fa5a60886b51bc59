"""The network as a networkx graph, for your own analyses, and as GraphML, for other tools."""

from __future__ import annotations

from typing import TYPE_CHECKING

from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor
from colony.compile.passes.elaborate import elaborate
from colony.ir.program import Program

if TYPE_CHECKING:
    import networkx


def to_networkx(drawn: Program | Network) -> networkx.MultiDiGraph:
    """Return a directed multigraph along the flow of commands, from modules to actuators.

    Nodes have `kind` (module, suppressor, inhibitor, actuator), `label`, and suppressors and inhibitors
    `window_ns`; edges have `side` (dominant, inferior, or output into an actuator).
    """
    import networkx

    network = elaborate(drawn) if isinstance(drawn, Program) else drawn
    names = {at: name for name, at in network.wires}
    graph = networkx.MultiDiGraph()
    for at, node in enumerate(network.nodes):
        match node:
            case ModuleLeaf(module=module):
                graph.add_node(f"n{at}", kind="module", label=module)
            case Suppressor() | Inhibitor():
                kind = "suppressor" if isinstance(node, Suppressor) else "inhibitor"
                graph.add_node(f"n{at}", kind=kind, label=names.get(at, ""), window_ns=node.window_ns)
                graph.add_edge(f"n{node.dominant}", f"n{at}", side="dominant")
                graph.add_edge(f"n{node.inferior}", f"n{at}", side="inferior")
    for actuator, at in network.outputs:
        graph.add_node(f"actuator:{actuator}", kind="actuator", label=actuator)
        graph.add_edge(f"n{at}", f"actuator:{actuator}", side="output")
    return graph


def to_graphml(drawn: Program | Network) -> str:
    """Return the graph of `to_networkx` as a GraphML document."""
    import networkx

    return "\n".join(networkx.generate_graphml(to_networkx(drawn))) + "\n"
