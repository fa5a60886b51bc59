"""Pictures of networks: `colony graph`."""

from __future__ import annotations

from colony.view.graph_dot import to_dot
from colony.view.graph_svg import to_svg

__all__ = ["to_dot", "to_svg"]
