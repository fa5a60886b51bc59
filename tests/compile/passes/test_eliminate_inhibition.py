from __future__ import annotations

from colony.compile.backends.table import GuardText
from colony.compile.guards import Recently
from colony.compile.network import (
    GatedSuppressor,
    Inhibitor,
    ModuleLeaf,
    Network,
    NodeUse,
    SuppressionNetwork,
    Suppressor,
)
from colony.compile.passes.elaborate import elaborate
from colony.compile.passes.eliminate_inhibition import eliminate_inhibition
from colony.compile.passes.forward_traversal import forward_traversal
from tests.networks import chain, ladder
from tests.wiring import program


def eliminated(text: str) -> SuppressionNetwork:
    return eliminate_inhibition(elaborate(program(text)))


def root(network: SuppressionNetwork) -> NodeUse:
    return network.outputs[0][1]


def written(network: SuppressionNetwork, ref: int) -> str:
    return GuardText(network.guards).text(ref)


def test_a_suppressor_with_a_time_constant_is_one_over_an_inhibitor() -> None:
    network = eliminated("drive = a suppresses[50 ms] b")
    same = eliminated("drive = a suppresses (a inhibits[50 ms] b)")
    assert network == same


def test_the_result_is_linear_in_the_network() -> None:
    for make in (chain, ladder):
        sizes = [len(eliminate_inhibition(elaborate(make(size))).guards) for size in (1_000, 4_000)]
        assert sizes[1] <= 4.1 * sizes[0]


def test_the_shortest_time_constant_counts() -> None:
    nodes = (ModuleLeaf(module="a"), ModuleLeaf(module="b"), Suppressor(dominant=0, inferior=1, window_ns=1))
    network = eliminate_inhibition(Network(nodes=nodes, outputs=(("drive", 2),)))
    node = network.nodes[root(network).node]
    assert isinstance(node, GatedSuppressor)
    assert written(network, node.inferior.gate) == "not recently(a, 0.000001 ms)"


def test_nodes_have_no_time_constant_unless_it_is_given() -> None:
    nodes = (
        ModuleLeaf(module="a"),
        ModuleLeaf(module="b"),
        Inhibitor(dominant=0, inferior=1),
        Suppressor(dominant=0, inferior=2),
    )
    network = eliminate_inhibition(Network(nodes=nodes, outputs=(("drive", 3),)))
    assert not any(isinstance(guard, Recently) for guard in network.guards)
    assert (network.wires, network.observed) == ((), ())


def test_a_network_may_do_without_names() -> None:
    alone = eliminated("drive = a inhibits b")
    bare = SuppressionNetwork(nodes=alone.nodes, guards=alone.guards, outputs=alone.outputs)
    assert (bare.wires, bare.observed) == ((), ())
    assert forward_traversal(bare).actuators == forward_traversal(alone).actuators
