"""A limit of what a server keeps, and whether it was ever reached, for people to be told."""

from __future__ import annotations


class Bound:
    """At most `most` of something. Mutable: whether something had no room.

    Args:
        what: the thing that is counted, for people.
        most: the limit.
        in_bytes: whether it counts bytes.
    """

    def __init__(self, what: str, most: int, *, in_bytes: bool = False) -> None:
        self.most = most
        self._what = what
        self._in_bytes = in_bytes
        self._was_reached = False

    def allows(self, count: int) -> bool:
        """Return whether there may be so many; remember where not."""
        self._was_reached |= count > self.most
        return count <= self.most

    def reached(self, count: int) -> tuple[str, ...]:
        """A sentence where the limit is reached by so many, or something had no room before; else nothing."""
        if count < self.most and not self._was_reached:
            return ()
        refused = ", and there was no room for more" if self._was_reached else ""
        return (f"{self._what}: {self._shown(count)} of {self._shown(self.most)} are used{refused}",)

    def _shown(self, count: int) -> str:
        if not self._in_bytes:
            return str(count)
        return f"{count / (1 << 20):.1f} MiB" if count >= 1 << 20 else f"{count / 1024:.1f} KiB"
