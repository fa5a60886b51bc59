"""Ceiling lights in scan lines: a few rows of an image of the ceiling (thesis section 5.6).

*Edges.* The gradient at a pixel border is the mean of the pixels after it minus the mean of those before it.
An edge is a peak of its magnitude above a threshold that is derived from the noise of the line, which is
estimated from the differences of neighboring pixels on any ceiling. So dim lights, and lights on a sunlit
ceiling, have edges just like those on a dark ceiling. The edge is at the centroid of the peak, with subpixel
accuracy.

*Lights.* An edge from dark to bright and one from bright to dark are a light if their distance is the length
of a light. A single edge is a light that extends beyond the image if it is so close to the border that the
other edge would be outside the image.

*Fusion.* If the robot's heading is tilted against the corridor by b, the edges of a light shift from line to
line: a point of the ceiling u ahead and v to the left of the robot is u cos b - v sin b ahead along the
corridor, which must be the same for all points of an edge. Lines agree if one tilt explains their edges. A
light is accepted if two lines agree on it. A light in a single line, as seen from far off the middle of
the corridor, is accepted if it is whole and its edges are very clear.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.vision.lights.ceiling_camera import LIGHT_LENGTH_MM, CeilingCameraModel

Lines = NDArray[np.uint8]

GRADIENT_PIXELS = 6
"""Number of pixels on each side of a border that the gradient covers."""

MIN_GRADIENT_SIGMAS = 5.5
"""Minimum gradient of an edge, in standard deviations of the gradient of a line without edges."""

MIN_GRADIENT = 16.0
"""Minimum gradient of an edge in any line, in gray levels: above that of the seams between ceiling tiles."""

STEP_PIXELS = 16
"""Number of pixels on each side over which an edge's step is measured, `_GAP_PIXELS` pixels away from it."""

MIN_STEP_RATIO = 0.6
"""Minimum ratio of an edge's gradient to its step, which rejects soft sunlight, and of its step to its
gradient, which rejects thin lines such as seams."""

MIN_PARTIAL_STRENGTH = 3.0
"""Minimum gradient, in units of the threshold, of a lone edge of a light that extends beyond the image."""

MIN_SINGLE_STRENGTH = 1.3
"""Minimum gradient, in units of the threshold, of the edges of a light in a single line."""

MAX_TILT_DEG = 25.0
"""Maximum tilt of the heading against the corridor that lines may agree on."""

_LENGTH_TOLERANCE_MM = 45.0
_AGREEMENT_MM = 30.0
_STRONG_GRADIENT = 4.0
_MAD_TO_SIGMA = 1.4826
_MAX_EDGES = 12
_GAP_PIXELS = 3
_OFFSETS = np.arange(-GRADIENT_PIXELS, GRADIENT_PIXELS + 1, dtype=np.float64)


class LineLight(NamedTuple):
    """A light in one line: the positions of its edges in mm ahead of the robot; None outside the image.

    `strength` is the gradient of its weaker edge in units of the threshold. `quality` in [0, 1] rates the
    clarity of its edges and the fit of its length; it is at most 0.5 for a light with one edge.
    """

    near_mm: float | None
    far_mm: float | None
    strength: float
    quality: float


class SeenLight(NamedTuple):
    """A ceiling light whose center is `ahead_mm` ahead of the robot along the corridor; negative behind it.

    `tilt_deg` is the robot's heading minus the corridor's, counterclockwise; None if the lines do not show
    it; `lines` is the number of lines that agree on it, `whole` is True if both of its edges are visible,
    `quality` is in [0, 1].
    """

    ahead_mm: float
    tilt_deg: float | None
    lines: int
    whole: bool
    quality: float


class _Edge(NamedTuple):
    """An edge at `column`, a fractional number; `rise` is its signed gradient in units of the threshold."""

    column: float
    rise: float


def ceiling_lights(
    lines: Lines, camera: CeilingCameraModel, *, tilt_deg: float = 0.0
) -> tuple[SeenLight, ...]:
    """Return the lights that the lines agree on, best first, none overlapping a better one.

    Args:
        lines: n x columns, the scan lines of the camera.
        camera: the camera.
        tilt_deg: tilt of the heading against the corridor by other sources, for lights that do not show it.
    """
    lefts_mm = [camera.left_of(row) for row in camera.scan_rows]
    found = line_lights(lines, camera)
    if not any(found):
        return ()
    candidates = [candidate for candidate in _candidates(found, lefts_mm, tilt_deg) if candidate is not None]
    chosen: list[SeenLight] = []
    for light in sorted(candidates, key=lambda light: -light.quality):
        if all(abs(light.ahead_mm - other.ahead_mm) > LIGHT_LENGTH_MM for other in chosen):
            chosen.append(light)
    return tuple(chosen)


