"""What robots, servers, users and connections may be called: a name is part of keys and of file names."""

from __future__ import annotations

import os
import pwd
import re

LONGEST = 64

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*", re.ASCII)
_USER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.@-]*", re.ASCII)


def check_name(what: str, name: str) -> str:
    """`name`, where it can be that of a `what` (a robot, a server).

    Raises:
        ValueError: it cannot.
    """
    return _check(what, name, _NAME, "letters, digits, `_`, `-` and `.`")


def check_user(name: str) -> str:
    """`name`, where it can be that of a user; a certificate's common name often has an `@`.

    Raises:
        ValueError: it cannot.
    """
    return _check("user", name, _USER, "letters, digits, `_`, `-`, `.` and `@`")


def _check(what: str, name: str, pattern: re.Pattern[str], expected: str) -> str:
    if len(name) > LONGEST or pattern.fullmatch(name) is None:
        raise ValueError(
            f"`{name}` cannot be the name of a {what}: expected 1 to {LONGEST} characters, "
            f"{expected}, beginning with a letter or digit"
        )
    return name


def local_user() -> str:
    """The name of this process's user, as far as it can be that of a user of a robot."""
    number = os.getuid()
    try:
        return check_user(pwd.getpwuid(number).pw_name)
    except (KeyError, ValueError):
        return f"uid{number}"
