"""Closing of several resources, even if closing one of them fails."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol


class Closable(Protocol):
    """A resource that can be closed."""

    def close(self) -> None:
        """Close the resource."""
        ...


def close_all(resources: Iterable[Closable]) -> None:
    """Close all in order, even if closing one fails; raise the first failure at the end."""
    failures: list[BaseException] = []
    for resource in resources:
        try:
            resource.close()
        except BaseException as failure:
            failures.append(failure)
    if failures:
        raise failures[0]
