"""Whether a robot that has arrived is where it should be, by the door plate that hangs there (thesis section
6.3).

The plate finder tells each new plate by PlateSeen, whose newest values DServer remembers. The plate of the
goal that was read near its place says that the robot is right; another one in its place that it is not. No
plate says nothing: the goal's may be on the wall to the right, or somebody stands before it.
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
"""How many plates DServer remembers: those of a corridor's last meters."""

BEFORE_NS = 3_000_000_000
"""So long before its last segment a robot may have read the plate: that may begin right beside the goal."""

PATIENCE_S, LOOK_S = 2.0, 0.25
"""For how long a robot that has arrived waits for the plate to be read, and how often it asks."""


class Verdict(IntEnum):
    """What plates say of the goal."""

    UNSEEN = -1
    WRONG = 0
    RIGHT = 1


class SeenPlate(NamedTuple):
    """What PlateSeen says: when, which one since the finder began, what is on it, and where, in mm."""

    t_ns: int
    number: int
    text: str
    x_mm: float
    y_mm: float


def seen_plate(told: Any) -> SeenPlate | None:
    """A value of PlateSeen; None where it is none."""
    match told:
        case [int(t_ns), int(number), str(text), int() | float() as x, int() | float() as y]:
            return SeenPlate(t_ns, number, text, float(x), float(y)) if math.isfinite(x + y) else None
        case _:
            return None


def verdict_of(plate: Plate, seen: Iterable[SeenPlate]) -> Verdict:
    """What these plates say of a goal where `plate` hangs. One that could not be read says nothing."""
    verdict = Verdict.UNSEEN
    for one in seen:
        off_mm = math.hypot(one.x_mm - plate.middle.x, one.y_mm - plate.middle.y)
        if one.text == plate.text and off_mm <= NEAR_MM:
            return Verdict.RIGHT
        if one.text and off_mm <= IN_ITS_PLACE_MM:
            verdict = Verdict.WRONG
    return verdict


def plate_at(floor: Map, node: str) -> Plate | None:
    """The plate of the door to which a node belongs, "376L" or with its floor "2:250R"; None where it has
    none.
    """
    door = door_name(node.rpartition(":")[2])
    return next((plate for plate in plates_of(floor) if plate.door == door), None)


def remember_plates() -> Generator[Step, Any, None]:
    """Have DServer keep more than the newest plate."""
    yield from asked("DServer", data.set_history(PLATE_SEEN, REMEMBERED))


def goal_verdict(plate: Plate, *, begun_ns: int) -> Generator[Step, Any, Verdict]:
    """What was seen since about when the last segment began says of the goal; a plate that is in view has a
    while to be read.
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
