"""Closing of several resources, even if one of them fails to close."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol


class Closable(Protocol):
    """A resource that can be closed."""

    def close(self) -> None:
        """Close the resource."""
        ...


def close_all(things: Iterable[Closable]) -> None:
    """Close all in order, even if closing one fails; raise the first failure at the end."""
    failures: list[BaseException] = []
    for thing in things:
        try:
            thing.close()
        except BaseException as failure:
            failures.append(failure)
    if failures:
        raise failures[0]
