"""Valid names of robots, servers, users and connections: a name is part of keys and of file names."""

from __future__ import annotations

import os
import pwd
import re

MAX_NAME_LENGTH = 64

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*", re.ASCII)
_USER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]*", re.ASCII)


def check_name(kind: str, name: str) -> str:
    """Return `name` if it is a valid name of a `kind` ("robot", "server").

    Raises:
        ValueError: the name is invalid.
    """
    return _check(kind, name, _NAME, "letters, digits, `_`, `-` and `.`")


def check_user(name: str) -> str:
    """Return `name` if it is a valid user name; a certificate's common name often contains an `@`.

    Raises:
        ValueError: the name is invalid.
    """
    return _check("user", name, _USER, "letters, digits, `_`, `-`, `.` and `@`")


def _check(kind: str, name: str, pattern: re.Pattern[str], expected: str) -> str:
    if len(name) > MAX_NAME_LENGTH or pattern.fullmatch(name) is None:
        raise ValueError(
            f"`{name}` cannot be the name of a {kind}: expected 1 to {MAX_NAME_LENGTH} characters, "
            f"{expected}, beginning with a letter or digit"
        )
    return name


def local_user() -> str:
    """Return the name of this process's user, or `uid<number>` if that is not a valid user name."""
    number = os.getuid()
    try:
        return check_user(pwd.getpwuid(number).pw_name)
    except (KeyError, ValueError):
        return f"uid{number}"
