"""By how many ways a module's command can reach an actuator."""

from __future__ import annotations

from typing import assert_never

from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor


def by_several_ways(network: Network, actuator: str, module: str) -> bool:
    """Whether the command of `module` has more than one way to `actuator`.

    Such a client has the exclusive guard for both (see `forward_traversal`). False where it has no way.
    """
    root = dict(network.outputs).get(actuator)
    if root is None:
        return False
    ways = [0] * len(network.nodes)
    ways[root] = 1
    for at in range(root, -1, -1):  # users stand after what they use
        node = network.nodes[at]
        match node:
            case ModuleLeaf():
                if node.module == module:
                    return ways[at] > 1
            case Suppressor(dominant=dominant, inferior=inferior):
                ways[dominant] = min(2, ways[dominant] + ways[at])
                ways[inferior] = min(2, ways[inferior] + ways[at])
            case Inhibitor(inferior=inferior):
                ways[inferior] = min(2, ways[inferior] + ways[at])
            case _:
                assert_never(node)
    return False
