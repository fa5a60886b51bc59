"""Names of DServer's variables and semaphores: validation, and sorted lists for paging."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Iterable, Iterator
from itertools import islice, takewhile
from operator import itemgetter

from colony.runtime.protocol.calls import RefusedError


class SortedNames:
    """A sorted list of names. Mutable."""

    def __init__(self) -> None:
        self._names: list[str] = []

    def add(self, name: str) -> None:
        """Add a name that is not in the list."""
        insort(self._names, name)

    def update(self, names: Iterable[str]) -> None:
        """Add many names that are not in the list."""
        self._names = sorted([*self._names, *names])

    def discard(self, name: str) -> None:
        """Remove a name that is in the list."""
        del self._names[bisect_left(self._names, name)]

    def page(self, prefix: str, after: str, limit: int) -> tuple[str, ...]:
        """Return the first `limit` names that begin with `prefix` and sort after `after`."""
        begin = max(bisect_left(self._names, prefix), bisect_right(self._names, after))
        candidates = islice(self._names, begin, begin + limit)
        return tuple(takewhile(lambda name: name.startswith(prefix), candidates))

    def with_prefixes(self, prefixes: Iterable[str]) -> Iterator[str]:
        """Yield each name that begins with one of the prefixes, once, in order."""
        covered: str | None = None
        for prefix in sorted(prefixes):
            if covered is not None and prefix.startswith(covered):
                continue
            covered = prefix
            begin = bisect_left(self._names, prefix)
            end = bisect_right(self._names, prefix, lo=begin, key=itemgetter(slice(len(prefix))))
            yield from self._names[begin:end]


def validate_name(name: str) -> str:
    """Check that `name` is valid for a variable or semaphore (1 to 255 bytes of UTF-8), and return it.

    Raises:
        RefusedError: "arguments".
    """
    try:
        size = len(name.encode())
    except UnicodeEncodeError:
        raise RefusedError("arguments", f"DServer: the name {name[:20]!a} is not valid UTF-8") from None
    if not 1 <= size <= 255:
        shown = f"`{name[:20]}...`" if name else "``"
        raise RefusedError("arguments", f"DServer: the name {shown} has {size} bytes; expected 1 to 255")
    return name
