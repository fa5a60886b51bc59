"""Walls with door plates, drawn without the simulator: for tests of what finds and reads them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pictures
from PIL import ImageDraw, ImageFont

from colony.nav.maps.signs import CHARACTER_HEIGHT_MM, PLATE_HEIGHT_MM, PLATE_WIDTH_MM, SIGN_HEIGHT_MM
from colony.vision.gray_images import Gray
from colony.vision.level_camera import SIDE, LevelCamera
from studies.thesis.wall_view import WallView

_MM = 2.5  # of wall a pixel of its texture
_BELOW_MM, _ABOVE_MM = 500.0, 2600.0
_SUPER = 3
_MARGIN_MM = 40.0  # both margins at least


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A rectangle on the wall: its middle along the wall, to the left, and its size, in mm; how bright it is
    and what is written on it in how bright characters, from 0 to 255, line by line."""

    place_mm: float
    above_floor_mm: float = SIGN_HEIGHT_MM
    width_mm: float = PLATE_WIDTH_MM
    height_mm: float = PLATE_HEIGHT_MM
    shade: int = 18
    ink: int = 230
    text: tuple[str, ...] = ()
    character_mm: float = CHARACTER_HEIGHT_MM


def plate(text: str, place_mm: float = 0.0) -> Board:
    """A door plate."""
    return Board(place_mm=place_mm, text=(text,))


def wall_image(
    boards: Sequence[Board],
    view: WallView,
    camera: LevelCamera = SIDE,
    *,
    wall: int = 150,
    gain: float = 1.0,
    blur: float = 0.7,
    noise: float = 2.5,
    seed: int = 0,
) -> Gray:
    """What a camera sees of a wall; gray levels are multiplied by `gain`, `blur` is in pixels."""
    rng = np.random.default_rng(seed)
    half = (1.4 if abs(view.tilt_deg) < 20.0 else 3.0) * view.distance_mm + 500.0
    texture = _texture(boards, half, wall, rng)
    big = (camera.columns * _SUPER, camera.rows * _SUPER)
    spots = [(-half, _BELOW_MM), (-half, _ABOVE_MM), (half, _BELOW_MM), (half, _ABOVE_MM)]
    # Only what is ahead of the camera can be projected.
    spots = [(_ahead(place, view), height) for place, height in spots]
    source = np.array([_texel(place, height, half) for place, height in spots], dtype=np.float32)
    target = np.array([_pixel(place, height, view, camera) for place, height in spots], dtype=np.float32)
    transform = cv2.getPerspectiveTransform(source, target)
    image = cv2.warpPerspective(texture, transform, big, flags=cv2.INTER_LINEAR, borderValue=wall)
    image = cv2.resize(image, (camera.columns, camera.rows), interpolation=cv2.INTER_AREA)
    if blur > 0.0:
        image = cv2.GaussianBlur(image, (0, 0), blur)
    noisy = image.astype(np.float64) * gain + noise * rng.standard_normal(image.shape)
    level: Gray = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return level


def corners_of(board: Board, view: WallView, camera: LevelCamera = SIDE) -> NDArray[np.float64]:
    """Where the corners of a board are in the image, from the upper left one clockwise: (4, 2)."""
    w, h = board.width_mm / 2.0, board.height_mm / 2.0
    corners = []
    for side, up in ((w, h), (-w, h), (-w, -h), (w, -h)):
        corners.append(_seen(board.place_mm + side, board.above_floor_mm + up, view, camera))
    return np.array(corners)


def _seen(place_mm: float, above_floor_mm: float, view: WallView, camera: LevelCamera) -> tuple[float, float]:
    """The column and the row in which a place of the wall is seen."""
    column = view.column_of(camera, place_mm)
    depth_mm = math.hypot(place_mm, view.distance_mm) * math.cos(math.radians(camera.bearing_of(column)))
    return column, camera.row_of(above_floor_mm, depth_mm)


def _ahead(place_mm: float, view: WallView) -> float:
    """The place, or one nearer to the middle of the image, in front of the camera."""
    most = view.distance_mm * np.tan(np.radians(np.array([-85.0, 85.0]) + view.tilt_deg).clip(-1.48, 1.48))
    return float(np.clip(place_mm, *most))


def _texel(place_mm: float, above_floor_mm: float, half_mm: float) -> tuple[float, float]:
    return (half_mm - place_mm) / _MM - 0.5, (_ABOVE_MM - above_floor_mm) / _MM - 0.5


def _pixel(
    place_mm: float, above_floor_mm: float, view: WallView, camera: LevelCamera
) -> tuple[float, float]:
    """In the image that is `_SUPER` times as large."""
    column, row = _seen(place_mm, above_floor_mm, view, camera)
    return (column + 0.5) * _SUPER - 0.5, (row + 0.5) * _SUPER - 0.5


def _texture(boards: Sequence[Board], half: float, wall: int, rng: np.random.Generator) -> Gray:
    rows, columns = round((_ABOVE_MM - _BELOW_MM) / _MM), round(2.0 * half / _MM)
    coarse = rng.standard_normal((rows // 40 + 1, columns // 40 + 1)).astype(np.float32)
    rough = wall + 3.0 * cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC)
    texture: Gray = np.clip(rough, 0, 255).astype(np.uint8)
    for board in boards:
        width, height = round(board.width_mm / _MM), round(board.height_mm / _MM)
        x, y = _texel(
            board.place_mm + board.width_mm / 2.0, board.above_floor_mm + board.height_mm / 2.0, half
        )
        left, top = round(x + 0.5), round(y + 0.5)
        face = _face(board, width, height)[max(-top, 0) :, max(-left, 0) :]
        part = texture[max(top, 0) : max(top + height, 0), max(left, 0) : max(left + width, 0)]
        part[:] = face[: part.shape[0], : part.shape[1]]
    return texture


def _face(board: Board, width: int, height: int) -> Gray:
    face = np.full((height, width), board.shade, dtype=np.uint8)
    font = _font(round(board.character_mm / _MM))
    for number, line in enumerate(board.text):
        x0, y0, x1, y1 = (round(n) for n in font.getbbox(line))
        picture = Pictures.new("L", (x1 - x0, y1 - y0), board.shade)
        ImageDraw.Draw(picture).text((-x0, -y0), line, font=font, fill=board.ink)
        written = np.asarray(picture, dtype=np.uint8)
        most = width - round(_MARGIN_MM / _MM)
        if written.shape[1] > most:  # narrower characters
            written = np.asarray(
                cv2.resize(written, (most, len(written)), interpolation=cv2.INTER_AREA), np.uint8
            )
        top = round(height * (number + 0.5) / len(board.text) - written.shape[0] / 2.0)
        left = (width - written.shape[1]) // 2
        face[top : top + written.shape[0], left : left + written.shape[1]] = written
    return face


@lru_cache(maxsize=8)
def _font(height: int) -> ImageFont.FreeTypeFont:
    """Pillow's own font, with capitals of a height in pixels."""
    font = ImageFont.load_default(100)
    assert isinstance(font, ImageFont.FreeTypeFont)
    _, top, _, bottom = font.getbbox("H")
    scaled = ImageFont.load_default(100.0 * height / (bottom - top))
    assert isinstance(scaled, ImageFont.FreeTypeFont)
    return scaled
