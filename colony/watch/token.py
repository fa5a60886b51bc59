"""The token of a user's pages, kept in the user's cache, so that a page outlives its server."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from colony.files import read_file
from colony.watch.security import new_token

_VALID = re.compile(r"[A-Za-z0-9_-]{32,64}")
_MAX_BYTES = 100


def user_token(environment: Mapping[str, str]) -> str:
    """Return the user's token, which only the user can read; a new one if none can be kept."""
    file = _token_file(environment)
    if file is None:
        return new_token()
    with suppress(OSError, UnicodeDecodeError):
        known = read_file(file, _MAX_BYTES).decode().strip()
        if _VALID.fullmatch(known) and file.stat().st_mode & 0o077 == 0:
            return known
    token = new_token()
    with suppress(OSError):
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        file.unlink(missing_ok=True)
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with open(descriptor, "w", encoding="ascii") as written:
            written.write(token)
    return token


def _token_file(environment: Mapping[str, str]) -> Path | None:
    """Return the file of the token: in `$XDG_CACHE_HOME` or `~/.cache`, None if there is neither."""
    home = environment.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(home):
        user = environment.get("HOME", "")
        if not os.path.isabs(user):
            return None
        home = os.path.join(user, ".cache")
    return Path(home) / "colony" / "watch-token"
