"""The rights of users on other machines: the table of users, a TOML file.

    [gateway]
    certificate = "gateway.pem"      # paths are relative to this file
    key = "gateway.key"
    authority = "authority.pem"      # the authority that signed the users' certificates

    [users.ada]
    may = ["read", "command"]

A user is identified by the common name of a certificate that the authority signed. `read` permits reading;
`stop` emergency stops; `command` changes, motion and emergency stops; `run` all of these, and running
programs on the robot, that is, sending messages as their clients; `unlimited` what `command` permits, and
motion beyond the limits of the program. `run` includes that in effect, as the bounds of connections come
from a client of the program.
"""

from __future__ import annotations

import ssl
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from colony.files import read_file, reason
from colony.runtime.protocol.messages import Right
from colony.runtime.transport.live import keys
from colony.runtime.transport.live.robot_address import Credentials
from colony.runtime.transport.live.run_directory import SecurityError, check_user, local_user
from colony.text.toml_places import tables_of

# --- security ------------------------------------------------------------------------------------------


Permission = Literal["read", "command", "stop", "run", "unlimited"]
PERMISSIONS: tuple[Permission, ...] = get_args(Permission)

IMPLIED: Mapping[Permission, tuple[Right, ...]] = {
    "read": ("read",),
    "stop": ("stop",),
    "command": ("command", "stop"),
    "run": ("read", "command", "stop"),
    "unlimited": ("command", "stop", "unlimited"),
}
"""The rights that each permission grants."""

_FILES = ("certificate", "key", "authority")

FILE_BYTES = 1024 * 1024
"""Size limit in bytes of a table of users, a certificate or a key."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Security:
    """The security settings of a gateway: its certificate and key, its users' authority, and the users."""

    certificate: Path
    key: Path
    authority: Path
    users: Mapping[str, tuple[Permission, ...]]


def rights(permissions: tuple[Permission, ...]) -> tuple[Right, ...]:
    """Return the rights that permissions grant, `read` first."""
    granted = {right for permission in permissions for right in IMPLIED[permission]}
    order: tuple[Right, ...] = ("read", "command", "stop", "unlimited")
    return tuple(right for right in order if right in granted)


def read_security(path: Path) -> Security:
    """Read the table of users, and check that its certificates can be used.

    Raises:
        SecurityError: the files are invalid; the message lists every problem and where it is.
    """
    table = _read_toml(path)
    problems = list(_unknown_entries(table, ("gateway", "users"), ""))
    files = _files(path, table.get("gateway"), "gateway", problems)
    users = _users(table.get("users"), problems)
    if not problems:
        problems.extend(_certificate_problems(files["certificate"], files["key"], files["authority"]))
    _raise_if_any(path, problems)
    return Security(users=users, **files)


def read_credentials(path: Path) -> Credentials:
    """Read a client's credentials: a TOML file with `user`, `certificate`, `key` and `authority`.

    Raises:
        SecurityError: the files are invalid; the message lists every problem and where it is.
    """
    table = _read_toml(path)
    problems: list[str] = []
    user = table.pop("user", None)
    try:
        if not isinstance(user, str):
            raise ValueError("expected the name of the user, as in the certificate")
        check_user(user)
    except ValueError as problem:
        problems.append(f"user: {problem}")
    files = _files(path, table, "", problems)
    if not problems:
        problems.extend(_certificate_problems(files["certificate"], files["key"], files["authority"]))
    _raise_if_any(path, problems)
    return Credentials(user=str(user), **files)


def check_credentials(credentials: Credentials) -> None:
    """Check that the certificates and the key can be used.

    Raises:
        SecurityError: they cannot.
    """
    problems = list(_certificate_problems(credentials.certificate, credentials.key, credentials.authority))
    if problems:
        raise SecurityError("\n".join(problems))


def _raise_if_any(path: Path, problems: list[str]) -> None:
    if problems:
        raise SecurityError("\n".join(f"{path}: {problem}" for problem in problems))


def _read_toml(path: Path) -> dict[str, object]:
    try:
        return tables_of(read_file(path, FILE_BYTES).decode("utf-8"))
    except OSError as problem:
        raise SecurityError(f"{path}: {reason(problem)}") from None
    except ValueError as problem:  # not UTF-8, or not TOML
        raise SecurityError(f"{path}: {problem}") from None


def _unknown_entries(table: Mapping[str, object], expected: tuple[str, ...], prefix: str) -> Iterator[str]:
    for name in table:
        if name not in expected:
            yield f"{prefix}{name}: unknown; expected {', '.join(expected)}"


def _files(path: Path, table: object, where: str, problems: list[str]) -> dict[str, Path]:
    """Return the three paths of a table; report missing ones in `problems`."""
    prefix = f"{where}." if where else ""
    if not isinstance(table, dict):
        problems.append(f"{where}: missing; expected a table with {', '.join(_FILES)}")
        return {}
    problems.extend(_unknown_entries(table, _FILES, prefix))
    files: dict[str, Path] = {}
    for name in _FILES:
        value = table.get(name)
        if isinstance(value, str):
            files[name] = path.absolute().parent / value
        else:
            problems.append(f"{prefix}{name}: expected the path of a PEM file")
    return files


