"""Reports of problems of users' code: what they say, each kind of them once, and which parts fail now."""

from __future__ import annotations

import traceback
from collections.abc import Callable

RECOVERED_AFTER = 30
"""Number of frames in a row without a problem after which a part works again.

So a status that is read once a second also shows a problem of a single frame.
"""

MAX_FAILING = 8
"""Maximum number of parts that are listed as failing."""

MAX_HEADLINE = 200
"""Maximum length of the line that describes a problem in a list."""

Report = Callable[[str], None]
"""A function that takes a description of a problem, of one line or several."""


def exception_text(problem: BaseException) -> str:
    """Return the text of an exception that a user's function raised, also where that text fails itself."""
    try:
        return str(problem)
    except Exception:
        return "(an exception without a text)"


def failure_text(what: str, problem: BaseException) -> str:
    """Return what is to be reported of a function that failed.

    An OSError is a device or a connection that fails: one line. Any other error is one of programming, and
    has its traceback.

    Args:
        what: the function that failed, for example "Lift.move".
        problem: the exception that it raised.
    """
    if isinstance(problem, OSError):
        return f"{what} failed: {type(problem).__name__}: {exception_text(problem)}"
    return f"{what} failed:\n{''.join(traceback.format_exception(problem)).rstrip()}"


def headline(problem: str) -> str:
    """Return the line that describes a problem in a list: its first line, and the last one of a traceback."""
    lines = problem.split("\n")
    return (lines[0] if len(lines) == 1 else f"{lines[0]} {lines[-1].strip()}")[:MAX_HEADLINE]


class OnceReporter:
    """Reports each kind of problem of each part of a server once. Mutable: remembers what it reported.

    It also knows which parts fail: those that had a problem in the last `RECOVERED_AFTER` frames.
    """

    def __init__(self, report: Report) -> None:
        self._report = report
        self._reported: set[tuple[str, str]] = set()
        self._failing: dict[str, str] = {}
        self._frames_without: dict[str, int] = {}

    @property
    def failing(self) -> tuple[str, ...]:
        """One line for each part that fails, at most `MAX_FAILING`."""
        return tuple([headline(problem) for problem in list(self._failing.values())[:MAX_FAILING]])

    def end_frame(self) -> None:
        """End a frame: a part without a problem in `RECOVERED_AFTER` of them works again."""
        for name in tuple(self._failing):
            self._frames_without[name] += 1
            if self._frames_without[name] > RECOVERED_AFTER:
                self.note_success(name)

    def note_success(self, name: str) -> None:
        """Record that a part works again."""
        self._failing.pop(name, None)
        self._frames_without.pop(name, None)

    def report(self, name: str, kind: str, problem: str) -> None:
        """Record a problem of the part `name`, and report it unless one of this kind was reported before."""
        self._failing[name], self._frames_without[name] = problem, 0
        if (name, kind) not in self._reported:
            self._reported.add((name, kind))
            self._report(problem)
