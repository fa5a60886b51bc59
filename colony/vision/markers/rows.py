"""Finds markers on elevator doors in an image, row by row (thesis section 5.4.6).

*Edges.* The gradient at a pixel border is the brightness of the pixels after it minus that of those before
it; an edge is a peak of its magnitude above a threshold. Of successive edges of the same sign the strongest
one counts. Since the exposure is unknown, each row is searched with several thresholds.

*Patterns.* A pattern is a run of edges that begins with one from white to black. Its stripes are one unit
wide each, or three where a black bit lies between its separators, so five codes have five patterns of 8, 6 or
4 edges. Seen at an angle, units widen toward one side: the edges of a pattern fit a parabola over the units,
to a small fraction of a unit. Its white stripes are about equally bright, and much brighter than its black
ones, which are about equally dark; beside it there is plain door.

*Rows.* Patterns of neighboring rows with the same code and edges are a marker if their mean edges fit
accurately, if the number of rows is the height of a marker at the distance and angle given by the edges, and
if there are no stripes above and below them. All conditions are needed, as printing, glass bricks and mortar
also have stripes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.signs import (
    MARKER_BITS,
    MARKER_CODES,
    MARKER_WIDTH_MM,
    STRIPE_HEIGHT_MM,
    STRIPE_MM,
    Marker,
)
from colony.nav.pose.pose import MeasurementRow
from colony.runtime.library.robot import Position
from colony.vision.detections import MarkerBox
from colony.vision.gray_images import Gray, gray_image
from colony.vision.level_camera import AHEAD, LevelCamera

# --- pose ---------------------------------------------------------------------------------------------
#
# The position of a camera relative to a marker, from one image, and the resulting pose of the robot.
#
# The edges of a marker are points on a straight line with known distances. An edge seen in column r (in focal
# lengths to the right of the axis) satisfies r (z + t s) = x + t c: x to the right and z ahead is the center
# of the marker, (c, s) its direction, and t the position of the edge along it. This is linear in x, z and s
# for c = 1, so three edges suffice, and more are better. So one image gives the bearing, the distance and, as
# the nearer half of a marker looks wider, the turn of the camera that would face the doors squarely.

EDGE_SIGMA_PX = 0.12
"""Standard deviation of an edge that many rows agree on."""

BEARING_SIGMA_DEG = 0.2
"""Standard deviation of the error of a bearing due to the camera's mounting and the time of the image."""

DISTANCE_SIGMA = 0.01
"""Standard deviation of a distance from the focal length, as a fraction of the distance."""

MAX_SLANT_SIGMA_DEG = 2.0
"""Maximum standard deviation of a marker's slant for a fix of distance and slant.

From farther away, distance and slant cannot be separated, and neither is reported.
"""

MAX_FACING_DEG = 70.0
"""Maximum slant at which a marker is visible."""


_UNITS = 2 * MARKER_BITS + 1


class MarkerPose(NamedTuple):
    """A marker relative to the robot, with standard deviations.

    Attributes:
        bearing_deg: direction of its center, counterclockwise from ahead.
        distance_mm: its distance.
        facing_deg: turn that makes the robot face the doors squarely, counterclockwise.
    """

    bearing_deg: float
    distance_mm: float
    facing_deg: float
    bearing_sigma_deg: float
    distance_sigma_mm: float
    facing_sigma_deg: float

    @property
    def aside_mm(self) -> float:
        """Distance of the robot to the left of the marker's normal, as seen facing the doors."""
        return self.distance_mm * math.sin(math.radians(self.facing_deg - self.bearing_deg))

    @property
    def ahead_mm(self) -> float:
        """Perpendicular distance of the robot from the doors."""
        return self.distance_mm * math.cos(math.radians(self.facing_deg - self.bearing_deg))


def edge_units(code: int) -> tuple[float, ...]:
    """Return the edges of a code's stripes, in units from the marker's left side."""
    black = [True]
    for bit in range(MARKER_BITS):
        black += [bool(code >> (MARKER_BITS - 1 - bit) & 1), True]
    inner = [float(k) for k in range(1, _UNITS) if black[k] != black[k - 1]]
    return (0.0, *inner, float(_UNITS))


