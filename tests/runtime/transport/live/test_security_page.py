"""docs/security.md: its commands make keys that work, and its files are read."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from colony.runtime.kit.connection import Session
from colony.runtime.protocol.codec import MAX_MESSAGE_BYTES
from colony.runtime.transport.live import limits
from colony.runtime.transport.live.gateway import MAX_GROWTH_BYTES, open_gateway
from colony.runtime.transport.live.security import PERMISSIONS, read_credentials, read_security
from tests.runtime.kit.stage import BATTERY, battery_thread, charge, level
from tests.runtime.transport.live.certificates import free_port
from tests.runtime.transport.live.stage import ROBOT, robot_address, run_directory, running
from tests.waiting import until

PAGE = (Path(__file__).parents[4] / "docs" / "security.md").read_text(encoding="utf-8")
FENCES = re.findall(r"^```([^\n]*)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl")
def test_the_keys_that_the_page_makes_open_the_gateway_that_it_describes(tmp_path: Path) -> None:
    for info, text in FENCES:
        if info == "sh":
            subprocess.run(["sh", "-e", "-c", text], cwd=tmp_path, check=True, capture_output=True)
        elif info.startswith("toml "):
            (tmp_path / info.split()[1]).write_text(text)
    security = read_security(tmp_path / "users.toml")
    assert security.users == {"ada": ("read", "command"), "guard": ("stop",)}
    endpoint, login = f"tls/localhost:{free_port()}", read_credentials(tmp_path / "login.toml")
    with (
        run_directory() as environment,
        battery_thread(environment),
        running(open_gateway(robot_address(environment), endpoint, security)),
        Session.open(ROBOT, gateway=endpoint, credentials=login) as session,
    ):
        until(lambda: BATTERY in session.servers(), "the gateway found the server")
        with session.connect(BATTERY) as battery:
            assert battery.do(level()) == 0.5
            assert battery.do(charge(1.0)) == pytest.approx(0.6)


@pytest.mark.skipif(shutil.which("nft") is None or os.geteuid() != 0, reason="needs nftables, and root")
def test_the_rules_of_the_firewall_are_valid(tmp_path: Path) -> None:
    rules = tmp_path / "gateway.nft"
    rules.write_text(next(text for info, text in FENCES if info == "nft gateway.nft"))
    checked = subprocess.run(["nft", "-c", "-f", str(rules)], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stderr


def test_the_limits_on_the_page_are_those_of_the_gateway() -> None:
    assert f"| TLS handshake | {limits.HANDSHAKE_MS // 1000} s |" in PAGE
    assert f"{limits.LOGIN_MS // 1000} s, {limits.MAX_PENDING_LOGINS} at a time" in PAGE
    assert f"| {limits.MAX_SESSIONS} | the login is refused" in PAGE
    assert f"| {limits.SMALL_MESSAGE_BYTES // 1024} KiB | dropped" in PAGE
    assert f"| {limits.MEDIUM_MESSAGE_BYTES // 1024} KiB | dropped" in PAGE
    assert f"| {MAX_MESSAGE_BYTES >> 20} MiB and {limits.SMALL_MESSAGE_BYTES // 1024} KiB | dropped" in PAGE


def test_the_memory_of_the_gateway_is_that_of_the_code() -> None:
    assert f"memory has grown by {MAX_GROWTH_BYTES >> 20} MiB" in PAGE


def test_the_program_on_the_page_is_one() -> None:
    for info, text in FENCES:
        if info == "python":
            compile(text, "security.md", "exec")


def test_every_permission_is_explained() -> None:
    explained = re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)
    assert set(explained) - {"may"} == set(PERMISSIONS)
