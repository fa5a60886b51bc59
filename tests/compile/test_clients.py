"""Clients as data, and what is equal among them."""

from __future__ import annotations

from dataclasses import replace

from colony.compile.guards import Client, ClientList

CLIENT = Client(module="m", priority=1, guard=0, exclusive=0)


def test_how_many_ways_a_command_has_makes_no_other_client() -> None:
    assert CLIENT.has_several_paths is False
    assert replace(CLIENT, has_several_paths=True) == CLIENT
    assert replace(CLIENT, guard=1) != CLIENT


def test_what_memory_calls_time_constants_makes_no_other_list() -> None:
    clients = ClientList(guards=(), actuators=())
    assert (clients.observed, clients.windows) == ((), ())
    assert replace(clients, windows=(("w", 0),)) == clients
    assert replace(clients, observed=(("w", 0),)) != clients