def marker_pose(box: MarkerBox, camera: LevelCamera = AHEAD) -> MarkerPose | None:
    """Return the pose of the marker in a box, or None if no marker has such edges."""
    units = edge_units(box.code)
    if len(box.edges) != len(units):
        return None
    edges_mm = (np.array(units) - _UNITS / 2.0) * STRIPE_MM
    rays = (np.array(box.edges) - (camera.columns - 1) / 2.0) / camera.focal
    # r z + t r s - x = t, with c = 1: the unknowns are scaled by 1 / c.
    terms = np.stack([rays, edges_mm * rays, -np.ones_like(rays)], axis=1)
    (ahead, slant, right), _, rank, _ = np.linalg.lstsq(terms, edges_mm, rcond=None)
    if rank < 3 or not ahead > 0.0:
        return None
    cosine = 1.0 / math.hypot(1.0, slant)
    facing = math.degrees(math.atan(slant))
    if abs(facing) > MAX_FACING_DEG:
        return None
    reach = math.hypot(ahead, right)
    distance = reach * cosine
    edge_mm = EDGE_SIGMA_PX / camera.focal * ahead  # an edge's error along the marker
    covariance = np.linalg.inv(terms.T @ terms) * edge_mm**2
    gradient = np.array([ahead / reach, -slant * cosine**2 * reach, right / reach]) * cosine
    distance_error = math.sqrt(gradient @ covariance @ gradient)
    return MarkerPose(
        bearing_deg=camera.yaw_deg - math.degrees(math.atan2(right, ahead)),
        distance_mm=distance,
        facing_deg=camera.yaw_deg + facing,
        bearing_sigma_deg=math.hypot(BEARING_SIGMA_DEG, math.degrees(EDGE_SIGMA_PX / camera.focal)),
        distance_sigma_mm=math.hypot(distance_error, DISTANCE_SIGMA * distance),
        facing_sigma_deg=math.hypot(BEARING_SIGMA_DEG, math.degrees(math.sqrt(covariance[1, 1]) * cosine**2)),
    )


def marker_rows(pose: MarkerPose, marker: Marker, here: Position) -> tuple[MeasurementRow, ...]:
    """Return the measurements of the robot's pose by a known marker.

    They are the bearing and, near the marker, the distance and the heading. `here` is the robot's estimated
    position.
    """
    heading = math.radians(here.heading)
    east, north = marker.center.x - here.x, marker.center.y - here.y
    map_distance = max(math.hypot(east, north), MARKER_WIDTH_MM)
    # The marker is along theta = atan2(-east, north), and seen at theta - heading.
    theta = math.atan2(-east, north)
    bearing_error = math.remainder(math.radians(pose.bearing_deg) + heading - theta, math.tau)
    cx, cy = north / map_distance**2, -east / map_distance**2
    bearing = MeasurementRow(
        cx,
        cy,
        -1.0,
        cx * here.x + cy * here.y - heading + bearing_error,
        math.radians(pose.bearing_sigma_deg),
    )
    ux, uy = -east / map_distance, -north / map_distance
    excess_mm = pose.distance_mm - math.hypot(east, north)
    distance = MeasurementRow(ux, uy, 0.0, ux * here.x + uy * here.y + excess_mm, pose.distance_sigma_mm)
    turned = math.remainder(math.radians(marker.heading_deg - pose.facing_deg) - heading, math.tau)
    facing = MeasurementRow(0.0, 0.0, 1.0, heading + turned, math.radians(pose.facing_sigma_deg))
    return (bearing, distance, facing) if pose.facing_sigma_deg <= MAX_SLANT_SIGMA_DEG else (bearing,)


# --- rows ---------------------------------------------------------------------------------------------

THRESHOLDS = (10.0, 24.0, 48.0)
"""Minimum gradients of an edge, in gray levels; each row is searched with each of them."""

MIN_UNIT = 3.2
"""Minimum width of a unit, in pixels: that of a marker 5.8 m away."""

MAX_MISFIT, MAX_MISFIT_PX = 0.10, 0.45
"""Tolerance of an edge's position in its pattern: a fraction of a unit, plus pixels of measurement error."""

MAX_MEAN_MISFIT, MAX_MEAN_MISFIT_PX = 0.06, 0.12
"""The same tolerance for the mean over all rows."""

