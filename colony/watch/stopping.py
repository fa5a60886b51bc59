"""The emergency stop of a page: a button whose connections to the robot are open beforehand."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from colony.runtime.kit.connection import Session
from colony.runtime.kit.emergency import StopButton
from colony.runtime.kit.errors import RobotConnectionError
from colony.watch.watched import StopAnswer


@contextmanager
def stop_button(session: Session) -> Iterator[Callable[[], StopAnswer]]:
    """Open a button; the context's value presses it, from any thread, and waits for the answers."""
    lock = threading.Lock()
    with StopButton(session, name="colony watch") as button:

        def press() -> StopAnswer:
            with lock:
                return _press(button)

        yield press


def _press(button: StopButton) -> StopAnswer:
    try:
        pressed = button.press()
    except RobotConnectionError as problem:
        return StopAnswer(is_kept=False, text=f"not stopped: {problem}")
    problems = "; ".join(pressed.problems.values())
    if pressed.kept:
        return StopAnswer(is_kept=True, text=f"stopped; acknowledged by {', '.join(pressed.acknowledged)}")
    return StopAnswer(is_kept=False, text=f"stop sent, but: {problems}")
