"""The params of a site in recordings: in the metadata of MCAP, in the lines with a keyframe of JSON lines."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, BinaryIO

import msgspec

from colony.files import bounded_lines
from colony.ir.site import Site
from colony.runtime.recordings.replay import LINE_BYTES, PARAMS, has_valid_checksum

_SEARCHED_LINES = 10_000
"""Maximum number of lines that are searched for a keyframe; every half second has one."""


class SiteMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The params of a site, as a recording has them.

    `proved` are the contracts that were proved with these values, None for a run that needed no proof.
    """

    file: str
    hash: str
    values: dict[str, str]
    proved: tuple[str, ...] | None = None


def site_message(site: Site) -> SiteMessage:
    """Return the params of a site for a recording."""
    return SiteMessage(file=site.file, hash=site.hash, values=dict(site.values), proved=site.proved)


def site_text(site: Site) -> str:
    """Return the params of a site as JSON."""
    return json.dumps(msgspec.to_builtins(site_message(site)))


def read_site(message: Any) -> Site | None:
    """Return the params of a site; None if the message is absent.

    Raises:
        msgspec.ValidationError: the message is malformed, or its hash is not that of its values.
    """
    if message is None:
        return None
    found = msgspec.convert(message, SiteMessage)
    values = tuple(sorted(found.values.items()))
    site = Site(file=found.file, values=values, proved=found.proved)
    if site.hash != found.hash:
        raise msgspec.ValidationError("the params do not have their hash")
    return site


def site_of_lines(file: BinaryIO) -> Site | None:
    """Return the params in the first undamaged line with a keyframe; None if there are none.

    Raises:
        OSError: the file cannot be read.
    """
    for number, line in enumerate(bounded_lines(file, LINE_BYTES)):
        if number >= _SEARCHED_LINES:
            break
        if b'"@keyframe"' not in line or not has_valid_checksum(line):
            continue
        try:
            row = json.loads(line)
            return read_site(row.get(PARAMS)) if isinstance(row, Mapping) else None
        except Exception:  # malformed in any way
            continue
    return None
