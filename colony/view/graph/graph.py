"""Pictures of networks: `colony graph`."""

from __future__ import annotations

from colony.compile.network import Network
from colony.compile.passes.elaborate import elaborate
from colony.ir.program import Program
from colony.view.graph import dot as graph_dot
from colony.view.graph import svg as graph_svg


def to_svg(drawn: Program | Network, title: str = "") -> str:
    """Return a program's network, or a network, as an SVG document."""
    return graph_svg.to_svg(_network(drawn), title)


def to_dot(drawn: Program | Network, title: str = "") -> str:
    """Return a program's network, or a network, as a DOT digraph, for Graphviz."""
    return graph_dot.to_dot(_network(drawn), title)


def _network(drawn: Program | Network) -> Network:
    return elaborate(drawn) if isinstance(drawn, Program) else drawn
