from __future__ import annotations

import pytest

from colony.compile.backends.guard_text import GuardText
from colony.compile.clients import Client, ClientList
from colony.compile.passes.elaborate import elaborate
from colony.compile.passes.eliminate_inhibition import eliminate_inhibition
from colony.compile.passes.forward_traversal import forward_traversal
from tests.networks import chain, ladder
from tests.wiring import program


def traversed(text: str) -> ClientList:
    return forward_traversal(eliminate_inhibition(elaborate(program(text))))


def clients(text: str) -> dict[str, Client]:
    return {client.module: client for client in traversed(text).actuators[0].clients}


def order_of_visit(text: str) -> str:
    return "-".join(client.module for client in reversed(traversed(text).actuators[0].clients))


@pytest.mark.parametrize(
    "wiring",
    [
        "(A suppresses B) suppresses (C suppresses D)",
        "A suppresses (B suppresses (C suppresses D))",
        "((A suppresses B) suppresses C) suppresses D",
        "A suppresses B suppresses C suppresses D",
    ],
)
def test_the_networks_of_figures_4_14_and_4_15(wiring: str) -> None:
    assert order_of_visit(f"drive = {wiring}") == "D-C-B-A"


def test_priorities_are_n_down_to_1() -> None:
    one = traversed("drive = (A suppresses B) suppresses C").actuators[0]
    assert [(client.priority, client.module) for client in one.clients] == [(3, "A"), (2, "B"), (1, "C")]


def test_a_module_alone_has_priority_1() -> None:
    guards = traversed("drive = A")
    (client,) = guards.actuators[0].clients
    assert client.priority == 1
    assert GuardText(guards.guards).text(client.guard, "A") == "P"


def test_what_only_inhibits_is_no_client() -> None:
    assert order_of_visit("drive = docked inhibits (A suppresses B)") == "B-A"


def test_the_guard_of_the_thesis_and_the_exclusive_one() -> None:
    given = traversed("drive = A suppresses (X inhibits B)")
    text = GuardText(given.guards)
    a, b = given.actuators[0].clients
    assert (text.text(a.guard, "A"), text.text(a.exclusive, "A")) == ("P", "P")
    assert (text.text(b.guard, "B"), text.text(b.exclusive, "B")) == ("P and not X", "P and not A and not X")


def test_a_shared_module_is_one_client_at_its_last_visit() -> None:
    # forward: B, then A, then C, then B again
    given = clients("drive = (X inhibits (B suppresses C)) suppresses (A suppresses B)")
    assert {name: client.priority for name, client in given.items()} == {"B": 3, "C": 2, "A": 1}
    assert given["B"].guard == given["B"].exclusive
    assert given["C"].guard != given["C"].exclusive


def test_all_below_a_shared_wire_have_the_exclusive_guard() -> None:
    given = clients("w = A suppresses B\ndrive = (X inhibits w) suppresses (C suppresses w)")
    for module in "AB":
        assert given[module].guard == given[module].exclusive


def test_each_actuator_has_clients_of_its_own() -> None:
    given = traversed("drive = A suppresses B\narm = (A inhibits C) suppresses D")
    assert [(one.actuator, [c.module for c in one.clients]) for one in given.actuators] == [
        ("drive", ["A", "B"]),
        ("arm", ["C", "D"]),
    ]


@pytest.mark.parametrize("make", [chain, ladder])
def test_the_result_is_linear_in_the_network(make) -> None:
    def guards(size: int) -> int:
        return len(forward_traversal(eliminate_inhibition(elaborate(make(size)))).guards)

    assert guards(4_000) <= 4.1 * guards(1_000)
