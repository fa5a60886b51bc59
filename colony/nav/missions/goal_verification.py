"""Verification that a robot has arrived at its goal, by the door plate there (thesis section 6.3).

The plate finder publishes each new plate in PlateSeen, whose newest values DServer remembers. The goal's
plate, read near its place, confirms the goal; another plate in its place refutes it. No plate says nothing:
the goal's may be on the wall to the right, or a person stands before it.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable
from enum import IntEnum
from typing import Any, NamedTuple

from colony.nav.asks import asked
from colony.nav.maps.signs import Plate, door_name, plates_of
from colony.nav.maps.stickrep.model import Map
from colony.nav.shared import PLATE_SEEN
from colony.runtime.kit.script import Step, sleep
from colony.runtime.library import data

NEAR_MM = 1_500.0
"""A plate that is read farther from its place than this was another one of that name."""

IN_ITS_PLACE_MM = 600.0
"""Another plate that is no farther from there hangs where the goal's should: doors are wider apart."""

REMEMBERED = 16
"""Number of plates that DServer remembers: those of a corridor's last meters."""

BEFORE_NS = 3_000_000_000
"""Time before its last segment at which a robot may already have read the plate beside the goal."""

PATIENCE_S, LOOK_S = 2.0, 0.25
"""Timeout for the plate to be read after the arrival, and the interval between two checks, in seconds."""


class Verdict(IntEnum):
    """The verdict of the plates on the goal."""

    UNSEEN = -1
    WRONG = 0
    RIGHT = 1


class SeenPlate(NamedTuple):
    """A value of PlateSeen: its time, its number since the finder began, its text, and its place in mm."""

    t_ns: int
    number: int
    text: str
    x_mm: float
    y_mm: float


def seen_plate(told: Any) -> SeenPlate | None:
    """Return a value of PlateSeen, or None if it is none."""
    match told:
        case [int(t_ns), int(number), str(text), int() | float() as x, int() | float() as y]:
            return SeenPlate(t_ns, number, text, float(x), float(y)) if math.isfinite(x + y) else None
        case _:
            return None


def verdict_of(plate: Plate, seen: Iterable[SeenPlate]) -> Verdict:
    """Return the verdict of these plates on a goal where `plate` hangs. An unreadable plate says nothing."""
    verdict = Verdict.UNSEEN
    for one in seen:
        off_mm = math.hypot(one.x_mm - plate.middle.x, one.y_mm - plate.middle.y)
        if one.text == plate.text and off_mm <= NEAR_MM:
            return Verdict.RIGHT
        if one.text and off_mm <= IN_ITS_PLACE_MM:
            verdict = Verdict.WRONG
    return verdict


def plate_at(floor: Map, node: str) -> Plate | None:
    """Return the plate of the door to which a node belongs, or None if it has none.

    The node may carry its floor: "376L" or "2:250R".
    """
    door = door_name(node.rpartition(":")[2])
    return next((plate for plate in plates_of(floor) if plate.door == door), None)


def remember_plates() -> Generator[Step, Any, None]:
    """Make DServer keep more than the newest plate."""
    yield from asked("DServer", data.set_history(PLATE_SEEN, REMEMBERED))


def goal_verdict(plate: Plate, *, begun_ns: int) -> Generator[Step, Any, Verdict]:
    """Return the verdict of the plates seen since about when the last segment began.

    A plate that is in view has some time to be read.
    """
    since_ns = begun_ns - BEFORE_NS
    waited_s = 0.0
    while True:
        values = (yield from asked("DServer", data.history(PLATE_SEEN))) or ()
        plates = (seen_plate(value.read()) for value in values)
        verdict = verdict_of(plate, [one for one in plates if one is not None and one.t_ns >= since_ns])
        if verdict is Verdict.RIGHT or waited_s >= PATIENCE_S:
            return verdict
        yield from sleep(LOOK_S)
        waited_s += LOOK_S
