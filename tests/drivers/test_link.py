"""Links, and what is said of those that cannot be opened."""

from __future__ import annotations

import grp
import os
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from colony.drivers import link
from colony.drivers.create2 import create2
from colony.drivers.link import LinkError, open_link


def test_a_serial_port_is_read_and_written_without_waiting() -> None:
    master, slave = os.openpty()
    opened = open_link(os.ttyname(slave), 57_600)
    try:
        assert opened.read() == b""
        os.write(master, b"\x00\x03\x11\x13\r\n\xff")  # nothing is changed on the way
        assert _read(opened, 7) == b"\x00\x03\x11\x13\r\n\xff"
        assert opened.write(b"\n\x04") == 2
        assert os.read(master, 10) == b"\n\x04"
        while opened.write(bytes(4096)):
            pass  # until there is no room
    finally:
        opened.close()
        opened.close()
        os.close(slave)
        os.close(master)


def test_a_second_program_cannot_have_the_port() -> None:
    master, slave = os.openpty()
    first = open_link(os.ttyname(slave), 9600)
    try:
        with pytest.raises(LinkError, match=rf"is busy: process {os.getpid()} \(.*\) holds it; end it first"):
            open_link(os.ttyname(slave), 9600)
    finally:
        first.close()
        os.close(slave)
        os.close(master)


def test_a_simulator_over_tcp() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        opened = open_link(address, 0)
        peer, _ = server.accept()
        with peer:
            peer.send(b"abc")
            assert _read(opened, 3) == b"abc"
        with pytest.raises(ConnectionResetError, match="the other end is closed"):
            _read(opened, 1)
        opened.close()
    with pytest.raises(LinkError, match="does the simulator run, and listen on this port"):
        open_link(address, 0)


@pytest.mark.parametrize(
    "text", ["tcp:", "tcp:host", "tcp:host:", "tcp::80", "tcp:host:port", "tcp:host:99999"]
)
def test_a_wrong_address(text: str) -> None:
    with pytest.raises(LinkError, match="is no link: write tcp:HOST:PORT"):
        open_link(text, 0)


def test_what_no_host_can_be_called() -> None:
    with pytest.raises(LinkError, match=r"tcp:a\.\.b:80: .*: does the simulator run"):
        open_link("tcp:a..b:80", 0)


def test_a_rate_that_no_port_has() -> None:
    master, slave = os.openpty()
    try:
        with pytest.raises(LinkError, match="does not take these settings"):
            open_link(os.ttyname(slave), 1 << 31)
    finally:
        os.close(slave)
        os.close(master)


def test_what_is_no_port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "_existing", lambda: "Ports that exist: /dev/ttyUSB3")
    with pytest.raises(LinkError, match=r"there is no port .*/absent: is its cable plugged in\? Ports that"):
        open_link(str(tmp_path / "absent"), 0)
    with pytest.raises(LinkError, match=r"is a folder; expected a serial port\. Ports that exist"):
        open_link(str(tmp_path), 0)
    (tmp_path / "file").touch()
    with pytest.raises(LinkError, match="file is no device; expected a serial port"):
        open_link(str(tmp_path / "file"), 0)
    with pytest.raises(LinkError, match="/dev/null is no serial port, or does not take these settings"):
        open_link("/dev/null", 9600)


NOT_PERMITTED, BUSY = PermissionError(13, "Permission denied"), BlockingIOError(16, "Device or resource busy")


def test_a_port_that_is_not_permitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "stat", lambda path: SimpleNamespace(st_gid=0))
    assert link._why_not("/dev/ttyUSB0", NOT_PERMITTED) == (
        "/dev/ttyUSB0 may not be opened by this user: it belongs to no group that you can join: give it "
        "`dialout` by a rule of udev (docs/drivers.md)"
    )
    name = next(group for group in grp.getgrall() if group.gr_gid)
    monkeypatch.setattr(os, "stat", lambda path: SimpleNamespace(st_gid=name.gr_gid))
    assert link._why_not("/dev/ttyUSB0", NOT_PERMITTED) == (
        "/dev/ttyUSB0 may not be opened by this user: add yourself to the port's group, "
        f"`sudo usermod -aG {name.gr_name} $USER`, and log in again"
    )


def test_who_holds_a_busy_port(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "_holders", lambda path: iter(()))
    assert link._why_not("/dev/ttyUSB0", BUSY) == (
        "/dev/ttyUSB0 is busy: a process of another user holds it, which `sudo fuser -v /dev/ttyUSB0` names; "
        "end it first"
    )
    monkeypatch.setattr(link, "_holders", lambda path: iter(("process 7 (ModemManager)",)))
    assert link._why_not("/dev/ttyUSB0", BUSY) == (
        "/dev/ttyUSB0 is busy: process 7 (ModemManager) holds it; end it first; keep it away by a rule of "
        "udev (docs/drivers.md)"
    )


def _read(opened: link.ByteLink, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += opened.read()
    return data


@pytest.mark.parametrize(
    ("port", "baud", "message"),
    [
        (7, 0, "`port` is 7; expected text"),
        (True, 0, "`port` is True; expected text"),
        ("/dev/ttyUSB0", 57600.5, "`baud` is 57600.5; expected a whole number"),
        ("/dev/ttyUSB0", "fast", "`baud` is fast; expected a whole number"),
    ],
)
def test_options_that_are_no_port_or_no_rate(port: Any, baud: Any, message: str) -> None:
    with pytest.raises(TypeError, match=message):
        create2.base(port, baud=baud, frame_ns=1)
    with pytest.raises(TypeError, match=message):
        create2.fields(port, baud=baud)
