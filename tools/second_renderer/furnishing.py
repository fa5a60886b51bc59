"""The things of a corridor: what is on its walls, on its ceiling and in the way, put on a stage."""

from __future__ import annotations

import numpy as np

from colony.nav.maps.signs import (
    MARKER_BITS,
    PLATE_HEIGHT_MM,
    PLATE_WIDTH_MM,
    SIGN_HEIGHT_MM,
    STRIPE_HEIGHT_MM,
    STRIPE_MM,
)
from tools.second_renderer import lettering
from tools.second_renderer.stage import Stage, Target, glossy, glowing, lamp, matte, printed, steel

CEILING_M = 2.7
LIGHT_LENGTH_M, LIGHT_WIDTH_M = 0.6, 1.2
"""Of a ceiling light along and across the corridor."""

DOOR_HEIGHT_M = 2.1
_SIGN_M = SIGN_HEIGHT_MM / 1000.0
_NEAR = 0.003
"""How far off the wall thin things are."""


def door(stage: Stage, rng: np.random.Generator, y: float, width: float, *, is_open: bool) -> None:
    """A door from y on: its frame, its leaf and handle, or a dim room in place of them."""
    tone = float(rng.uniform(0.12, 0.5))
    frame = glossy((0.7 * tone, 0.7 * tone, 0.75 * tone), 0.25)
    for left in (y - 0.06, y + width):
        stage.box((0.0, left, 0.0), (0.025, left + 0.06, DOOR_HEIGHT_M + 0.06), frame)
    stage.box((0.0, y - 0.06, DOOR_HEIGHT_M), (0.025, y + width + 0.06, DOOR_HEIGHT_M + 0.06), frame)
    if is_open:
        dark = float(rng.uniform(0.02, 0.12))
        stage.on_wall(y, 0.0, width, DOOR_HEIGHT_M, matte(dark), off=_NEAR)
        stage.on_wall(y + 0.55 * width, 0.6, 0.3 * width, 1.1, matte(float(rng.uniform(0.1, 0.5))), off=0.005)
        return
    color = [(0.42, 0.27, 0.15), (0.3, 0.3, 0.32), (0.5, 0.46, 0.38), (0.2, 0.25, 0.3)][int(rng.integers(4))]
    leaf = printed(lettering.wood(rng, tone=color), (1.0, DOOR_HEIGHT_M), roughness=0.3)
    stage.on_wall(y, 0.0, width, DOOR_HEIGHT_M, leaf, off=_NEAR)
    stage.tube((0.06, y + 0.08, 1.02), (0.06, y + 0.2, 1.02), 0.012, steel(0.15))
    if rng.random() < 0.3:
        stage.on_wall(y + 0.62 * width, 1.2, 0.18, 0.7, glossy(0.04, 0.05), off=0.006)


def plate(stage: Stage, rng: np.random.Generator, y: float, text: str, font: str) -> None:
    """A plate from y on, at the height where plates hang; some are lacquered."""
    width, height = PLATE_WIDTH_MM / 1000.0, PLATE_HEIGHT_MM / 1000.0
    sheet = lettering.plate(text, font, black=rng.uniform(0.02, 0.06), white=rng.uniform(0.65, 0.9))
    roughness = float(rng.uniform(0.1, 0.4)) if rng.random() < 0.5 else None
    material = printed(sheet, (width, height), roughness=roughness)
    thick = 0.006
    bottom = _SIGN_M - height / 2.0
    stage.box((0.0, y, bottom), (thick - 0.001, y + width, bottom + height), matte(0.03))
    stage.targets.append(Target("plate", text, stage.on_wall(y, bottom, width, height, material, off=thick)))


def small_black_poster(stage: Stage, rng: np.random.Generator, y: float) -> float:
    """A black sheet with pale writing about as large as a plate, with several lines on it; its width."""
    size = float(rng.uniform(260, 460)), float(rng.uniform(110, 290))
    paper, ink = float(rng.uniform(0.02, 0.08)), float(rng.uniform(0.5, 0.9))
    _hang(stage, rng, y, lettering.poster(rng, size_mm=size, paper=(paper,) * 3, ink=(ink, ink, 0.9 * ink)))
    return size[0] / 1000.0


