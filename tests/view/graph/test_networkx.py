from __future__ import annotations

from pathlib import Path

import networkx
import pytest

from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor
from colony.dsl.load import load_file
from colony.view.graph.networkx import to_graphml, to_networkx
from tests.paths import BEHAVIORS
from tests.sampling import sampled

NETWORK = Network(
    nodes=(
        ModuleLeaf(module="a"),
        ModuleLeaf(module="b"),
        Suppressor(dominant=0, inferior=1, window_ns=5),
        Inhibitor(dominant=0, inferior=2),
    ),
    outputs=(("drive", 3),),
    wires=(("both", 2), ("drive", 3)),
)


def test_nodes_and_edges_tell_kinds_and_sides() -> None:
    graph = to_networkx(NETWORK)
    assert graph.nodes["n2"] == {"kind": "suppressor", "label": "both", "window_ns": 5}
    assert graph.nodes["actuator:drive"]["kind"] == "actuator"
    sides = sorted((u, v, d["side"]) for u, v, d in graph.edges(data=True))
    assert sides == [
        ("n0", "n2", "dominant"),
        ("n0", "n3", "dominant"),
        ("n1", "n2", "inferior"),
        ("n2", "n3", "inferior"),
        ("n3", "actuator:drive", "output"),
    ]


def test_graphml_reads_back() -> None:
    graph = networkx.parse_graphml(to_graphml(NETWORK), force_multigraph=True)
    original = to_networkx(NETWORK)
    assert dict(graph.nodes(data=True)) == dict(original.nodes(data=True))
    assert sorted(graph.edges(data="side")) == sorted(original.edges(data="side"))


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=4), ids=lambda p: p.stem)
def test_networks_of_behaviors_are_acyclic_and_end_in_actuators(path: Path) -> None:
    graph = to_networkx(load_file(path))
    assert networkx.is_directed_acyclic_graph(graph)
    ends = [data for node, data in graph.nodes(data=True) if graph.out_degree(node) == 0]
    # What an imported file gives its own actuator is a wire here, which drives nothing (`hallway.drive`).
    assert {end["kind"] for end in ends if "." not in end["label"]} <= {"actuator"}
