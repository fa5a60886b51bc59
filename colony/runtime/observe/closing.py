"""Closing of several resources, even if closing one of them fails."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Protocol

# --- repeating -----------------------------------------------------------------------------------------
#
# A function that a thread calls again and again, as long as a `with` lasts.


@contextmanager
def repeating(name: str, act: Callable[[], object], *, interval_s: float) -> Iterator[None]:
    """Call `act` every `interval_s` seconds inside the `with`, in a thread of this name."""
    ended = Event()

    def run() -> None:
        while not ended.wait(interval_s):
            act()

    thread = Thread(target=run, name=name, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


# --- closing -------------------------------------------------------------------------------------------


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
