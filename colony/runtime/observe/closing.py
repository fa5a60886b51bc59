"""Ending several things, whatever happens to one of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol


class Closable(Protocol):
    """What is closed in the end."""

    def close(self) -> None: ...


def close_all(things: Iterable[Closable]) -> None:
    """Close each, in order, even where closing another fails; the first failure is raised in the end."""
    failures: list[BaseException] = []
    for thing in things:
        try:
            thing.close()
        except BaseException as failure:
            failures.append(failure)
    if failures:
        raise failures[0]
