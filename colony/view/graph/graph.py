"""Pictures of networks: `colony graph`."""

from __future__ import annotations

from colony.compile.network import Network
from colony.compile.passes.elaborate import elaborate
from colony.ir.program import Program
from colony.view.graph import dot as graph_dot
from colony.view.graph import mermaid as graph_mermaid
from colony.view.graph import svg as graph_svg
from colony.view.graph.difference import Marks


def to_svg(program_or_network: Program | Network, title: str = "") -> str:
    """Return a program's network, or a network, as an SVG document."""
    return graph_svg.to_svg(_network(program_or_network), title)


def to_dot(program_or_network: Program | Network, title: str = "", marks: Marks | None = None) -> str:
    """Return a program's network, or a network, as a DOT digraph, for Graphviz."""
    return graph_dot.to_dot(_network(program_or_network), title, marks)


def to_mermaid(program_or_network: Program | Network, title: str = "", marks: Marks | None = None) -> str:
    """Return a program's network, or a network, as a Mermaid flowchart, for pages of Markdown."""
    return graph_mermaid.to_mermaid(_network(program_or_network), title, marks)


def _network(program_or_network: Program | Network) -> Network:
    return elaborate(program_or_network) if isinstance(program_or_network, Program) else program_or_network
