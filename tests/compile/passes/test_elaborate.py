from __future__ import annotations

from dataclasses import replace

import pytest

from colony.compile.network import ModuleLeaf, Network
from colony.compile.passes.elaborate import elaborate
from colony.ir.expression import Binary, BinaryOperation, IsActive, WonBy
from colony.ir.program import Contract, Example, ExampleStep, Use, Wire
from colony.ir.types import BOOL
from tests.networks import chain
from tests.wiring import program

MS = 1_000_000


def node_of(network: Network, module: str) -> int:
    return network.nodes.index(ModuleLeaf(module=module))


def test_an_actuator_without_wiring_is_no_output() -> None:
    wired = program("drive = a\narm = b")
    network = elaborate(replace(wired, wires=wired.wires[:1]))
    assert [actuator for actuator, _ in network.outputs] == ["drive"]


def test_what_contracts_and_examples_name_is_observed() -> None:
    def active(name: str) -> IsActive:
        return IsActive(type=BOOL, name=name)

    nested = BinaryOperation(type=BOOL, operator=Binary.IMPLIES, left=active("w"), right=active("b"))
    won = WonBy(type=BOOL, actuator="drive", module="a")
    step = ExampleStep(times_ns=(0,), given=(), expectations=(won, active("b"), active("a")))
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
