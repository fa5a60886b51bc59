from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.compile.backends.guard_text import GuardText
from colony.compile.clients import ActuatorClients, Client, ClientList
from colony.compile.guards import (
    Always,
    And,
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
from tests.compile.passes.network_semantics import GuardRun, History, histories
from tests.networks import chain, ladder, random_program

MS = 1_000_000
A, B, C = 0, 1, 2
MODULES = (ModuleActive("m0"), ModuleActive("m1"), ModuleActive("m2"))


def over(*guards: Guard) -> ClientList:
    """The last of the guards, after the modules m0, m1, m2, as the guard of a client."""
    table = (*MODULES, *guards)
    client = Client(module="m0", priority=1, guard=len(table) - 1, exclusive=len(table) - 1)
    return ClientList(guards=table, actuators=(ActuatorClients(actuator="drive", clients=(client,)),))


def simplified(*guards: Guard) -> str:
    simpler = simplify(over(*guards))
    return GuardText(simpler.guards).text(simpler.actuators[0].clients[0].guard)


@pytest.mark.parametrize(
    ("guards", "expected"),
    [
        ((Always(), And((A, 3))), "m0"),
        ((Never(), And((A, 3))), "never"),
        ((Never(), Or((A, 3))), "m0"),
        ((Always(), Or((A, 3))), "always"),
        ((And((A, A)),), "m0"),
        ((Not(A), Not(3)), "m0"),
        ((Not(A), And((A, 3))), "never"),
        ((Not(A), Or((A, 3))), "always"),
        ((And((A, B)), And((3, C))), "m0 and m1 and m2"),
        ((Or((A, B)), Or((3, C))), "m0 or m1 or m2"),
        ((Or((A, B)), Not(3), And((C, 4))), "not m0 and not m1 and m2"),
        ((Or((A, B)), And((A, 3))), "m0"),
        ((And((A, B)), Or((A, 3))), "m0"),
        ((Not(A), Or((3, B)), And((A, 4))), "m0 and m1"),
        ((Not(A), And((3, B)), Or((A, 4))), "m0 or m1"),
        ((And((A, B)), And((A, C)), Or((3, 4))), "m0 and (m1 or m2)"),
        ((Or((A, B)), Or((A, C)), And((3, 4))), "m0 or (m1 and m2)"),
        ((Always(), Recently(3, 5 * MS)), "always"),
        ((Never(), Recently(3, 5 * MS)), "never"),
        ((Recently(A, 0),), "m0"),
        ((Recently(A, 5 * MS), And((A, 3))), "m0"),
        ((Recently(A, 5 * MS), Or((A, 3))), "recently(m0, 5 ms)"),
        ((Recently(A, 5 * MS), Not(3), And((A, 4))), "never"),
        ((Recently(A, 5 * MS), Not(3), Not(A), And((4, 5))), "not recently(m0, 5 ms)"),
        ((Recently(A, 5 * MS), Not(A), Or((3, 4))), "always"),
    ],
)
def test_rules(guards: tuple[Guard, ...], expected: str) -> None:
    assert simplified(*guards) == expected


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


@given(guards=tables(), history=histories(modules=4), data=st.data())
@settings(max_examples=400)
def test_guards_hold_in_the_same_frames(
    guards: tuple[Guard, ...], history: History, data: st.DataObject
) -> None:
    observed = data.draw(st.lists(st.integers(0, len(guards) - 1), max_size=3))
    clients = ClientList(
        guards=guards,
        actuators=(),
        observed=(("root", len(guards) - 1), *((f"g{ref}", ref) for ref in observed)),
    )
    simpler = simplify(clients)
    before, after = GuardRun(clients.guards), GuardRun(simpler.guards)
    t_ns = 0
    for dt_ns, active in history:
        t_ns += dt_ns
        old, new = before.step(t_ns, active), after.step(t_ns, active)
        assert [old[ref] for _, ref in clients.observed] == [new[ref] for _, ref in simpler.observed]


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
    compiled = compile_program(ladder(1_000))
    assert compiled.clients.guards == (ModuleActive("m0"),)


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
    client = Client(module="m1", priority=1, guard=B, exclusive=B)
    one = ClientList(guards=MODULES, actuators=(ActuatorClients(actuator="drive", clients=(client,)),))
    assert simplify(one).guards == (ModuleActive("m1"),)
