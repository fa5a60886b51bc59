"""Files that a user's pages need, in the user's cache, readable by the user alone: the token, and a link."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress

from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.watch.security import new_token

_VALID = re.compile(r"[A-Za-z0-9_-]{32,64}")
_MAX_BYTES = 100

_LINK = """<!doctype html>
<meta charset="utf-8">
<title>colony watch</title>
<meta http-equiv="refresh" content="0; url={url}">
<a href="{url}">colony watch</a>
"""


def user_token(environment: Mapping[str, str]) -> str:
    """Return the user's token, so that a page outlives its server; a new one if none can be kept."""
    file = user_cache(environment, "watch-token")
    if file is None:
        return new_token()
    with suppress(OSError, UnicodeDecodeError):
        known = read_from_cache(file, _MAX_BYTES).decode().strip()
        if _VALID.fullmatch(known) and file.stat().st_mode & 0o077 == 0:
            return known
    token = new_token()
    with suppress(OSError):
        keep_in_cache(file, token.encode())
    return token


def page_link(environment: Mapping[str, str], url: str) -> str | None:
    """Return the address of a file that leads to a page; None if there can be no such file.

    A browser gets it as an argument. Other users see arguments, so the address of the page, which has the
    token, must not be one.
    """
    file = user_cache(environment, "watch.html")
    if file is None:
        return None
    try:
        keep_in_cache(file, _LINK.format(url=url).encode())
    except OSError:
        return None
    return file.as_uri()
