"""The known names that are closest to an unknown name."""

from __future__ import annotations

from collections.abc import Iterable

_MAX_NAME_LENGTH = 64
"""Maximum number of characters of a name that are compared: external input may be of any length."""


def did_you_mean(name: str, known: Iterable[str], *, most: int = 1, cutoff: float = 0.6) -> str | None:
    """Return a hint with the known names that are closest to `name`; None where none is close.

    Case is ignored. Names are close if their `difflib` ratio is `cutoff` or more.

    Example:
        >>> did_you_mean("rserver", ["PServer", "RServer"])
        'did you mean `RServer`?'
    """
    from difflib import get_close_matches  # it is needed only where something is wrong

    folded: dict[str, list[str]] = {}
    for one in dict.fromkeys(known):
        folded.setdefault(one.casefold(), []).append(one)
    closest = get_close_matches(name[:_MAX_NAME_LENGTH].casefold(), folded, n=most, cutoff=cutoff)
    found = [one for key in closest for one in folded[key]][:most]
    return f"did you mean {' or '.join(f'`{one}`' for one in found)}?" if found else None
