"""Checks that need whole rings and whole maps: closure, lights, crossing edges, free space."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.nav.maps.stickrep import fields
from colony.nav.maps.stickrep.fields import LineWord, Problems
from colony.nav.maps.stickrep.geometry import Point, corners, direction, in_free_space, shared_lights, trace
from colony.nav.maps.stickrep.header import Header
from colony.nav.maps.stickrep.model import Edge, EdgeKind, ElevatorLink, Map, Ring, RingLink, RingPosition
from colony.text.source import Span
from colony.text.wording import did_you_mean

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


# --- connections --------------------------------------------------------------------------------------
#
# Reads the `link` and `elevator` lines of a StickRep map, and checks the places that they name.

MAX_ACROSS_MM = 8_000.0
"""Maximum distance between linked places."""
MAX_DISPLACEMENT_MM = 500.0
"""Maximum displacement of two facing places along their corridor."""
_MIN_COSINE = math.cos(math.radians(10.0))  # walls that differ by more are not on the same corridor
_SLACK_MM = 0.1  # maximum rounding error of an offset in a file


@dataclass(frozen=True, slots=True, kw_only=True)
class RingConnections:
    """The links between the rings of a map, and the elevators to other maps."""

    links: tuple[RingLink, ...]
    elevators: tuple[ElevatorLink, ...]


class _LocatedSite(NamedTuple):
    """A site in the plane: its ring, its point, the unit vectors of its walls, and True for a corner."""

    site: RingPosition
    ring: int
    point: Point
    walls: tuple[Point, ...]
    corner: bool


def read_connections(problems: Problems, header: Header, rings: tuple[Ring, ...]) -> RingConnections:
    """Read the links and elevators that a header names; the rings must be valid."""
    reader = _ConnectionReader(problems, header.unit, rings)
    links = [reader.link(*words) for words in header.links]
    elevators = [reader.elevator(*words) for words in header.elevators]
    if elevators and not header.floor:
        message = "the map has `elevator` lines; expected a line that says which floor it is"
        problems.report("M028", header.elevators[0][0].span, message, "add the line `floor NAME`")
    return RingConnections(
        links=tuple(link for link in links if link is not None),
        elevators=tuple(elevator for elevator in elevators if elevator is not None),
    )


def linked_rings(source: Map) -> tuple[tuple[str, ...], ...]:
    """Return the names of the rings, grouped by the links between them, direct or through other rings."""
    ring_of = {node.name: ring.name for ring in source.rings for node in ring.nodes}
    group = {ring.name: {ring.name} for ring in source.rings}
    for first, second in source.links:
        joined = group[ring_of[first.node]] | group[ring_of[second.node]]
        group.update(dict.fromkeys(joined, joined))
    names = [ring.name for ring in source.rings]
    return tuple(
        tuple(name for name in names if name in group[first])
        for first in names
        if first == next(name for name in names if name in group[first])
    )


class _ConnectionReader:
    """Reads links and elevators against the rings of one map, laid out in the plane."""

    def __init__(self, problems: Problems, unit: str, rings: tuple[Ring, ...]) -> None:
        self.problems = problems
        self.unit = unit
        self.rings = rings
        self.outlines = tuple(corners(ring) for ring in rings)
        self.nodes = {node.name: (i, j) for i, ring in enumerate(rings) for j, node in enumerate(ring.nodes)}
        rows = [
            (*a, *b) for nodes in self.outlines for a, b in zip(nodes, (*nodes[1:], nodes[0]), strict=True)
        ]
        self.segments = np.array(rows, dtype=np.float64)

    def link(self, first: LineWord, second: LineWord) -> RingLink | None:
        """Read a link; None, with an error, unless both places exist and the robot can drive between them."""
        site, other = self._locate(first), self._locate(second)
        if site is None or other is None:
            return None
        reason, hint = self._link_problem(site, other)
        if reason:
            message = f"expected two places that face each other; {first.shown} and {second.shown} {reason}"
            self.problems.report("M026", first.span.to(second.span), message, hint)
            return None
        return RingLink(site.site, other.site)

    def elevator(self, node: LineWord, file: LineWord, other: LineWord) -> ElevatorLink | None:
        """Read an `elevator` line; None, with an error, unless an elevator begins at its first node."""
        found = self._node(node, node.text)
        target = fields.name(self.problems, other, "the name of a node")
        if file.text.startswith("/"):
            message = f"the path {file.shown} is absolute; expected one relative to this map's folder"
            self.problems.report("M029", file.span, message)
            return None
        if found is None or target is None:
            return None
        edge = self.rings[found[0]].edges[found[1]]
        if edge.kind is not EdgeKind.ELEVATOR:
            message = f"the edge after {node.shown} is a {edge.kind.name.lower()}; expected an elevator (E)"
            self.problems.report("M027", node.span, message, "name the node where the elevator's edge begins")
            return None
        return ElevatorLink(node.text, file.text, target)

    def _node(self, word: LineWord, name: str) -> tuple[int, int] | None:
        """Return the indices of a node's ring, and of the node in it."""
        found = self.nodes.get(name)
        if found is None:
            hint = did_you_mean(name, self.nodes) or "a node is named in the second field of a row"
            shown = name if len(name) <= 40 else name[:37] + "..."
            self.problems.report("M025", word.span, f"there is no node `{shown}` in this map", hint)
        return found

    def _locate(self, word: LineWord) -> _LocatedSite | None:
        """Return the site named by `NODE` or `NODE+LENGTH`."""
        name, plus, length = word.text.partition("+")
        found = self._node(word, name)
        if found is None:
            return None
        ring, index = found
        edge, nodes = self.rings[ring].edges[index], self.outlines[ring]
        offset: float | None = 0.0
        if plus:
            shift = word.span.start + len(name) + 1
            offset = self._offset(LineWord(length, Span(word.span.source, shift, word.span.end)), name, edge)
        if offset is None:
            return None
        here, there = nodes[index], nodes[(index + 1) % len(nodes)]
        ahead = _unit(here, there)
        walls = (ahead,) if offset > 0.0 else (ahead, _unit(nodes[index - 1], here))
        fraction = offset / edge.length_mm
        point = Point(here.x + fraction * (there.x - here.x), here.y + fraction * (there.y - here.y))
        corner = self.rings[ring].nodes[index].corner and offset == 0.0
        return _LocatedSite(RingPosition(name, offset), ring, point, walls, corner)

    def _offset(self, word: LineWord, name: str, edge: Edge) -> float | None:
        """Return the distance of a place from its node, in mm."""
        what, limit = "the distance from the node", fields.MAX_LENGTH_MM
        offset = fields.length_mm(self.problems, word, what, 0.0, limit, self.unit)
        if offset is not None and not 0.0 <= offset <= edge.length_mm + _SLACK_MM:
            message = (
                f"the place is {offset:.0f} mm after `{name}`; the edge there is {edge.length_mm:.0f} mm long"
            )
            self.problems.report("M026", word.span, message, "name the node where the place's edge begins")
            return None
        return offset

    def _link_problem(self, first: _LocatedSite, second: _LocatedSite) -> tuple[str, str | None]:
        """Return the reason why two places cannot be linked, and a hint; an empty reason if they can be."""
        if first.ring == second.ring:
            return f"are both on ring `{self.rings[first.ring].name}`", "a link joins two rings"
        vector = Point(second.point.x - first.point.x, second.point.y - first.point.y)
        distance = math.hypot(*vector)
        if distance > MAX_ACROSS_MM:
            return f"are {distance / 1000:.1f} m apart", f"expected at most {MAX_ACROSS_MM / 1000:g} m"
        if not (first.corner and second.corner):
            displacement = _displacement(first, second, vector)
            if displacement is None:
                return "are not on opposite walls", "only corners (negative angles) meet across a junction"
            if displacement > MAX_DISPLACEMENT_MM:
                hint = f"expected at most {MAX_DISPLACEMENT_MM:.0f} mm; `NODE+LENGTH` is a place after a node"
                return f"are displaced by {displacement:.0f} mm along the corridor", hint
        middle = Point((first.point.x + second.point.x) / 2, (first.point.y + second.point.y) / 2)
        if crosses_any(self.segments, first.point, second.point) or not in_free_space(self.outlines, *middle):
            return "have a wall between them", None
        return "", None


def _unit(here: Point, there: Point) -> Point:
    length = math.hypot(there.x - here.x, there.y - here.y)
    return Point((there.x - here.x) / length, (there.y - here.y) / length)


def _displacement(first: _LocatedSite, second: _LocatedSite, vector: Point) -> float | None:
    """Return the displacement of two places along opposite walls of a corridor; None for other places.

    Opposite walls are traced in opposite directions, and each has the other on its right.
    """
    smallest: float | None = None
    for u in first.walls:
        for v in second.walls:
            if u.x * v.x + u.y * v.y > -_MIN_COSINE:
                continue
            if vector.x * u.y - vector.y * u.x <= 0.0 or vector.y * v.x - vector.x * v.y <= 0.0:
                continue
            displacement = abs(vector.x * u.x + vector.y * u.y)
            smallest = displacement if smallest is None else min(smallest, displacement)
    return smallest
