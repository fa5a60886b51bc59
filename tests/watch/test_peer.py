"""Whose a connection is: those of other users are refused."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus

from colony.watch import peer
from colony.watch.peer import CONNECTIONS, is_stranger, user_of
from tests.watch.runs import greeted, recorded, served

TABLE = """\
  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
   0: 0100007F:1D1A 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1000        0 1
   1: 0100007F:1D1A 0100007F:C001 01 00000000:00000000 00:00000000 00000000  1000        0 2
   2: 0100007F:C001 0100007F:1D1A 01 00000000:00000000 00:00000000 00000000  1001        0 3
   3: 0100007F:C002 0100007F:1D1B 01 00000000:00000000 00:00000000 00000000  1002        0 4
"""


def test_a_connection_has_the_user_of_its_peer() -> None:
    assert user_of(TABLE.splitlines(), 0xC001, 0x1D1A) == 1001
    assert user_of(TABLE.splitlines(), 0xC002, 0x1D1A) is None


@pytest.mark.skipif(not CONNECTIONS.exists(), reason="needs Linux")
def test_the_system_says_whose_a_connection_is() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as client, CONNECTIONS.open() as table:
            assert user_of(table, client.getsockname()[1], port) == os.geteuid()


@pytest.mark.parametrize("user", [0, 1001])
def test_strangers_are_others_than_the_server_and_root(
    user: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = tmp_path / "tcp"
    table.write_text(TABLE.replace("  1001 ", f"  {user} "))
    monkeypatch.setattr(peer, "CONNECTIONS", table)
    for own, expected in ((0, False), (user, False), (3000, user != 0)):
        monkeypatch.setattr(os, "geteuid", lambda own=own: own)
        assert is_stranger(0xC001, 0x1D1A) is expected


def test_a_stranger_gets_no_greeting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("colony.watch.greeting.is_stranger", lambda port, server_port: True)
    with (
        recorded() as watched,
        served(watched) as server,
        pytest.raises(InvalidStatus, match="403"),
        greeted(server.host),
    ):
        pass
