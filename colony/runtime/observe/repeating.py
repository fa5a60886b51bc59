"""A function that a thread calls again and again, as long as a `with` lasts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread


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
