"""Who lives: whoever was heard of within the lease."""

from __future__ import annotations

from collections.abc import Iterable

LEASE_NS = 250_000_000


def lease(frame_ns: int) -> int:
    """A quarter of a second, but at least three frames."""
    return max(LEASE_NS, 3 * frame_ns)


class Liveness:
    """Remembers when each of `names` was heard of last. Mutable: those times."""

    def __init__(self, names: Iterable[str], *, lease_ns: int, now_ns: int) -> None:
        self._heard = dict.fromkeys(names, now_ns)
        self._lease_ns = lease_ns

    def heard(self, name: str, now_ns: int) -> None:
        """A sign of life; of a stranger it is ignored."""
        if name in self._heard:
            self._heard[name] = now_ns

    def missing(self, now_ns: int) -> tuple[str, ...]:
        """Those not heard of for longer than the lease, in the order in which they were named."""
        return tuple(n for n, at in self._heard.items() if now_ns - at > self._lease_ns)