MAX_WIDENING = 0.6
"""Maximum relative difference in width between a pattern's last unit and its middle one."""

MIN_CONTRAST, MIN_RATIO = 12.0, 1.6
"""Minimum contrast of white to black stripes: the difference in gray levels, and the ratio."""

MAX_UNEVENNESS = 0.4
"""Maximum difference between white stripes, or between black ones, as a fraction of their contrast."""

MIN_DOOR_CONTRAST = 0.25
"""Minimum contrast of the door beside the stripes to the black ones, as a fraction of their contrast.

`MAX_UNEVENNESS` applies to the door, too.
"""

MIN_ROWS = 4
"""Minimum number of rows of a marker, at any distance."""

_MIN_HEIGHT, _MAX_HEIGHT = 0.7, 1.3  # as fractions of a marker's height at its distance
_MAX_FACING_DEG = 60.0
_MAX_GAP = 3  # rows between two rows with a pattern
_MAX_DRIFT_UNITS = 0.3  # units; the maximum shift of a pattern between such rows
# Units from a marker's side to the two points on the door whose brightness is compared.
_NEAR_UNITS, _FAR_UNITS = 0.5, 1.2
_AROUND_FRACTION = 0.25  # fraction of a marker's height, above and below it

Floats = NDArray[np.float64]
Levels = NDArray[np.float32]


class _Template(NamedTuple):
    """The pattern of a code: its edges, in units from its center, and the projection onto the residuals.

    The residuals are those of a fitted parabola; `solve` gives its offset, slope and curvature.
    """

    code: int
    edges: Floats
    residual: Floats
    solve: Floats


class _Pattern(NamedTuple):
    """A pattern in a row: its code, and the columns of its edges."""

    row: int
    code: int
    edges: tuple[float, ...]
    misfit: float


