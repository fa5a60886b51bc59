"""The known names that are closest to an unknown name."""

from __future__ import annotations

from collections.abc import Iterable

_MAX_NAME_LENGTH = 64
"""Maximum number of characters of a name that are compared: external input may be of any length."""


def did_you_mean(
    name: str, known_names: Iterable[str], *, max_names: int = 1, cutoff: float = 0.6
) -> str | None:
    """Return a hint with the known names that are closest to `name`; None if none is close.

    Case is ignored. Names are close if their `difflib` ratio is `cutoff` or more.

    Example:
        >>> did_you_mean("rserver", ["PServer", "RServer"])
        'did you mean `RServer`?'
    """
    from difflib import get_close_matches  # slow to import, and needed only after an error

    folded: dict[str, list[str]] = {}
    for candidate in dict.fromkeys(known_names):
        folded.setdefault(candidate.casefold(), []).append(candidate)
    closest = get_close_matches(name[:_MAX_NAME_LENGTH].casefold(), folded, n=max_names, cutoff=cutoff)
    suggestions = [candidate for key in closest for candidate in folded[key]][:max_names]
    return (
        f"did you mean {' or '.join(f'`{candidate}`' for candidate in suggestions)}?" if suggestions else None
    )
