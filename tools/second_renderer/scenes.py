"""Scenes drawn from a seed: a wall with doors and what else hangs there, an elevator, a ceiling."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from colony.nav.maps.signs import MARKER_CODES
from tools.second_renderer import furnishing, lettering
from tools.second_renderer.stage import Stage, glossy, lamp, matte, printed

HALF_LENGTH_M = 6.0
"""Of the piece of a corridor that is built, on each side of the camera."""

CAMERA_HEIGHT_M = 1.35
_WORDS = ("MEN", "WOMEN", "STAIR", "EXIT", "LAB", "COPY")


class View(NamedTuple):
    """A camera: where it is, where its optical axis leads, what is up in its image, and how it sees.

    `kind` is level or ceiling, `size` columns and rows, `travel` how far it moves along y while its shutter
    is open, `aperture` the radius of its lens and `focus` at which distance it is sharp, in m.
    """

    kind: str
    place: tuple[float, float, float]
    ahead: tuple[float, float, float]
    up: tuple[float, float, float]
    size: tuple[int, int]
    travel: float
    aperture: float
    focus: float


class Scene(NamedTuple):
    """A stage and the camera before it; `font` is that of its plates."""

    stage: Stage
    view: View
    font: str


def plate_scene(seed: int, *, plates: bool, size: tuple[int, int]) -> Scene:
    """A wall with doors and their plates in one font, seen from 0.6 to 2.2 m at up to 20 degrees; or one with
    everything but plates."""
    rng = np.random.default_rng([seed, 1])
    stage = Stage()
    distance = float(rng.uniform(0.65, 2.1))
    turn = float(np.clip(rng.normal(0.0, 7.0), -20.0, 20.0))
    width = max(distance + 0.6, float(rng.uniform(1.8, 3.7)))
    _corridor(stage, rng, width)
    font = list(lettering.FONTS)[int(rng.integers(len(lettering.FONTS)))]
    sight = -distance * math.tan(math.radians(turn))  # where the optical axis meets the wall
    room = distance * math.tan(math.radians(30.0))
    if plates:
        start = sight + float(rng.uniform(-0.75, 0.75)) * max(room - 0.25, 0.05) - 0.178
        _doors_along(stage, rng, start, font)
    else:
        _things_along(stage, rng, sight - room - 0.3, sight + room + 0.3)
    if rng.random() < (0.1 if plates else 0.25) and distance > 1.2:
        from_wall = float(rng.uniform(0.3, 0.45)) * distance
        aside = float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.3, 0.6)) * room
        furnishing.person(stage, rng, from_wall, sight + aside)
    return Scene(stage, _facing(rng, distance, turn, size), font)


def marker_scene(seed: int, *, code: int | None, size: tuple[int, int]) -> Scene:
    """Elevator doors with their marker seen from 0.9 to 3.3 m; without a code their leaves are apart."""
    rng = np.random.default_rng([seed, 2])
    stage = Stage()
    distance = float(rng.uniform(1.1, 3.2))
    turn = float(np.clip(rng.normal(0.0, 8.0), -20.0, 20.0))
    _corridor(stage, rng, max(distance + 0.4, float(rng.uniform(2.4, 3.7))))
    sight = -distance * math.tan(math.radians(turn))
    middle = sight + float(rng.uniform(-0.6, 0.6)) * max(distance * math.tan(math.radians(30.0)) - 0.4, 0.02)
    wide = float(rng.uniform(0.95, 1.2))
    gap = 0.0 if code is not None else float(rng.uniform(0.15, 0.8))
    shown = int(rng.choice(MARKER_CODES)) if code is None else code
    furnishing.elevator(stage, rng, middle - wide / 2.0, wide, shown, gap)
    if rng.random() < 0.6:
        side = float(rng.choice([-1.0, 1.0]))
        furnishing.large_poster(stage, rng, middle + side * wide * 0.65 - (0.7 if side < 0 else 0.0))
    return Scene(stage, _facing(rng, distance, turn, size), "")


def ceiling_scene(seed: int, *, lights: str) -> Scene:
    """A ceiling from below: with a light that is on, one that is out ("out"), or none ("none")."""
    rng = np.random.default_rng([seed, 3])
    stage = Stage()
    width = float(rng.uniform(1.8, 3.0))
    across, along = width / 2.0, float(rng.uniform(-0.3, 0.3))
    _corridor(stage, rng, width, lights=False)
    strength = float(rng.uniform(2.0, 9.0))
    for detection in (-4.0, 4.0):
        furnishing.ceiling_light(stage, across, along + detection, strength)
    if lights != "none":
        furnishing.ceiling_light(stage, across, along, strength if lights == "on" else 0.0)
    tilt = math.radians(float(np.clip(rng.normal(0.0, 5.0), -15.0, 15.0)))
    place = (across + float(rng.normal(0.0, 0.15)), 0.0, CAMERA_HEIGHT_M)
    # Columns grow forward and rows to the right, as the robot's camera counts them: a mirror image, which is
    # made by turning the rows about when the picture is developed.
    up = (math.cos(tilt), -math.sin(tilt), 0.0)
    view = View(
        "ceiling", place, (0.0, 0.0, 1.0), up, (240, 120), float(rng.uniform(0.0, 0.006)), 0.001, 1.35
    )
    return Scene(stage, view, "")


def _facing(rng: np.random.Generator, distance: float, turn_deg: float, size: tuple[int, int]) -> View:
    """A camera that looks at the wall from a distance, turned counterclockwise."""
    turn = math.radians(turn_deg)
    ahead = (-math.cos(turn), -math.sin(turn), 0.0)
    focus = distance * float(rng.uniform(0.7, 1.4))
    return View("level", (distance, 0.0, CAMERA_HEIGHT_M), ahead, (0.0, 0.0, 1.0), size,
                float(rng.uniform(0.0, 0.01)), float(rng.uniform(0.0005, 0.003)), focus)  # fmt: skip


def _corridor(stage: Stage, rng: np.random.Generator, width: float, *, lights: bool = True) -> None:
    """Walls, floor and ceiling, lamps, and behind the camera a window in some."""
    length, height = 2.0 * HALF_LENGTH_M, furnishing.CEILING_M
    paint = float(rng.uniform(0.3, 0.75))
    if rng.random() < 0.5:
        sheet = lettering.bricks(rng, paint=paint, mortar=paint * float(rng.uniform(0.7, 1.1)))
    else:
        sheet = lettering.plaster(rng, paint=paint)
    stage.on_wall(-HALF_LENGTH_M, 0.0, length, height, printed(sheet, (length, height)))
    stage.box((0.0, -HALF_LENGTH_M, 0.0), (0.01, HALF_LENGTH_M, 0.1), glossy(0.08, 0.2))
    floor = glossy(tuple(rng.uniform(0.1, 0.45) * np.array([1.0, 0.95, 0.85])), float(rng.uniform(0.05, 0.3)))
    y, x = np.array([0.0, length, 0.0]), np.array([width, 0.0, 0.0])
    corner = np.array([0.0, -HALF_LENGTH_M, 0.0])
    stage.sheet(corner, x, y, floor)
    tiles = printed(lettering.ceiling_tiles(rng, paint=float(rng.uniform(0.55, 0.85))), (length, width))
    stage.sheet(corner + np.array([0.0, 0.0, height]), y, x, tiles)
    for end in (-HALF_LENGTH_M, HALF_LENGTH_M):
        stage.sheet(np.array([0.0, end, 0.0]), x, np.array([0.0, 0.0, height]), matte(0.5 * paint + 0.1))
    _wall_behind(stage, rng, width, paint, lights=lights)
    if lights:
        strength, phase = float(rng.uniform(2.5, 9.0)), float(rng.uniform(-1.5, 1.5))
        for detection in (-4.0, 0.0, 4.0):
            if rng.random() < 0.8 or detection == 0.0:
                furnishing.ceiling_light(stage, width / 2.0, phase + detection, strength)
        stage.targets.clear()  # these are beyond the image


def _wall_behind(stage: Stage, rng: np.random.Generator, width: float, paint: float, *, lights: bool) -> None:
    """The wall on the right, of which a part may be a window with the sun and the sky behind."""
    up = np.array([0.0, 0.0, furnishing.CEILING_M])
    plain = matte(paint)
    if rng.random() > 0.35 or not lights:
        stage.sheet(
            np.array([width, HALF_LENGTH_M, 0.0]), np.array([0.0, -2 * HALF_LENGTH_M, 0.0]), up, plain
        )
        return
    low, high = 0.9, 2.2
    first = float(rng.uniform(-2.0, 1.0))
    last = first + float(rng.uniform(0.8, 2.5))
    full = -2.0 * HALF_LENGTH_M
    stage.sheet(np.array([width, HALF_LENGTH_M, 0.0]), np.array([0.0, full, 0.0]), up * low / up[2], plain)
    rest = np.array([0.0, 0.0, furnishing.CEILING_M - high])
    stage.sheet(np.array([width, HALF_LENGTH_M, high]), np.array([0.0, full, 0.0]), rest, plain)
    between = np.array([0.0, 0.0, high - low])
    for start, end in ((HALF_LENGTH_M, last), (first, -HALF_LENGTH_M)):
        stage.sheet(np.array([width, start, low]), np.array([0.0, end - start, 0.0]), between, plain)
    stage.box(
        (width, (first + last) / 2.0 - 0.02, low), (width + 0.04, (first + last) / 2.0 + 0.02, high), plain
    )
    pane = np.array([width + 0.3, last + 0.5, 0.4])
    stage.sheet(pane, np.array([0.0, first - last - 1.0, 0.0]), np.array([0.0, 0.0, 2.3]), matte(0.0),
                emitter=lamp(float(rng.uniform(0.8, 3.0))))  # fmt: skip
    # The sun stands before that sheet of sky, so it is a small bright disk near the window.
    sun = np.array([width + 0.28, (first + last) / 2.0 + float(rng.uniform(-0.3, 0.3)), 2.15])
    stage.sheet(sun, np.array([0.0, -0.12, 0.0]), np.array([0.0, 0.0, 0.12]), matte(0.0),
                emitter=lamp(float(rng.uniform(400.0, 1500.0))))  # fmt: skip


def _doors_along(stage: Stage, rng: np.random.Generator, start: float, font: str) -> None:
    """A plate from `start` on with its door before it, further doors and things on both sides."""
    wide = float(rng.uniform(0.8, 1.05))
    furnishing.door(stage, rng, start - 0.13 - wide, wide, is_open=bool(rng.random() < 0.25))
    furnishing.plate(stage, rng, start, _text(rng), font)
    right = start + 0.356 + float(rng.uniform(0.05, 0.5))
    if rng.random() < 0.5:
        right += _thing(stage, rng, right) + float(rng.uniform(0.1, 0.4))
    wide = float(rng.uniform(0.8, 1.05))
    furnishing.door(stage, rng, right + 0.06, wide, is_open=bool(rng.random() < 0.25))
    furnishing.plate(stage, rng, right + wide + 0.19, _text(rng), font)
    left = start - 1.3 - float(rng.uniform(0.1, 0.4))
    if rng.random() < 0.5:
        furnishing.plate(stage, rng, left - 0.356, _text(rng), font)
    else:
        _things_along(stage, rng, left - 1.5, left - 0.7)


def _things_along(stage: Stage, rng: np.random.Generator, first: float, last: float) -> None:
    """Anything but plates, from `first` on until `last` is passed."""
    at = first
    while at < last:
        at += _thing(stage, rng, at) + float(rng.uniform(0.08, 0.5))


def _thing(stage: Stage, rng: np.random.Generator, y: float) -> float:
    """One thing that is no plate; its width."""
    match int(rng.choice(6, p=[0.3, 0.2, 0.15, 0.15, 0.1, 0.1])):
        case 0:
            return furnishing.small_black_poster(stage, rng, y)
        case 1:
            return furnishing.large_poster(stage, rng, y)
        case 2:
            return furnishing.extinguisher(stage, rng, y)
        case 3:
            width = 0.2 * int(rng.integers(3, 9))
            furnishing.glass_bricks(stage, rng, y, width)
            return width
        case 4:
            return furnishing.switch(stage, rng, y)
        case _:
            width = float(rng.uniform(0.8, 1.0))
            furnishing.door(stage, rng, y + 0.06, width, is_open=bool(rng.random() < 0.3))
            return width + 0.12


def _text(rng: np.random.Generator) -> str:
    """What stands on a plate: mostly a number of three digits, some with a letter or of other lengths."""
    kind = rng.random()
    if kind < 0.08:
        return str(rng.choice(_WORDS))
    number = str(rng.integers(100, 1000)) if kind < 0.9 else str(rng.integers(1000, 10000))
    before = str(rng.choice(list("ABCEN"))) if kind > 0.6 and len(number) == 3 else ""
    after = str(rng.choice(list("ABCD"))) if 0.4 < kind < 0.5 else ""
    return before + number + after
