"""Random bearings of sensors, and angles at, beside and between them."""

from __future__ import annotations

from colony.ir.bearings import TURN, Bearings, listed_bearings, uniform
from colony.verify.testing.frames import Choices

_STARTS = (-180.0, 0.0, 90.0, -135.0, 7.5, 172.5, -0.5)
_STEPS = (15.0, 45.0, 7.0, 1.0, 0.1, 13.7, 90.0, 61.0)
_LISTED = (0.0, 30.0, -30.0, 90.0, -90.0, 180.0, 50.0, 10.0, -10.0, 172.5, 200.0)


def draw_bearings(choices: Choices, size: int) -> tuple[str, Bearings]:
    """Draw the bearings of an array: a ring that closes, an arc, or a list; return them and their text."""
    start = choices.pick(_STARTS)
    kind = choices.up_to(6)
    if kind >= 5:
        angles = _listed(choices, size)
        return f"bearing [{', '.join(map(angle_text, angles))}]", listed_bearings(angles)
    step: float | None = None
    if kind == 2:
        step = choices.pick((1, -1)) * TURN / size
    elif kind > 2:
        step = choices.pick((1, -1)) * choices.pick([s for s in _STEPS if s * size < TURN])
    bearings = uniform(start, step, size)
    assert bearings is not None
    written = "" if step is None else f" step {step!r} deg"
    return f"bearing {angle_text(start)}{written}", bearings


def _listed(choices: Choices, size: int) -> list[float]:
    """Draw bearings in any order: from a few, so that some are equal; dense; or all around."""
    match choices.up_to(2):
        case 0:
            return [choices.pick(_LISTED) for _ in range(size)]
        case 1:
            return [choices.pick(_STARTS) + choices.up_to(80) for _ in range(size)]
        case _:
            turned = choices.up_to(size)
            return [float((i + turned) % size * (TURN // size) - TURN // 2) for i in range(size)]


def angle_text(angle: float) -> str:
    """Return the text of an angle in degrees."""
    return f"{angle!r} deg"


def draw_angle(choices: Choices, bearings: Bearings) -> float:
    """Draw an angle: a bearing, halfway to the next or beyond the ends, or any other, in [-360, 360]."""
    match choices.up_to(4):
        case 0 | 1:
            angle = choices.pick(bearings.angles)
        case 2:
            angle = choices.pick((-180.0, 180.0, 0.0))
        case 3:
            angle = choices.pick(bearings.angles) + choices.pick((0.5, -0.5)) * bearings.spacing
        case _:
            angle = 5.0 * choices.between(-36, 36)
    if choices.one_in(6):
        angle += choices.pick((TURN, -TURN))
    return min(max(angle, -TURN), TURN) + 0.0
