"""Limits of a server's state, and sentences for users about the limits that were reached."""

from __future__ import annotations


class Bound:
    """A limit. Mutable: whether a request was refused because of it.

    Args:
        what: the kind of things counted, for users.
        most: the largest count that is allowed.
        in_bytes: True if the count is in bytes.
    """

    def __init__(self, what: str, most: int, *, in_bytes: bool = False) -> None:
        self.most = most
        self._what = what
        self._in_bytes = in_bytes
        self._was_reached = False

    def allows(self, count: int) -> bool:
        """Return True if `count` is allowed; if not, remember that the limit was reached."""
        self._was_reached |= count > self.most
        return count <= self.most

    def reached(self, count: int) -> tuple[str, ...]:
        """Return a sentence if `count` reaches the limit, or a request was refused before; else nothing."""
        if count < self.most and not self._was_reached:
            return ()
        refused = ", and there was no room for more" if self._was_reached else ""
        return (f"{self._what}: {self._shown(count)} of {self._shown(self.most)} are used{refused}",)

    def _shown(self, count: int) -> str:
        if not self._in_bytes:
            return str(count)
        return f"{count / (1 << 20):.1f} MiB" if count >= 1 << 20 else f"{count / 1024:.1f} KiB"
