"""The passes change nothing: on small networks of every form, network and clients always agree."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.compile.network import Network
from colony.compile.passes.eliminate_inhibition import eliminate_inhibition
from colony.compile.passes.forward_traversal import forward_traversal
from colony.compile.passes.simplify import simplify
from colony.compile.pipeline import compile_program
from tests.compile.passes.network_semantics import History, all_valuations, assert_same, histories, networks
from tests.networks import chain, ladder, random_program

SETTINGS = settings(max_examples=150, deadline=None, derandomize=True)


@given(network=networks())
@SETTINGS
def test_clients_are_the_network_for_every_valuation(network: Network) -> None:
    traversal = forward_traversal(eliminate_inhibition(network))
    assert_same(network, traversal, all_valuations(network))
    assert_same(network, simplify(traversal), all_valuations(network))


@given(network=networks(), history=histories())
@SETTINGS
def test_clients_are_the_network_over_histories(network: Network, history: History) -> None:
    traversal = forward_traversal(eliminate_inhibition(network))
    assert_same(network, traversal, history)
    assert_same(network, simplify(traversal), history)


@given(seed=st.integers(0, 1000), history=histories(modules=12, frames=20))
@settings(max_examples=60, deadline=None, derandomize=True)
def test_clients_are_the_network_on_random_programs(seed: int, history: History) -> None:
    compilation = compile_program(random_program(12, seed))
    assert_same(compilation.network, compilation.clients, history)


@pytest.mark.parametrize("program", [ladder(6), chain(6)])
def test_clients_are_the_network_on_ladders_and_chains(program) -> None:
    compiled = compile_program(program)
    assert_same(compiled.network, compiled.clients, all_valuations(compiled.network))
