"""What each client needs, found for all at once, is what its own view of the program has."""

from __future__ import annotations

from hypothesis import given

from colony.compile.pipeline import compile_program
from colony.execute.needs import BOUNDS, clients_view, needs_of_clients, python_modules
from colony.ir.program import Program
from tests.drawn.strategies import networks, programs


def needs_are_those_of_views(program: Program) -> None:
    compiled = compile_program(program).compiled
    keys = [
        (code.actuator.name, module)
        for code in compiled.code.actuators
        for module in (*(c.module for c in code.clients), *([BOUNDS] if code.limits else []))
    ]
    code = clients_view(compiled.code, keys)
    found = needs_of_clients(code)
    assert [*found] == keys
    for key, needs in found.items():
        alone = clients_view(compiled.code, [key])
        assert needs.sensors == tuple(s.name for s in alone.sensors)
        assert set(needs.python_modules) == set(python_modules(alone))
        assert {code.cells[i].name for i in needs.cells} == {c.name for c in alone.cells}


@given(programs())
def test_of_programs(program: Program) -> None:
    needs_are_those_of_views(program)


@given(networks())
def test_of_networks(program: Program) -> None:
    needs_are_those_of_views(program)
