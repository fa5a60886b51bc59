"""The conditions that had to change, as clauses: what would have to be so."""

from __future__ import annotations

from typing import assert_never

from colony.text.wording import duration_text
from colony.verify.explain.causes import (
    Answered,
    Comparison,
    Constant,
    Heard,
    Past,
    Present,
    Reading,
    Remembered,
    Sendable,
    TimeConstant,
    Undisturbed,
    Unknown,
    Unwired,
)
from colony.verify.explain.formula import Change, Leaf

MAX_PARTS = 24
"""Maximum number of conditions side by side that an answer shows."""


def changes_texts(change: Change) -> tuple[str, ...]:
    """Return what would have to be so together, clause by clause, the first of many."""
    texts = [change_text(leaf) for leaf in change.leaves[:MAX_PARTS]]
    omitted = len(change.leaves) - MAX_PARTS
    return (*texts, *([f"{omitted} more"] if omitted > 0 else []))


def change_text(leaf: Leaf) -> str:
    """Return the opposite of a condition as a clause: what would have to be so."""
    holds, cause = leaf.holds, leaf.cause
    match cause:
        case Comparison(condition=condition) | Reading(condition=condition) | Constant(condition=condition):
            return f"`{condition}` {'did not hold' if holds else 'held'}"
        case Remembered(condition=condition) | Unknown(condition=condition):
            return f"`{condition}` {'did not hold' if holds else 'held'}"
        case Past(function="recently", condition=condition, duration_ns=duration_ns):
            had = "had not been" if holds else "had been"
            return f"`{condition}` {had} true in the {duration_text(duration_ns)} before"
        case Past(condition=condition, duration_ns=duration_ns):
            had = "had not been" if holds else "had been"
            return f"`{condition}` {had} true for {duration_text(duration_ns)}"
        case _:
            return _change_of_runtime(cause, holds)


def _change_of_runtime(
    cause: Present | TimeConstant | Answered | Heard | Undisturbed | Sendable | Unwired, holds: bool
) -> str:
    match cause:
        case Present(sensor=sensor):
            return f"{sensor} {'were missing' if holds else 'had a reading'}"
        case TimeConstant(dominant=dominant, window_ns=window_ns):
            had = "had not been" if holds else "had been"
            return f"{dominant} {had} active in the {duration_text(window_ns)} before"
        case Answered(module=module):
            return f"{module} answered {'with no command' if holds else 'with a command'}"
        case Heard(module=module):
            return f"the request of {module} had come in time"
        case Undisturbed(actuator=actuator):
            return f"{actuator} had been left to the network"
        case Sendable(module=module):
            return f"the command of {module} could have been sent"
        case Unwired(actuator=actuator):
            return f"{actuator} were wired otherwise"
        case _:
            assert_never(cause)