def _users(table: object, problems: list[str]) -> dict[str, tuple[Permission, ...]]:
    if not isinstance(table, dict) or not table:
        problems.append("users: missing; expected at least one, as `[users.ada]` with `may = [...]`")
        return {}
    users: dict[str, tuple[Permission, ...]] = {}
    for name, entry in table.items():
        where = f"users.{name}"
        try:
            check_user(name)
        except ValueError as problem:
            problems.append(f"{where}: {problem}")
        if name == local_user():
            problems.append(f"{where}: the robot's own programs have this name; expected another one")
        if not isinstance(entry, dict) or not isinstance(entry.get("may"), list) or not entry["may"]:
            problems.append(f"{where}: expected `may = [...]` with some of {', '.join(PERMISSIONS)}")
            continue
        problems.extend(_unknown_entries(entry, ("may",), f"{where}."))
        users[name] = tuple(p for p in PERMISSIONS if p in entry["may"])
        for index, permission in enumerate(entry["may"]):
            if permission not in PERMISSIONS:
                expected = ", ".join(PERMISSIONS)
                problems.append(f"{where}.may[{index}]: found {permission!r}; expected one of {expected}")
    return users


def _read_error(file: Path) -> str | None:
    """Return the reason why a file cannot be read, or None."""
    try:
        read_file(file, FILE_BYTES)
    except FileNotFoundError:
        return "there is no such file"
    except OSError as problem:
        return reason(problem)
    return None


def _certificate_problems(certificate: Path, key: Path, authority: Path) -> Iterator[str]:
    """Yield the reasons why certificates and key cannot be used."""
    unreadable = [f"{file}: {why}" for file in (certificate, key, authority) if (why := _read_error(file))]
    if unreadable:
        yield from unreadable
        return
    if key.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        yield f"{key}: others may read this private key: `chmod 600 {key}`"
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        context.load_cert_chain(certificate, key, password="")
    except (ssl.SSLError, OSError) as problem:
        yield f"{certificate}, {key}: not a certificate and its key in PEM without a password: {problem}"
    try:
        context.load_verify_locations(authority)
    except (ssl.SSLError, OSError) as problem:
        yield f"{authority}: not a certificate in PEM: {problem}"


# --- access --------------------------------------------------------------------------------------------
#
# The table of users as zenoh access control: the keys that each user may publish and subscribe to.
#
# Everything that is not allowed here is denied. The keys of replies, and of all messages from users,
# contain the user's name. These rules require it to equal the common name of the certificate, so that no
# user can send messages, or receive replies, under another name.


ALL_MESSAGE_KINDS = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)

Rule = dict[str, Any]

_READER_SUBSCRIPTIONS = ("Clock/ticks", "*/frames", "*/activity/*/frames", "verdicts")
# not `**`, which matches any depth, and so the calls of other users
_READER_PUBLICATIONS = ("*/fetches/{user}",)
_RUNNER_SUBSCRIPTIONS = ("*/recalled/**", "*/repeats/*")
_RUNNER_PUBLICATIONS = (
    "*/requests/{user}",
    "*/announcements/{user}",
    "*/checkpoints/{user}",
    "Clock/ready/{user}",
    "Clock/restarts/{user}",
)


def access_control(robot: str, security: Security) -> dict[str, Any]:
    """Return a gateway's setting `access_control`."""
    rules: list[Rule] = [_allow("here", ALL_MESSAGE_KINDS, ("ingress", "egress"), ("**",))]
    subjects: list[dict[str, Any]] = [{"id": "here", "link_protocols": ["unixsock-stream"]}]
    policies = [{"rules": ["here"], "subjects": ["here"]}]
    for number, (user, permissions) in enumerate(security.users.items()):
        subject = f"user-{number}"
        user_rules = list(_rules(subject, robot, user, permissions))
        rules.extend(user_rules)
        subjects.append({"id": subject, "cert_common_names": [user], "link_protocols": ["tls"]})
        policies.append({"rules": [rule["id"] for rule in user_rules], "subjects": [subject]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules(subject: str, robot: str, user: str, permissions: tuple[Permission, ...]) -> Iterator[Rule]:
    """Yield the rules of one user.

    Users must also see the subscribers to their keys, and receive the messages that they subscribe to.
    """
    prefix, allowed = keys.prefix(robot), rights(permissions)
    published = [f"*/call/{right}/{user}/*" for right in allowed]
    subscribed = [f"*/reply/{user}/*"]
    if "read" in allowed:
        published += [key.format(user=user) for key in _READER_PUBLICATIONS]
        subscribed += _READER_SUBSCRIPTIONS
    if "run" in permissions:
        published += [key.format(user=user) for key in _RUNNER_PUBLICATIONS]
        subscribed += _RUNNER_SUBSCRIPTIONS
        # liveliness tokens of clients; a server's token has a single part
        tokens = (keys.liveliness_key(robot, "*/*"), keys.liveliness_key(robot, "*/*/*"))
        yield _allow(f"{subject}-tokens", ("liveliness_token",), ("ingress",), tokens)
    yield _allow(f"{subject}-publishes", ("put",), ("ingress",), [prefix + key for key in published])
    yield _allow(
        f"{subject}-subscribes", ("declare_subscriber",), ("ingress",), [prefix + key for key in subscribed]
    )
    yield _allow(f"{subject}-receives", ("put",), ("egress",), [prefix + key for key in subscribed])
    declarations = ("declare_subscriber", "liveliness_token")
    yield _allow(f"{subject}-learns", declarations, ("egress",), (f"{prefix}**",))
    queries = ("liveliness_query", "declare_liveliness_subscriber")
    yield _allow(f"{subject}-queries", queries, ("ingress",), (keys.liveliness_key(robot, "**"),))


def _allow(
    name: str, messages: tuple[str, ...], flows: tuple[str, ...], key_exprs: tuple[str, ...] | list[str]
) -> Rule:
    return {
        "id": name,
        "permission": "allow",
        "messages": list(messages),
        "flows": list(flows),
        "key_exprs": list(key_exprs),
    }
