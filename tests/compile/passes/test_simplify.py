from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.compile.backends.table import GuardText
from colony.compile.guards import (
    ActuatorClients,
    Always,
    And,
    Client,
    ClientList,
    Guard,
    ModuleActive,
    Never,
    Not,
    Or,
    Recently,
    operands,
)
from colony.compile.passes.simplify import simplify
from colony.compile.pipeline import compile_program
from tests.case_files import table
from tests.compile.passes.as_text import guards
from tests.compile.passes.network_semantics import GuardRun, History, histories
from tests.networks import chain, ladder, random_program

MS = 1_000_000
MODULES = (ModuleActive("m0"), ModuleActive("m1"), ModuleActive("m2"))


@pytest.mark.parametrize(("guard", "expected"), table(Path(__file__).parent / "cases" / "simplify.table"))
def test_rules(guard: str, expected: str) -> None:
    whole = guards(guard, "m0", "m1", "m2")
    client = Client(module="m0", priority=1, guard=len(whole) - 1, exclusive=len(whole) - 1)
    clients = ClientList(guards=whole, actuators=(ActuatorClients(actuator="drive", clients=(client,)),))
    simpler = simplify(clients)
    assert GuardText(simpler.guards).text(simpler.actuators[0].clients[0].guard) == expected


@st.composite
def tables(draw: st.DrawFn) -> tuple[Guard, ...]:
    """Tables of guards over m0 .. m3, with much sharing."""
    table: list[Guard] = [Always(), Never(), *(ModuleActive(f"m{i}") for i in range(4))]
    for _ in range(draw(st.integers(1, 16))):
        refs = st.integers(0, len(table) - 1)
        several = st.lists(refs, min_size=2, max_size=4).map(tuple)
        table.append(
            draw(
                st.one_of(
                    several.map(And),
                    several.map(Or),
                    refs.map(Not),
                    st.builds(Recently, refs, st.sampled_from([0, 1 * MS, 60 * MS, 120 * MS])),
                )
            )
        )
    return tuple(table)


@st.composite
def observations(draw: st.DrawFn) -> tuple[ClientList, History]:
    """Return a list that observes the last guard and a few others, and when its modules are active."""
    guards = draw(tables())
    observed = draw(st.lists(st.integers(0, len(guards) - 1), max_size=3))
    roots = (("root", len(guards) - 1), *((f"g{ref}", ref) for ref in observed))
    return ClientList(guards=guards, actuators=(), observed=roots), draw(histories(modules=4))


def holds_alike(clients: ClientList, history: History) -> bool:
    """Return True if what is observed holds in the same frames before and after."""
    simpler = simplify(clients)
    before, after = GuardRun(clients.guards), GuardRun(simpler.guards)
    t_ns = 0
    for dt_ns, active in history:
        t_ns += dt_ns
        old, new = before.step(t_ns, active), after.step(t_ns, active)
        if [old[ref] for _, ref in clients.observed] != [new[ref] for _, ref in simpler.observed]:
            return False
    return True


@given(observations())
def test_guards_hold_in_the_same_frames(drawn: tuple[ClientList, History]) -> None:
    assert holds_alike(*drawn)


@pytest.mark.thorough
@given(observations())
@settings(max_examples=400)
def test_guards_hold_in_the_same_frames_of_many_tables(drawn: tuple[ClientList, History]) -> None:
    assert holds_alike(*drawn)


@given(guards=tables())
def test_everything_in_the_result_is_used_and_in_order(guards: tuple[Guard, ...]) -> None:
    simpler = simplify(ClientList(guards=guards, actuators=(), observed=(("root", len(guards) - 1),)))
    used = {ref for _, ref in simpler.observed}
    for at, guard in enumerate(simpler.guards):
        assert all(operand < at for operand in operands(guard))
        used |= set(operands(guard))
    assert used == set(range(len(simpler.guards)))
    assert len(set(simpler.guards)) == len(simpler.guards)


def test_the_ladder_is_its_lowest_module() -> None:
    compilation = compile_program(ladder(1_000))
    assert compilation.clients.guards == (ModuleActive("m0"),)


def test_shared_parts_are_not_copied_into_their_users() -> None:
    def parts(size: int) -> int:
        return sum(len(operands(guard)) for guard in compile_program(chain(size)).clients.guards)

    assert parts(4_000) <= 4.1 * parts(1_000)


def test_a_conjunction_of_conjunctions_is_flat_where_nothing_else_uses_it() -> None:
    nested: list[Guard] = [ModuleActive("m0"), ModuleActive("m1"), And((0, 1))]
    for i in range(2, 3_000):
        nested += [ModuleActive(f"m{i}"), And((len(nested) - 1, len(nested)))]
    simpler = simplify(ClientList(guards=tuple(nested), actuators=(), observed=(("all", len(nested) - 1),)))
    assert len(simpler.guards) == 3_001


def test_nothing_is_left_to_do_on_the_result() -> None:
    clients = compile_program(random_program(100, seed=3)).clients
    again = simplify(clients)
    assert len(again.guards) <= len(clients.guards)


def test_what_nothing_uses_is_left_out_the_first_module_too() -> None:
    client = Client(module="m1", priority=1, guard=1, exclusive=1)
    one = ClientList(guards=MODULES, actuators=(ActuatorClients(actuator="drive", clients=(client,)),))
    assert simplify(one).guards == (ModuleActive("m1"),)
