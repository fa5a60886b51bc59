"""Verification that a robot has arrived at its goal, by the door plate there (thesis section 6.3).

The plate finder publishes each new plate in PlateSeen, of which DServer keeps the newest values. The goal's
plate, read near its position, confirms the goal; another plate at that position refutes it. Without a plate
nothing is decided: the goal's plate may be on the wall to the right, or hidden by a person.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable
from enum import IntEnum
from typing import Any, NamedTuple

from colony.nav.maps.signs import Plate, door_name, plates_of
from colony.nav.maps.stickrep.model import Map
from colony.nav.shared import PLATE_SEEN, try_ask
from colony.runtime.kit.script import Step, sleep
from colony.runtime.library import data

SAME_PLATE_MM = 1_500.0
"""Maximum distance of a reading from the plate's position; the same text farther away is on another plate."""

SAME_POSITION_MM = 600.0
"""Maximum distance from the goal's plate at which another text refutes the goal: doors are farther apart."""

HISTORY_LENGTH = 16
"""Number of plates that DServer keeps: those along the last meters of a corridor."""

EARLY_NS = 3_000_000_000
"""Time before the last segment during which the robot may already have read the goal's plate, in ns."""

READ_TIMEOUT_S, POLL_INTERVAL_S = 2.0, 0.25
"""Timeout for reading the plate after the arrival, and interval between two checks, in seconds."""


class GoalVerdict(IntEnum):
    """The verdict of the plates on the goal."""

    UNSEEN = -1
    WRONG = 0
    RIGHT = 1


class ReportedPlate(NamedTuple):
    """A value of PlateSeen: time, number since the finder's start, text, and position in mm."""

    t_ns: int
    number: int
    text: str
    x_mm: float
    y_mm: float


def reported_plate(value: Any) -> ReportedPlate | None:
    """Decode a value of PlateSeen; None if it is malformed."""
    match value:
        case [int(t_ns), int(number), str(text), int() | float() as x, int() | float() as y]:
            return ReportedPlate(t_ns, number, text, float(x), float(y)) if math.isfinite(x + y) else None
        case _:
            return None


def verdict_of(plate: Plate, reports: Iterable[ReportedPlate]) -> GoalVerdict:
    """Return the verdict of the reported plates on a goal with `plate`; unread plates do not count."""
    verdict = GoalVerdict.UNSEEN
    for report in reports:
        distance_mm = math.hypot(report.x_mm - plate.center.x, report.y_mm - plate.center.y)
        if report.text == plate.text and distance_mm <= SAME_PLATE_MM:
            return GoalVerdict.RIGHT
        if report.text and distance_mm <= SAME_POSITION_MM:
            verdict = GoalVerdict.WRONG
    return verdict


def plate_at(floor: Map, node: str) -> Plate | None:
    """Return the plate of a node's door, or None if it has none.

    The node may have a prefix with its floor: "376L" or "2:250R".
    """
    door = door_name(node.rpartition(":")[2])
    return next((plate for plate in plates_of(floor) if plate.door == door), None)


def remember_plates() -> Generator[Step, Any, None]:
    """Make DServer keep a history of the newest plates."""
    yield from try_ask("DServer", data.set_history(PLATE_SEEN, HISTORY_LENGTH))


def goal_verdict(plate: Plate, *, segment_start_ns: int) -> Generator[Step, Any, GoalVerdict]:
    """Return the verdict of the plates seen on the last segment, or shortly before.

    The verdict waits up to `READ_TIMEOUT_S` for a plate in view to be read.
    """
    since_ns = segment_start_ns - EARLY_NS
    waited_s = 0.0
    while True:
        values = (yield from try_ask("DServer", data.history(PLATE_SEEN))) or ()
        plates = (reported_plate(value.read()) for value in values)
        verdict = verdict_of(
            plate, [report for report in plates if report is not None and report.t_ns >= since_ns]
        )
        if verdict is GoalVerdict.RIGHT or waited_s >= READ_TIMEOUT_S:
            return verdict
        yield from sleep(POLL_INTERVAL_S)
        waited_s += POLL_INTERVAL_S
