"""Who opened a connection: this user, or another one."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from websockets.exceptions import InvalidStatus

from colony.watch.peers import is_of_user
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
            assert is_of_user(client.getsockname(), address)
            assert os.getuid() == 0 or not is_of_user(client.getsockname(), address, user=os.getuid() + 1)
        assert not is_of_user(("127.0.0.1", 1), address)


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, to be another user")
def test_a_connection_of_another_user_is_not() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = server.getsockname()
        with another_user():
            client = socket.create_connection(address)
        with client:
            assert not is_of_user(client.getsockname(), address)
            assert is_of_user(client.getsockname(), address, user=NOBODY)


@pytest.mark.skipif(os.getuid() != 0, reason="needs root, to be another user")
def test_a_connection_of_another_user_gets_no_greeting() -> None:
    with recorded() as watched, served(watched) as server:
        with greeted(server.host):
            pass
        with another_user(), pytest.raises(InvalidStatus, match="403"), greeted(server.host):
            pass
