from __future__ import annotations

import gc

import pytest

from colony.compile.passes.elaborate import elaborate
from colony.compile.passes.eliminate_inhibition import eliminate_inhibition
from colony.compile.passes.forward_traversal import forward_traversal
from colony.compile.passes.simplify import simplify
from colony.compile.pipeline import PASSES, compile_program
from tests.networks import chain, ladder, random_program


@pytest.mark.parametrize("program", [chain(5), ladder(5), random_program(30, seed=4)])
def test_each_pass_takes_what_the_one_before_it_gave(program) -> None:
    compilation = compile_program(program)
    assert compilation.network == elaborate(program)
    assert compilation.suppression == eliminate_inhibition(compilation.network)
    assert compilation.traversal == forward_traversal(compilation.suppression)
    assert compilation.clients == simplify(compilation.traversal)


def test_each_pass_is_named_for_its_file() -> None:
    for one in PASSES:
        assert one.__module__ == f"colony.compile.passes.{one.__name__}"


def test_the_garbage_collector_is_left_as_it_was() -> None:
    assert gc.isenabled()
    compile_program(chain(3))
    assert gc.isenabled()
    gc.disable()
    try:
        compile_program(chain(3))
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_ten_thousand_modules_ten_thousand_deep() -> None:
    clients = compile_program(chain(10_000)).clients
    assert [client.priority for client in clients.actuators[0].clients] == list(range(10_000, 0, -1))