def line_lights(lines: Lines, camera: CeilingCameraModel) -> tuple[tuple[LineLight, ...], ...]:
    """Return the lights in each single line.

    Raises:
        ValueError: the lines are not as long as the camera's.
    """
    if lines.ndim != 2 or lines.shape[1] != camera.columns:
        raise ValueError(f"lines of shape {lines.shape}; expected (lines, {camera.columns})")
    return tuple(_find_lights(edges, camera) for edges in _edges(lines))


# --- edges -----------------------------------------------------------------------------------------


def _edges(lines: Lines) -> list[list[_Edge]]:
    """Return the edges of each line, in the order of their columns."""
    sums = np.zeros((lines.shape[0], lines.shape[1] + 1))
    np.cumsum(lines, axis=1, out=sums[:, 1:])
    gradient = (
        sums[:, 2 * GRADIENT_PIXELS :]
        - 2.0 * sums[:, GRADIENT_PIXELS:-GRADIENT_PIXELS]
        + sums[:, : -2 * GRADIENT_PIXELS]
    ) / GRADIENT_PIXELS
    scaled = gradient / _min_gradients(lines)[:, None]
    magnitude = np.abs(scaled)
    peak = magnitude > 1.0
    peak[:, 1:] &= magnitude[:, 1:] >= magnitude[:, :-1]
    peak[:, :-1] &= magnitude[:, :-1] > magnitude[:, 1:]
    peak[:, [0, -1]] = False  # the true peak may be outside the image
    line, border = np.nonzero(peak)
    height, step = gradient[line, border], _steps(sums, line, border + GRADIENT_PIXELS)
    sharp = (
        (height * step > 0.0)
        & (abs(height) >= MIN_STEP_RATIO * abs(step))
        & (abs(step) >= MIN_STEP_RATIO * abs(height))
    )
    found: list[list[_Edge]] = [[] for _ in lines]
    for row, at in zip(line[sharp].tolist(), border[sharp].tolist(), strict=True):
        found[row].append(_refine(gradient[row], at, float(scaled[row, at])))
    return [_separate(edges) for edges in found]


def _min_gradients(lines: Lines) -> NDArray[np.float64]:
    """Return the minimum gradient of an edge in each line, from the noise of neighboring pixels."""
    steps = np.abs(np.diff(lines.astype(np.int16), axis=1))
    # The median of whole gray levels is coarse: half a level is added for the rounding.
    middle = steps.shape[1] // 2
    noise = (np.partition(steps, middle, axis=1)[:, middle] + 0.5) * (_MAD_TO_SIGMA / math.sqrt(2.0))
    thresholds: NDArray[np.float64] = np.maximum(
        MIN_GRADIENT, MIN_GRADIENT_SIGMAS * math.sqrt(2.0 / GRADIENT_PIXELS) * noise
    )
    return thresholds


def _steps(
    sums: NDArray[np.float64], line: NDArray[np.intp], border: NDArray[np.intp]
) -> NDArray[np.float64]:
    """Return the change of the level across borders, between `STEP_PIXELS` pixels before and after them.

    Fewer pixels are used at the ends of the image. Border i is between columns i - 1 and i.
    """
    last = sums.shape[1] - 1
    after, before = np.minimum(border + _GAP_PIXELS, last - 1), np.maximum(border - _GAP_PIXELS, 1)
    end, first = np.minimum(after + STEP_PIXELS, last), np.maximum(before - STEP_PIXELS, 0)
    above = (sums[line, end] - sums[line, after]) / (end - after)
    below = (sums[line, before] - sums[line, first]) / (before - first)
    step: NDArray[np.float64] = above - below
    return step


def _refine(gradient: NDArray[np.float64], border: int, rise: float) -> _Edge:
    """Return an edge at the centroid of the gradient around its peak, which is a triangle for a step."""
    half = min(GRADIENT_PIXELS - 1, border, len(gradient) - 1 - border)
    weights = np.maximum(gradient[border - half : border + half + 1] * math.copysign(1.0, rise), 0.0)
    center = border + float(weights @ _OFFSETS[GRADIENT_PIXELS - half : GRADIENT_PIXELS + half + 1]) / float(
        weights.sum()
    )
    return _Edge(center + GRADIENT_PIXELS - 0.5, rise)


def _separate(edges: list[_Edge]) -> list[_Edge]:
    """Keep the strongest of the edges of one sign within `GRADIENT_PIXELS`, and a limited number in all."""
    kept: list[_Edge] = []
    for edge in sorted(edges, key=lambda edge: -abs(edge.rise))[:_MAX_EDGES]:
        if all(abs(edge.column - k.column) > GRADIENT_PIXELS or edge.rise * k.rise < 0.0 for k in kept):
            kept.append(edge)
    return sorted(kept)


# --- lights of a line ------------------------------------------------------------------------------


def _find_lights(edges: list[_Edge], camera: CeilingCameraModel) -> tuple[LineLight, ...]:
    """Return the pairs of edges that are lights; if there are none, the single edges of partial lights."""
    lights = [
        light
        for near in edges
        if near.rise > 0.0
        for far in edges
        if far.rise < 0.0 and (light := _pair(near, far, camera)) is not None
    ]
    if lights:
        return tuple(lights)
    return tuple(light for edge in edges if (light := _partial(edge, camera)) is not None)