def find_markers(
    image: NDArray[Any], rows: range | None = None, camera: LevelCamera = AHEAD
) -> tuple[MarkerBox, ...]:
    """Return the markers in an image, from left to right.

    Args:
        image: (height, width) of gray levels, or with a last axis of 1 or 3 channels.
        rows: the contiguous rows to search; the default is the middle half.
        camera: the camera, for its angle of view; the image may be larger than the camera's, or a band of
            rows.

    Raises:
        ValueError: `image` is not such a uint8 array, or does not have these rows.
    """
    gray = gray_image(image)
    height, width = gray.shape
    searched = range(height // 4, height - height // 4) if rows is None else rows
    if searched.step != 1 or not 0 <= searched.start <= searched.stop <= height:
        raise ValueError(f"{searched} of an image of {height} rows; expected neighboring rows that it has")
    if len(searched) < MIN_ROWS or width < _UNITS * MIN_UNIT:
        return ()
    levels = _smoothed(gray[searched.start : searched.stop])
    image_camera = replace(camera, columns=width)
    runs = [run for run in _runs(_patterns(levels)) if _is_marker(run, levels, image_camera)]
    return _without_overlaps([_box(run, searched.start) for run in runs])


# --- edges and patterns of rows ----------------------------------------------------------------------------


def _patterns(levels: Levels) -> list[_Pattern]:
    """Return the patterns of all rows, merged over the thresholds."""
    gradients = _gradients(levels)
    found: dict[tuple[int, int, int], _Pattern] = {}
    rows, columns, values = _peaks(gradients, THRESHOLDS[0])
    for threshold in THRESHOLDS:
        strong = np.abs(values) >= threshold
        edges = _alternating(rows[strong], columns[strong], values[strong])
        for pattern in _matches(edges, levels):
            key = (pattern.row, pattern.code, round(pattern.edges[0]))
            if key not in found or pattern.misfit < found[key].misfit:
                found[key] = pattern
    return sorted(found.values())


def _smoothed(band: Gray) -> Levels:
    """Smooth along the columns to reduce noise; the stripes of markers are upright."""
    levels = band.astype(np.float32)
    padded = np.concatenate([levels[:1], levels, levels[-1:]])
    smoothed: Levels = np.float32(0.25) * (padded[:-2] + padded[2:]) + np.float32(0.5) * levels
    return smoothed


def _gradients(levels: Levels) -> Levels:
    """Return the gradient at each border; column k is that between pixels k + 1 and k + 2."""
    inner = levels[:, 2:-1] - levels[:, 1:-2]
    outer = levels[:, 3:] - levels[:, :-3]
    gradients: Levels = np.float32(0.5) * (inner + outer)
    return gradients


def _peaks(gradients: Levels, threshold: float) -> tuple[NDArray[np.intp], Floats, Levels]:
    """Return the peaks of gradients: rows, columns with subpixel accuracy, and the gradients there."""
    size = np.abs(gradients)
    middle = size[:, 1:-1]
    at = (middle >= threshold) & (middle >= size[:, :-2]) & (middle > size[:, 2:])
    rows, peak_columns = np.nonzero(at)
    before, center, after = (size[rows, peak_columns + k].astype(np.float64) for k in range(3))
    shift = 0.5 * (before - after) / np.minimum(before - 2.0 * center + after, -1e-9)
    return rows, peak_columns + shift + 2.5, gradients[rows, peak_columns + 1]


class _Edges(NamedTuple):
    """Edges in the order of rows and columns; those of a row alternate in sign."""

    rows: NDArray[np.intp]
    columns: Floats
    falls: NDArray[np.bool_]


def _alternating(rows: NDArray[np.intp], columns: Floats, values: Levels) -> _Edges:
    """Keep the strongest of successive edges of a row with the same sign."""
    if len(rows) == 0:
        return _Edges(rows, columns, values < 0.0)
    falls, size = values < 0.0, np.abs(values)
    begins = np.concatenate([[True], (rows[1:] != rows[:-1]) | (falls[1:] != falls[:-1])])
    group = np.cumsum(begins) - 1
    strongest = np.maximum.reduceat(size, np.flatnonzero(begins))
    strongest_edges = np.flatnonzero(size == strongest[group])
    first_of_group = np.unique(group[strongest_edges], return_index=True)[1]
    strongest_edges = strongest_edges[first_of_group]
    return _Edges(rows[strongest_edges], columns[strongest_edges], falls[strongest_edges])


def _matches(edges: _Edges, levels: Levels) -> Iterator[_Pattern]:
    """Return the patterns among the edges of rows."""
    for template in _TEMPLATES:
        count = len(template.edges)
        starts = np.flatnonzero(edges.falls[: max(len(edges.falls) - count + 1, 0)])
        starts = starts[edges.rows[starts] == edges.rows[starts + count - 1]]
        columns = edges.columns[starts[:, None] + np.arange(count)]
        _, unit, curvature = template.solve @ columns.T
        misfit = np.abs(columns @ template.residual.T).max(axis=1, initial=0.0)
        fits = (unit >= MIN_UNIT) & (misfit <= MAX_MISFIT * unit + MAX_MISFIT_PX)
        fits &= np.abs(curvature) * _UNITS <= MAX_WIDENING * unit
        if not fits.any():
            continue
        rows, columns, misfit = edges.rows[starts[fits]], columns[fits], misfit[fits]
        striped = _are_striped(levels, rows, columns)
        for row, peak_columns, residual_px in zip(
            rows[striped], columns[striped], misfit[striped], strict=True
        ):
            yield _Pattern(int(row), template.code, tuple(peak_columns.tolist()), float(residual_px))


def _are_striped(levels: Levels, rows: NDArray[np.intp], columns: Floats) -> NDArray[np.bool_]:
    """Return a mask of the patterns, (n, edges), with black and white stripes between plain door."""
    middles = np.rint((columns[:, 1:] + columns[:, :-1]) / 2.0).astype(np.intp)
    stripes = levels[rows[:, None], middles]
    black, white = stripes[:, ::2], stripes[:, 1::2]
    dark, bright = black.mean(axis=1), white.mean(axis=1)
    contrast = bright - dark
    unevenness = np.maximum(np.ptp(black, axis=1), np.ptp(white, axis=1))
    unit = (columns[:, -1] - columns[:, 0]) / _UNITS
    last = levels.shape[1] - 1
    is_striped = (
        (contrast >= MIN_CONTRAST) & (bright >= MIN_RATIO * dark) & (unevenness <= MAX_UNEVENNESS * contrast)
    )
    for side, sign in ((columns[:, 0], -1.0), (columns[:, -1], 1.0)):
        door = [
            levels[rows, np.clip(np.rint(side + sign * off * unit), 0, last).astype(np.intp)]
            for off in (_NEAR_UNITS, _FAR_UNITS)
        ]
        is_striped &= door[0] - dark >= MIN_DOOR_CONTRAST * contrast
        is_striped &= np.abs(door[0] - door[1]) <= MAX_UNEVENNESS * contrast
    return np.asarray(is_striped, dtype=np.bool_)


# --- markers -----------------------------------------------------------------------------------------------


def _runs(patterns: list[_Pattern]) -> list[list[_Pattern]]:
    """Group similar patterns of neighboring rows."""
    runs: list[list[_Pattern]] = []
    for pattern in patterns:
        run = next((run for run in reversed(runs) if _continues(run[-1], pattern)), None)
        if run is None:
            runs.append([pattern])
        else:
            run.append(pattern)
    return runs


def _continues(last: _Pattern, pattern: _Pattern) -> bool:
    if last.code != pattern.code or not 0 < pattern.row - last.row <= _MAX_GAP:
        return False
    max_shift = 0.5 + _MAX_DRIFT_UNITS * (last.edges[-1] - last.edges[0]) / _UNITS
    return max(abs(a - b) for a, b in zip(last.edges, pattern.edges, strict=True)) <= max_shift


def _is_marker(run: list[_Pattern], levels: Levels, camera: LevelCamera) -> bool:
    """Return True if a run has a marker's exact edges and number of rows, and no stripes around it."""
    box = _box(run, 0)
    edges, template = np.array(box.edges), _TEMPLATES[MARKER_CODES.index(box.code)]
    misfit = float(np.abs(template.residual @ edges).max())
    if misfit > MAX_MEAN_MISFIT * (box.right - box.left) / _UNITS + MAX_MEAN_MISFIT_PX:
        return False
    pose = marker_pose(box, camera)
    if pose is None or abs(pose.facing_deg - camera.yaw_deg) > _MAX_FACING_DEG:
        return False
    depth = pose.distance_mm * math.cos(math.radians(pose.bearing_deg - camera.yaw_deg))
    height, span = camera.focal * STRIPE_HEIGHT_MM / depth, box.last_row - box.first_row + 1
    if len(run) < max(MIN_ROWS, _MIN_HEIGHT * height) or span > _MAX_HEIGHT * height + 1:
        return False
    middles = np.rint((edges[1:] + edges[:-1]) / 2.0).astype(np.intp)
    inside = _contrast(levels[box.first_row : box.last_row + 1, middles].mean(axis=0))
    around = 1 + round(_AROUND_FRACTION * span)
    outside = [row for row in (box.first_row - around, box.last_row + around) if 0 <= row < len(levels)]
    return all(abs(_contrast(levels[row, middles])) <= MAX_UNEVENNESS * inside for row in outside)


def _contrast(stripes: Levels) -> float:
    return float(stripes[1::2].mean() - stripes[::2].mean())


def _box(run: list[_Pattern], first_row: int) -> MarkerBox:
    edges = np.median([pattern.edges for pattern in run], axis=0).tolist()
    return MarkerBox(
        left=edges[0],
        right=edges[-1],
        first_row=first_row + run[0].row,
        last_row=first_row + run[-1].row,
        code=run[0].code,
        edges=tuple(edges),
    )


def _without_overlaps(boxes: list[MarkerBox]) -> tuple[MarkerBox, ...]:
    """Of boxes that share columns, keep the tallest."""
    kept: list[MarkerBox] = []
    for box in sorted(boxes, key=lambda box: box.first_row - box.last_row):
        if all(box.right <= other.left or box.left >= other.right for other in kept):
            kept.append(box)
    return tuple(sorted(kept))


# --- templates ---------------------------------------------------------------------------------------------


def _template(code: int) -> _Template:
    edges = np.array(edge_units(code)) - _UNITS / 2.0
    parabola = np.stack([np.ones_like(edges), edges, edges**2], axis=1)
    solve = np.asarray(np.linalg.pinv(parabola), dtype=np.float64)
    return _Template(code, edges, np.eye(len(edges)) - parabola @ solve, solve)


_TEMPLATES = tuple(_template(code) for code in MARKER_CODES)