def large_poster(stage: Stage, rng: np.random.Generator, y: float) -> float:
    """A colored or white sheet with dark writing and shapes; its width."""
    size = float(rng.uniform(300, 700)), float(rng.uniform(400, 900))
    paper = rng.uniform(0.3, 0.95, 3)
    ink = rng.uniform(0.02, 0.2, 3)
    sheet = lettering.poster(rng, size_mm=size, paper=tuple(paper), ink=tuple(ink))
    _hang(stage, rng, y, sheet)
    return size[0] / 1000.0


def _hang(stage: Stage, rng: np.random.Generator, y: float, sheet: lettering.Print) -> None:
    width, height = sheet.width_mm / 1000.0, sheet.height_mm / 1000.0
    bottom = _SIGN_M - height / 2.0 + float(rng.normal(0.0, 0.08))
    stage.on_wall(y, bottom, width, height, printed(sheet, (width, height)), off=_NEAR)


def extinguisher(stage: Stage, rng: np.random.Generator, y: float) -> float:
    """A red cylinder on a bracket, with a small sign above; its width."""
    red = glossy((0.55, 0.03, 0.02), 0.15)
    bottom = float(rng.uniform(0.75, 1.05))
    stage.tube((0.1, y + 0.09, bottom), (0.1, y + 0.09, bottom + 0.42), 0.08, red)
    stage.ball((0.1, y + 0.09, bottom + 0.42), 0.08, red)
    stage.tube((0.1, y + 0.09, bottom + 0.48), (0.1, y + 0.09, bottom + 0.56), 0.025, matte(0.03))
    stage.on_wall(y, bottom + 0.75, 0.18, 0.18, matte((0.6, 0.05, 0.04)), off=_NEAR)
    return 0.2


def glass_bricks(stage: Stage, rng: np.random.Generator, y: float, width: float) -> None:
    """A backlit stretch of glass bricks of 200 mm, as high as a door."""
    columns, rows = max(2, round(width / 0.2)), 10
    picture = lettering.glass_bricks(rng, columns=columns, rows=rows)
    shine = glowing(picture, float(rng.uniform(0.4, 1.6)))
    stage.on_wall(y, 0.1, 0.2 * columns, 0.2 * rows, glossy(0.05, 0.05), off=0.01, emitter=shine)


def switch(stage: Stage, rng: np.random.Generator, y: float) -> float:
    """A light switch or a socket; its width."""
    z = 1.1 if rng.random() < 0.5 else 0.3
    stage.box((0.0, y, z), (0.012, y + 0.08, z + 0.12), glossy(float(rng.uniform(0.5, 0.9)), 0.2))
    return 0.08


def person(stage: Stage, rng: np.random.Generator, x: float, y: float) -> None:
    """A standing figure: shoes, legs, a coat, arms and a head."""
    coat, trousers = (matte(tuple(rng.uniform(0.02, 0.6, 3))) for _ in range(2))
    skin, tall = matte((0.55, 0.36, 0.26)), float(rng.uniform(1.6, 1.9))
    turn = float(rng.uniform(0.0, np.pi))
    dx, dy = float(np.cos(turn)), float(np.sin(turn))
    for side in (-1.0, 1.0):
        foot = (x + 0.1 * side * dx, y + 0.1 * side * dy)
        stage.tube((*foot, 0.05), (*foot, 0.5 * tall), 0.075, trousers)
        stage.ball((*foot, 0.04), 0.085, matte(0.03))
        flank = (x + 0.09 * side * dx, y + 0.09 * side * dy)
        stage.tube((*flank, 0.46 * tall), (*flank, 0.77 * tall), 0.13, coat)
        stage.ball((*flank, 0.77 * tall), 0.13, coat)
        shoulder = (x + 0.25 * side * dx, y + 0.25 * side * dy)
        stage.tube((*shoulder, 0.46 * tall), (*shoulder, 0.8 * tall), 0.05, coat)
        stage.ball((*shoulder, 0.8 * tall), 0.05, coat)
    stage.tube((x, y, 0.8 * tall), (x, y, 0.9 * tall), 0.055, skin)
    stage.ball((x, y, 0.93 * tall), 0.1, skin)
    stage.ball((x, y, 0.95 * tall), 0.105, matte(float(rng.uniform(0.02, 0.2))))