def _pair(near: _Edge, far: _Edge, camera: CeilingCameraModel) -> LineLight | None:
    length_mm = (far.column - near.column) * camera.mm_per_column
    excess = max(LIGHT_LENGTH_MM - length_mm, length_mm - _max_length_mm(), 0.0)
    if excess > _LENGTH_TOLERANCE_MM:
        return None
    strength = min(near.rise, -far.rise)
    quality = min(1.0, strength / _STRONG_GRADIENT) * (1.0 - excess / _LENGTH_TOLERANCE_MM)
    # The two edges of a light have equal gradients; those of different objects seldom do.
    quality *= strength / max(near.rise, -far.rise)
    return LineLight(camera.ahead_of(near.column), camera.ahead_of(far.column), strength, quality)


def _partial(edge: _Edge, camera: CeilingCameraModel) -> LineLight | None:
    if abs(edge.rise) < MIN_PARTIAL_STRENGTH:
        return None
    at_mm = camera.ahead_of(edge.column)
    max_length = _max_length_mm() + _LENGTH_TOLERANCE_MM
    quality = 0.5 * min(1.0, abs(edge.rise) / _STRONG_GRADIENT)
    if edge.rise > 0.0 and at_mm + max_length > camera.ahead_of(camera.columns - 1.0):
        return LineLight(at_mm, None, edge.rise, quality)
    if edge.rise < 0.0 and at_mm - max_length < camera.ahead_of(0.0):
        return LineLight(None, at_mm, -edge.rise, quality)
    return None


def _max_length_mm() -> float:
    return LIGHT_LENGTH_MM / math.cos(math.radians(MAX_TILT_DEG))


# --- agreement -------------------------------------------------------------------------------------


def _candidates(
    found: tuple[tuple[LineLight, ...], ...], lefts_mm: list[float], tilt_deg: float
) -> list[SeenLight | None]:
    """Return the candidates from each line, each pair of lines and all lines together."""
    all_line_lights = [
        (light, left) for lights, left in zip(found, lefts_mm, strict=True) for light in lights
    ]
    candidates = [_single_line_light(light, left, tilt_deg, len(lefts_mm)) for light, left in all_line_lights]
    groups = (
        group for count in range(2, len(lefts_mm) + 1) for group in combinations(all_line_lights, count)
    )
    candidates += [_fuse(group, tilt_deg, len(lefts_mm)) for group in groups if _of_different_lines(group)]
    return candidates


def _of_different_lines(group: tuple[tuple[LineLight, float], ...]) -> bool:
    return len({left for _, left in group}) == len(group)


def _single_line_light(light: LineLight, left_mm: float, tilt_deg: float, lines: int) -> SeenLight | None:
    if light.near_mm is None or light.far_mm is None or light.strength < MIN_SINGLE_STRENGTH:
        return None
    tilt = math.radians(tilt_deg)
    center = (light.near_mm + light.far_mm) / 2.0
    ahead = center * math.cos(tilt) - left_mm * math.sin(tilt)
    return SeenLight(ahead, None, 1, True, light.quality / lines)


def _fuse(group: tuple[tuple[LineLight, float], ...], tilt_deg: float, lines: int) -> SeenLight | None:
    """Return the light that these lines see, if one tilt explains all of their edges."""
    near = [(light.near_mm, left) for light, left in group if light.near_mm is not None]
    far = [(light.far_mm, left) for light, left in group if light.far_mm is not None]
    slope = _slope(near, far)
    tilt = math.radians(tilt_deg) if slope is None else math.atan(slope)
    if abs(tilt) > math.radians(MAX_TILT_DEG):
        return None
    cosine, sine = math.cos(tilt), math.sin(tilt)
    half = LIGHT_LENGTH_MM / 2.0
    centers = [u * cosine - v * sine + half for u, v in near] + [u * cosine - v * sine - half for u, v in far]
    ahead = sum(centers) / len(centers)
    spread = max(abs(center - ahead) for center in centers)
    if spread > _AGREEMENT_MM:
        return None
    fit = 1.0 - spread / _AGREEMENT_MM
    quality = sum(light.quality for light, _ in group) / lines * (0.5 + 0.5 * fit)
    measured = None if slope is None else math.degrees(tilt)
    return SeenLight(ahead, measured, len(group), bool(near) and bool(far), quality)


def _slope(near: list[tuple[float, float]], far: list[tuple[float, float]]) -> float | None:
    """Return the shift of the edges ahead per mm to the left: least squares, with an offset per edge."""
    products = squares = 0.0
    for points in (near, far):
        if len(points) > 1:
            u_mean = sum(u for u, _ in points) / len(points)
            v_mean = sum(v for _, v in points) / len(points)
            products += sum((u - u_mean) * (v - v_mean) for u, v in points)
            squares += sum((v - v_mean) ** 2 for _, v in points)
    return products / squares if squares > 0.0 else None
