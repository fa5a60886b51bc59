from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from colony.compile.network import SuppressionNetwork
from colony.compile.passes.elaborate import elaborate
from colony.compile.passes.eliminate_inhibition import eliminate_inhibition
from colony.compile.passes.forward_traversal import forward_traversal
from colony.ir.program import Program
from tests.networks import chain, ladder


@pytest.mark.parametrize("make", [chain, ladder])
def test_the_result_is_linear_in_the_network(make: Callable[[int], Program]) -> None:
    def guards(size: int) -> int:
        return len(forward_traversal(eliminate_inhibition(elaborate(make(size)))).guards)

    assert guards(4_000) <= 4.1 * guards(1_000)


def test_a_network_without_time_constants_has_clients_without() -> None:
    made = eliminate_inhibition(elaborate(chain(3)))
    by_hand = SuppressionNetwork(nodes=made.nodes, guards=made.guards, outputs=made.outputs)
    assert by_hand == replace(made, wires=(), observed=())
    assert forward_traversal(by_hand).windows == ()
    assert by_hand == replace(by_hand, windows=(("w", 0),)), "names in memory make no other network"
