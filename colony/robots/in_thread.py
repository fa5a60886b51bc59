"""A function that runs in a thread as long as a `with` lasts."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def in_thread(
    name: str, run: Callable[[], object], stop: Callable[[], object]
) -> Iterator[list[BaseException]]:
    """Call `run` in a thread inside the `with`; at its end call `stop`, and wait until `run` has returned.

    The list gets the exception that ended it.
    """
    failed: list[BaseException] = []

    def call() -> None:
        try:
            run()
        except BaseException as failure:
            failed.append(failure)

    thread = threading.Thread(target=call, name=name)
    thread.start()
    try:
        yield failed
    finally:
        stop()
        thread.join()
