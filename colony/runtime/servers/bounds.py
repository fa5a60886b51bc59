"""Limits of what a server keeps, and sentences for people about the limits that were reached."""

from __future__ import annotations


class Bound:
    """A limit. Mutable: whether something was refused because of it.

    Args:
        what: what is counted, for people.
        most: the largest count that is allowed.
        in_bytes: whether bytes are counted.
    """

    def __init__(self, what: str, most: int, *, in_bytes: bool = False) -> None:
        self.most = most
        self._what = what
        self._in_bytes = in_bytes
        self._was_reached = False

    def allows(self, count: int) -> bool:
        """Return whether there may be `count`; if not, remember that the limit was reached."""
        self._was_reached |= count > self.most
        return count <= self.most

    def reached(self, count: int) -> tuple[str, ...]:
        """Return a sentence if `count` reaches the limit, or something was refused before; else nothing."""
        if count < self.most and not self._was_reached:
            return ()
        refused = ", and there was no room for more" if self._was_reached else ""
        return (f"{self._what}: {self._shown(count)} of {self._shown(self.most)} are used{refused}",)

    def _shown(self, count: int) -> str:
        if not self._in_bytes:
            return str(count)
        return f"{count / (1 << 20):.1f} MiB" if count >= 1 << 20 else f"{count / 1024:.1f} KiB"
