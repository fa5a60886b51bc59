"""Who opened a connection: this user, or another one."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from websockets.exceptions import InvalidStatus

from colony.watch.serving import is_of, own_users
from tests.watch.runs import greeted, recorded, served

NOBODY = 65534


@contextmanager
def another_user() -> Iterator[None]:
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


def test_a_connection_is_of_the_user_who_opened_it() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = server.getsockname()
        with socket.create_connection(address) as client:
            assert is_of({os.getuid()}, client.getsockname(), address)
            assert not is_of({os.getuid() + 1}, client.getsockname(), address)
        assert not is_of({os.getuid()}, ("127.0.0.1", 1), address)


def test_whose_connections_are_accepted() -> None:
    assert own_users({}, 1000) == {0, 1000}
    assert own_users({"SUDO_UID": "1001"}, 1000) == {0, 1000}
    assert own_users({"SUDO_UID": "1001"}, 0) == {0, 1001}
    assert own_users({"SUDO_UID": "x"}, 0) == {0}


def test_a_connection_cannot_claim_another_address() -> None:
    claim = {"X-Forwarded-For": "192.0.2.1:80"}  # would be refused there
    with recorded() as watched, served(watched) as server, greeted(server.host, **claim):
        pass


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, to be another user")
def test_a_connection_of_another_user_is_not() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = server.getsockname()
        with another_user():
            client = socket.create_connection(address)
        with client:
            assert is_of({NOBODY}, client.getsockname(), address)
            assert not is_of({0}, client.getsockname(), address)


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, to be another user")
def test_a_connection_of_another_user_gets_no_greeting() -> None:
    with recorded() as watched, served(watched) as server:
        with greeted(server.host):
            pass
        with another_user(), pytest.raises(InvalidStatus, match="403"), greeted(server.host):
            pass
