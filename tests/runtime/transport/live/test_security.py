"""The table of users: what it says, and what is wrong with it, all at once and each with its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.runtime.transport.live.configuration import Endpoint, parse_endpoint
from colony.runtime.transport.live.run_directory import SecurityError, local_user
from colony.runtime.transport.live.security import (
    PERMISSIONS,
    access_control,
    check_credentials,
    read_credentials,
    read_security,
    rights,
)
from tests.runtime.transport.live.certificates import Authority


def test_a_table_of_users(tmp_path: Path) -> None:
    authority = Authority(tmp_path)
    table = authority.table({"ada": ("command", "read"), "bob@lab": ("stop",)})
    security = read_security(table)
    assert security.users == {"ada": ("read", "command"), "bob@lab": ("stop",)}
    assert security.certificate == tmp_path / "gateway.pem"
    assert security.authority == authority.path


@pytest.mark.parametrize(
    ("permissions", "expected"),
    [
        (("read",), ("read",)),
        (("stop",), ("stop",)),
        (("command",), ("command", "stop")),
        (("run",), ("read", "command", "stop")),
        (("unlimited",), ("command", "stop", "unlimited")),
        (PERMISSIONS, ("read", "command", "stop", "unlimited")),
    ],
)
def test_rights_that_come_with_permissions(permissions: tuple[str, ...], expected: tuple[str, ...]) -> None:
    assert rights(permissions) == expected  # type: ignore[arg-type]


def test_all_that_is_wrong_is_told_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "users.toml"
    path.write_text(
        """
        shade = "red"
        [gateway]
        certificate = "gateway.pem"
        key = 3
        password = "x"
        [users.ada]
        may = ["read", "fly", 7]
        shell = "bash"
        [users."a/b"]
        may = ["read"]
        [users.bob]
        may = "read"
        """
    )
    with pytest.raises(SecurityError) as caught:
        read_security(path)
    assert str(caught.value).splitlines() == [
        f"{path}: shade: unknown; expected gateway, users",
        f"{path}: gateway.password: unknown; expected certificate, key, authority",
        f"{path}: gateway.key: expected the path of a PEM file",
        f"{path}: gateway.authority: expected the path of a PEM file",
        f"{path}: users.ada.shell: unknown; expected may",
        f"{path}: users.ada.may[1]: found 'fly'; expected one of read, command, stop, run, unlimited",
        f"{path}: users.ada.may[2]: found 7; expected one of read, command, stop, run, unlimited",
        f"{path}: users.a/b: `a/b` cannot be the name of a user: expected 1 to 64 characters, letters, "
        "digits, `_`, `-`, `.` and `@`, beginning with a letter or digit",
        f"{path}: users.bob: expected `may = [...]` with some of read, command, stop, run, unlimited",
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[gateway", r"users.toml: Expected ']' .*\(at "),
        ("", r"users.toml: gateway: missing; expected a table with certificate, key, authority\n"),
        ("", r"users: missing; expected at least one"),
    ],
)
def test_what_is_no_table_of_users(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "users.toml"
    path.write_text(text)
    with pytest.raises(SecurityError, match=says):
        read_security(path)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(SecurityError, match="No such file"):
        read_security(tmp_path / "users.toml")


def test_certificates_that_cannot_be_used(tmp_path: Path) -> None:
    authority = Authority(tmp_path)
    table = authority.table({"ada": ("read",)})
    (tmp_path / "gateway.key").chmod(0o640)
    with pytest.raises(SecurityError, match=r"others may read this private key: `chmod 600 .*gateway.key`"):
        read_security(table)
    ada, bob = authority.user("ada"), authority.user("bob")
    with pytest.raises(SecurityError, match="not a certificate and its key"):
        check_credentials(
            type(ada)(user="ada", certificate=ada.certificate, key=bob.key, authority=ada.authority)
        )
    authority.path.write_text("nothing")
    with pytest.raises(SecurityError, match=r"authority.pem: not a certificate in PEM"):
        check_credentials(ada)
    (tmp_path / "gateway.pem").unlink()
    with pytest.raises(SecurityError, match=r"gateway.pem: there is no such file"):
        read_security(table)


def test_credentials_of_a_user(tmp_path: Path) -> None:
    ada = Authority(tmp_path).user("ada")
    path = tmp_path / "login.toml"
    path.write_text('user="ada"\ncertificate="ada.pem"\nkey="ada.key"\nauthority="authority.pem"\n')
    assert read_credentials(path) == ada
    path.write_text('user="@"\ncertificate="ada.pem"\nkeys="ada.key"\n')
    with pytest.raises(SecurityError) as caught:
        read_credentials(path)
    assert [line.split(": ")[1] for line in str(caught.value).splitlines()] == [
        "user",
        "keys",
        "key",
        "authority",
    ]


def test_addresses_of_gateways() -> None:
    assert parse_endpoint("tls/robot.lab:7447") == Endpoint("robot.lab", 7447)
    assert parse_endpoint("tls/[::1]:7447") == Endpoint("::1", 7447)
    with pytest.raises(SecurityError, match="is unencrypted"):
        parse_endpoint("tcp/robot.lab:7447")
    for text in ("robot.lab:7447", "tls/robot.lab", "tls/:7447", "tls/robot.lab:70000", "tls/a b:1", ""):
        with pytest.raises(SecurityError, match="expected tls/HOST:PORT"):
            parse_endpoint(text)


def test_nothing_is_allowed_that_is_not_in_the_table(tmp_path: Path) -> None:
    users = {"ada": ("read",), "bob": ("stop",), "eva": ("run",), "zoe": ("unlimited",)}
    security = read_security(Authority(tmp_path).table(users))
    made = access_control("rome", security)
    assert made["enabled"] is True
    assert made["default_permission"] == "deny"
    assert {rule["permission"] for rule in made["rules"]} == {"allow"}
    sends = {rule["id"]: rule["key_exprs"] for rule in made["rules"] if rule["id"].endswith("publishes")}
    assert sends["user-0-publishes"] == ["colony/rome/*/call/read/ada/*", "colony/rome/*/fetches/ada"]
    assert sends["user-1-publishes"] == ["colony/rome/*/call/stop/bob/*"]
    assert "colony/rome/*/requests/eva" in sends["user-2-publishes"]
    assert "colony/rome/*/call/unlimited/eva/*" not in sends["user-2-publishes"]
    assert sends["user-3-publishes"] == [
        f"colony/rome/*/call/{right}/zoe/*" for right in ("command", "stop", "unlimited")
    ]


def test_no_user_goes_by_the_name_of_the_robots_own_programs(tmp_path: Path) -> None:
    """Servers do not count these."""
    table = Authority(tmp_path).table({local_user(): ("read",)})
    with pytest.raises(SecurityError, match=f"users.{local_user()}: the robot's own programs have this name"):
        read_security(table)
