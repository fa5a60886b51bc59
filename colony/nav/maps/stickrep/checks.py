"""Checks that need whole rings and whole maps: closure, lights, crossing edges, free space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep.fields import Problems
from colony.nav.maps.stickrep.geometry import Point, corners, direction, in_free_space, shared_lights, trace
from colony.nav.maps.stickrep.model import Map, Ring
from colony.text.source import Span

ANGLE_TOLERANCE_DEG = 0.5
_LIGHT_SLACK_MM = 0.1  # maximum sum of rounding errors of many small offsets
_ROUNDING_MM = 0.001
_BESIDE_MM = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RingSpans:
    """The spans of a ring's elements in the source text; `lights` has one tuple per edge."""

    header: Span
    nodes: tuple[Span, ...]
    lights: tuple[tuple[Span, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSpans:
    """The spans of a map's elements in the source text."""

    start: Span
    docks: tuple[Span, ...]
    rings: tuple[RingSpans, ...]


def check_ring(problems: Problems, ring: Ring, spans: RingSpans, tolerance_mm: float | None) -> bool:
    """Check a ring by itself; return True if it is closed.

    Without a tolerance, the distance between the ring's ends is not checked.
    """
    if len(ring.edges) < 3:
        message = f"expected at least 3 rows in ring `{ring.name}`; found {len(ring.edges)}"
        problems.report("M016", spans.header, message, "a ring is a closed contour")
        return False
    closed = _check_closure(problems, ring, spans, tolerance_mm)
    within = _check_lights_within(problems, ring, spans)
    if closed and within and shared_lights(ring) is None:
        _report_unpaired(problems, ring, spans)
    return closed


def _check_closure(problems: Problems, ring: Ring, spans: RingSpans, tolerance_mm: float | None) -> bool:
    traced = trace(ring)
    if abs(abs(traced.total_turn_deg) - 360.0) > ANGLE_TOLERANCE_DEG:
        message = f"the turns of ring `{ring.name}` add up to {traced.total_turn_deg:g} degrees"
        turns = "an angle of 270 turns right by 90, an angle of 90 turns left by 90"
        expected = "expected -360 (an outline) or 360 (a block)"
        problems.report("M017", spans.header, f"{message}; {expected}", turns)
        return False
    distance = math.hypot(*traced.gap)
    if tolerance_mm is not None and distance > tolerance_mm + _ROUNDING_MM:
        east, north = traced.gap
        message = f"ring `{ring.name}` ends {distance:.0f} mm from where it began"
        message += f"; expected at most {tolerance_mm:.0f} mm"
        axes = [(east, "east", "west"), (north, "north", "south")]
        sides = [_format_offset(*axis) for axis in axes if abs(axis[0]) >= 0.5]
        hint = f"it ends {' and '.join(sides)} of its first node" if sides else None
        problems.report("M018", spans.header, message, hint)
        return False
    return True


def _format_offset(distance: float, positive: str, negative: str) -> str:
    inches = abs(distance) / 25.4
    return f"{abs(distance):.0f} mm ({inches:.1f} inch) {positive if distance >= 0 else negative}"


def _check_lights_within(problems: Problems, ring: Ring, spans: RingSpans) -> bool:
    valid = True
    for edge, light_spans in zip(ring.edges, spans.lights, strict=True):
        for light, span in zip(edge.lights, light_spans, strict=True):
            if light.offset_mm > edge.length_mm + _LIGHT_SLACK_MM:
                message = f"the light is {light.offset_mm:.0f} mm after its node"
                message += f"; the edge is only {edge.length_mm:.0f} mm long"
                hint = "see `lights` in the header: do offsets count from the light before, or from the node?"
                problems.report("M019", span, message, hint if len(edge.lights) > 1 else None)
                valid = False
    return valid


def _report_unpaired(problems: Problems, ring: Ring, spans: RingSpans) -> None:
    shared = [
        span
        for edge, light_spans in zip(ring.edges, spans.lights, strict=True)
        for light, span in zip(edge.lights, light_spans, strict=True)
        if light.shared
    ]
    message = f"expected negative light offsets in pairs; found {len(shared)} in ring `{ring.name}`"
    if len(shared) % 2 == 0:
        message += ", but not every pair is on edges that meet at an angle"
    hint = "a light in a turning space is projected onto two edges that are not parallel, next to each other"
    problems.report("M020", shared[-1], message, hint)


def check_map(problems: Problems, checked: Map, spans: MapSpans) -> None:
    """Check the rings against each other, the start and the docks; each ring must be valid."""
    before = len(problems)
    outlines = tuple(corners(ring) for ring in checked.rings)
    _check_crossings(problems, checked, outlines, spans)
    if len(problems) > before:
        return
    for ring, nodes, ring_spans in zip(checked.rings, outlines, spans.rings, strict=True):
        if not in_free_space(outlines, *_right_of_longest(ring, nodes)):
            message = f"ring `{ring.name}` has its free space on the left; expected its walls there"
            hint = _MISPLACED[trace(ring).total_turn_deg > 0.0]
            problems.report("M024", ring_spans.header, message, hint)
    if len(problems) > before:
        return
    poses = [("start", checked.start, spans.start)]
    poses += [("dock", dock, span) for dock, span in zip(checked.docks, spans.docks, strict=True)]
    for word, pose, span in poses:
        if not in_free_space(outlines, pose.x_mm, pose.y_mm):
            message = f"the {word} is not in free space; expected it inside an outline and outside its blocks"
            hint = f"`{word} X Y HEADING` counts from the same origin as `ring NAME X Y HEADING`"
            problems.report("M022", span, message, hint)


_MISPLACED = {
    False: "it is traced clockwise, as an outline; a block that stands in another ring is traced "
    "counterclockwise, and two outlines must not overlap",
    True: "it is traced counterclockwise, as a block, and must stand in an outline's free space; an outline "
    "is traced clockwise",
}
"""Hints about a ring whose free space is on the wrong side; the key is True for a ring that turns left."""


def _right_of_longest(ring: Ring, nodes: tuple[Point, ...]) -> Point:
    longest = max(range(len(nodes)), key=lambda i: ring.edges[i].length_mm)
    here, there = nodes[longest], nodes[(longest + 1) % len(nodes)]
    right = direction(trace(ring).headings_deg[longest] - 90.0)
    return Point((here.x + there.x) / 2 + _BESIDE_MM * right.x, (here.y + there.y) / 2 + _BESIDE_MM * right.y)


def _check_crossings(
    problems: Problems, checked: Map, outlines: tuple[tuple[Point, ...], ...], spans: MapSpans
) -> None:
    node_spans = [span for ring in spans.rings for span in ring.nodes]
    names = [node.name for ring in checked.rings for node in ring.nodes]
    begins = np.array([p for nodes in outlines for p in nodes])
    ends = np.array([p for nodes in outlines for p in (*nodes[1:], nodes[0])])
    for first, second in crossing_pairs(begins, ends):
        message = f"the edge after `{names[second]}` crosses the edge after `{names[first]}`"
        hint = "edges meet at nodes only: see the angles and lengths of this ring, and where it begins"
        problems.report("M021", node_spans[second], message, hint)


_BLOCK = 256


def crossing_pairs(begins: NDArray[np.float64], ends: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return a pair of indices for each segment that properly crosses an earlier one.

    Args:
        begins: (n, 2) first points of the segments.
        ends: (n, 2) second points. Segments that only touch do not cross.
    """
    pairs: list[tuple[int, int]] = []
    for start in range(0, len(begins), _BLOCK):
        p, q = begins[start : start + _BLOCK, None, :], ends[start : start + _BLOCK, None, :]
        a, b = begins[None, : start + _BLOCK, :], ends[None, : start + _BLOCK, :]
        crosses = (_side_of(p, q, a) * _side_of(p, q, b) < 0) & (_side_of(a, b, p) * _side_of(a, b, q) < 0)
        for i, j in np.argwhere(crosses):
            if j < start + i and (not pairs or pairs[-1][1] != start + i):
                pairs.append((int(j), int(start + i)))
    return pairs


def crosses_any(segments: NDArray[np.float64], begin: Point, end: Point) -> bool:
    """Return True if the segment from `begin` to `end` properly crosses one of `segments`, (n, 4) in mm."""
    p, q = np.array([begin], dtype=np.float64), np.array([end], dtype=np.float64)
    a, b = segments[:, :2], segments[:, 2:]
    crosses = (_side_of(p, q, a) * _side_of(p, q, b) < 0) & (_side_of(a, b, p) * _side_of(a, b, q) < 0)
    return bool(crosses.any())


def _side_of(p: NDArray[np.float64], q: NDArray[np.float64], r: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a positive value where r is left of the line from p to q, negative where right; all (..., 2)."""
    u, v = q - p, r - p
    side: NDArray[np.float64] = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    # Adjacent edges share a corner up to rounding, which counts as touching.
    side[np.abs(side) < 1e-3] = 0.0
    return side
