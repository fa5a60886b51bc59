"""Limits on the state of a server, and reports of the limits that were reached."""

from __future__ import annotations


class Bound:
    """A limit. Stateful: remembers whether a request was refused because of it.

    Args:
        what: the display name of the counted things.
        limit: the maximum count.
        in_bytes: True if the count is in bytes.
    """

    def __init__(self, what: str, limit: int, *, in_bytes: bool = False) -> None:
        self.limit = limit
        self._what = what
        self._in_bytes = in_bytes
        self._was_reached = False

    def allows(self, count: int) -> bool:
        """Return True if `count` is allowed; if not, remember that the limit was reached."""
        self._was_reached |= count > self.limit
        return count <= self.limit

    def limit_messages(self, count: int) -> tuple[str, ...]:
        """Return a message if `count` reaches the limit or a request was ever refused; else nothing."""
        if count < self.limit and not self._was_reached:
            return ()
        refused = ", and there was no room for more" if self._was_reached else ""
        return (f"{self._what}: {self._format(count)} of {self._format(self.limit)} are used{refused}",)

    def _format(self, count: int) -> str:
        if not self._in_bytes:
            return str(count)
        return f"{count / (1 << 20):.1f} MiB" if count >= 1 << 20 else f"{count / 1024:.1f} KiB"
