from __future__ import annotations

from dataclasses import replace

import pytest

from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor
from colony.compile.passes.elaborate import elaborate
from colony.ir.expression import Binary, BinaryOperation, IsActive, WonBy
from colony.ir.program import Contract, Example, Step, Use, Wire
from colony.ir.types import BOOL
from tests.networks import chain
from tests.wiring import program

MS = 1_000_000


def node_of(network: Network, module: str) -> int:
    return network.nodes.index(ModuleLeaf(module=module))


def test_a_module_alone() -> None:
    assert elaborate(program("drive = a")) == Network(
        nodes=(ModuleLeaf(module="a"),), outputs=(("drive", 0),)
    )


def test_chains_are_right_associative_and_carry_their_windows() -> None:
    network = elaborate(program("drive = a suppresses[50 ms] b suppresses c"))
    a, b, c = (node_of(network, name) for name in "abc")
    inner = network.nodes.index(Suppressor(dominant=b, inferior=c))
    assert network.nodes[network.outputs[0][1]] == Suppressor(dominant=a, inferior=inner, window_ns=50 * MS)


def test_inhibitors() -> None:
    network = elaborate(program("drive = a inhibits[1500 ms] b"))
    assert network.nodes[-1] == Inhibitor(dominant=0, inferior=1, window_ns=1500 * MS)


def test_parentheses() -> None:
    network = elaborate(program("drive = (a suppresses b) suppresses c"))
    root = network.nodes[network.outputs[0][1]]
    assert isinstance(root, Suppressor)
    assert network.nodes[root.dominant] == Suppressor(
        dominant=node_of(network, "a"), inferior=node_of(network, "b")
    )


def test_inputs_stand_before_their_nodes_and_a_module_has_one_leaf() -> None:
    network = elaborate(program("w = a suppresses b\ndrive = (a inhibits w) suppresses w"))
    for at, node in enumerate(network.nodes):
        if not isinstance(node, ModuleLeaf):
            assert max(node.dominant, node.inferior) < at
    assert sum(isinstance(node, ModuleLeaf) for node in network.nodes) == 2


def test_wires_keep_their_names_and_may_be_other_names_of_one_node() -> None:
    network = elaborate(program("w = a suppresses b\nsame = w\ndrive = same"))
    assert dict(network.wires) == {"w": 2, "same": 2}
    assert network.outputs == (("drive", 2),)


def test_outputs_are_in_the_order_of_the_robot() -> None:
    network = elaborate(program("arm = a\ndrive = b"))
    assert [actuator for actuator, _ in network.outputs] == ["drive", "arm"]


def test_an_actuator_without_wiring_is_no_output() -> None:
    wired = program("drive = a\narm = b")
    network = elaborate(replace(wired, wires=wired.wires[:1]))
    assert [actuator for actuator, _ in network.outputs] == ["drive"]


def test_what_contracts_and_examples_name_is_observed() -> None:
    def active(name: str) -> IsActive:
        return IsActive(type=BOOL, name=name)

    nested = BinaryOperation(type=BOOL, operator=Binary.IMPLIES, left=active("w"), right=active("b"))
    won = WonBy(type=BOOL, actuator="drive", module="a")
    step = Step(times_ns=(0,), given=(), expectations=(won, active("b"), active("a")))
    observing = replace(
        program("w = a suppresses b\ndrive = w"),
        contracts=(Contract(name="c", expression=nested),),
        tests=(Example(name="t", steps=(step,)),),
    )
    network = elaborate(observing)
    assert network.observed == (("w", 2), ("b", 1), ("a", 0))


def test_an_observed_module_may_stand_in_no_wire() -> None:
    wired = program("drive = a\narm = lone")
    contract = Contract(name="c", expression=IsActive(type=BOOL, name="lone"))
    network = elaborate(replace(wired, wires=wired.wires[:1], contracts=(contract,)))
    assert network.observed == (("lone", node_of(network, "lone")),)


def test_a_name_that_nothing_declares() -> None:
    broken = replace(
        program("drive = a"), wires=(Wire(name="drive", wiring=Use(name="b"), actuator="drive"),)
    )
    with pytest.raises(ValueError, match="`b` is neither a module nor a wire"):
        elaborate(broken)


def test_long_chains_do_not_recurse() -> None:
    assert len(elaborate(chain(20_000)).nodes) == 39_999