def elevator(stage: Stage, rng: np.random.Generator, y: float, width: float, code: int, gap: float) -> None:
    """Steel doors whose leaves stand `gap` apart, each with its half of the marker; a cabin behind."""
    rough = float(rng.uniform(0.2, 0.4))
    tone = float(rng.uniform(0.3, 0.7))
    leaf = glossy(tone, rough) if rng.random() < 0.4 else steel(rough)
    sheet = lettering.marker(code, MARKER_BITS, stripe_mm=STRIPE_MM, height_mm=STRIPE_HEIGHT_MM,
                             black=rng.uniform(0.02, 0.07), white=rng.uniform(0.6, 0.9))  # fmt: skip
    stage.on_wall(y, 0.0, width, DOOR_HEIGHT_M, matte(0.3), off=_NEAR)
    half, z = sheet.width_mm / 2000.0, _SIGN_M - sheet.height_mm / 2000.0
    middle, height = y + width / 2.0, sheet.height_mm / 1000.0
    seam = max(gap, float(rng.uniform(0.001, 0.004)))
    columns = sheet.picture.shape[1]
    for side, part in ((-1, sheet.picture[:, : columns // 2]), (1, sheet.picture[:, columns // 2 :])):
        start = middle + side * (seam / 2.0 + (width / 2.0 if side < 0 else 0.0))
        first, last = max(start, y), min(start + width / 2.0, y + width)
        stage.on_wall(first, 0.0, last - first, DOOR_HEIGHT_M, leaf, off=0.02)
        edge = middle + side * seam / 2.0 - (half if side < 0 else 0.0)
        paper = printed(lettering.Print(part, 1000.0 * half, sheet.height_mm), (half, height))
        stage.on_wall(max(edge, y), z, half, height, paper, off=0.022)
    for left in (y - 0.1, y + width):
        stage.box((0.0, left, 0.0), (0.05, left + 0.1, DOOR_HEIGHT_M + 0.1), steel(0.25))
    if gap == 0.0:
        left, right, top = middle - half, middle + half, z + height
        corners = [[0.022, *at] for at in ((left, top), (right, top), (right, z), (left, z))]
        stage.targets.append(Target("marker", code, np.array(corners)))


def ceiling_light(stage: Stage, x: float, y: float, strength: float) -> None:
    """A light in the ceiling about (x, y); one that is out is a pale sheet of plastic."""
    corner = np.array([x - LIGHT_WIDTH_M / 2.0, y + LIGHT_LENGTH_M / 2.0, CEILING_M - 0.004])
    across, back = np.array([LIGHT_WIDTH_M, 0.0, 0.0]), np.array([0.0, -LIGHT_LENGTH_M, 0.0])
    more = {"emitter": lamp(strength)} if strength else {}
    stage.sheet(corner, across, back, glossy(0.5, 0.2), **more)
    frame, low, high = matte(0.75), CEILING_M - 0.012, CEILING_M
    for start in (0.0, LIGHT_LENGTH_M - 0.012):
        stage.box(
            (corner[0], corner[1] - start - 0.012, low),
            (corner[0] + LIGHT_WIDTH_M, corner[1] - start, high),
            frame,
        )
    corners = np.array([corner, corner + across, corner + across + back, corner + back])
    stage.targets.append(Target("light", strength > 0.0, corners))
