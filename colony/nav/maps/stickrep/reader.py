"""A reader of StickRep maps that reports every error in them.

A file is a header, then rings of rows; `#` begins a comment. The header says, in any order:

    stickrep 1                  the format's version; always the first line
    map NAME
    start X Y HEADING           the default pose of a robot
    unit inch                   unit of all lengths in the file (default inch; mm, cm, m, ft)
    lights incremental          or cumulative: the reference of the lights' offsets (default incremental)
    closure 2                   the largest closure error of a ring (default two inches)
    travel either               or wall-on-left: the direction in which paths follow the rings
                                (default either)
    floor NAME                  the floor's name in its building, if elevators lead to others
    link PLACE PLACE            two places of different rings that face each other, as many lines as needed;
                                a place is NODE, or NODE+LENGTH for a place after it on its edge
    elevator NODE FILE NODE     an elevator's edge here, and the same elevator's in the map of another floor
    hole X Y X Y                two opposite corners of a rectangle in which the floor is missing, as many
                                lines as needed
    dock X Y HEADING            the pose of a robot that stands at a charging dock, as many lines as needed

A ring begins with `ring NAME X Y HEADING`: the position of its first node and the heading of its first edge.
A row for each node and the edge after it follows, with the fields of thesis section 5.1:

    alpha name tau lambda d1 .. d_lambda mu attribute

Codes of errors: M001 cannot be read, M002 not text, M003 not a StickRep map, M004 unknown header line, M005
duplicate header line, M006 header line missing, M007 header line malformed, M008 name, M009 number, M010 row
too short, M011 edge type, M012 lights, M013 row outside a ring, M014 node name twice, M015 ring name twice,
M016 too few edges, M017 does not close in angle, M018 does not close in place, M019 light beyond its edge,
M020 shared lights do not pair, M021 edges cross, M022 start or dock not in free space, M023 too much, M024
traced the wrong way round, M025 no such node, M026 linked places that do not face each other, M027 no
elevator there, M028 floor missing; and of buildings (`building.py`) M029 to M031.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field

from colony.nav.maps.source import load_building_source
from colony.nav.maps.stickrep import fields
from colony.nav.maps.stickrep.checks import (
    MapSpans,
    RingConnections,
    RingSpans,
    check_map,
    check_ring,
    read_connections,
)
from colony.nav.maps.stickrep.fields import (
    LENGTH_UNITS,
    LineWord,
    Problems,
    TooManyProblemsError,
    line_end,
    lines_of_words,
)
from colony.nav.maps.stickrep.header import Header
from colony.nav.maps.stickrep.model import (
    DEFAULT_TOLERANCE_MM,
    Edge,
    Hole,
    Map,
    MapLight,
    MapNode,
    Pose,
    Ring,
    RingPosition,
)
from colony.text.diagnostics import DiagnosticError, error, in_order
from colony.text.source import Source, Span
from colony.text.wording import counted

FORMAT_VERSION = "1"
MAX_LINES = 5_000


def load_map(path: str | os.PathLike[str]) -> Map:
    """Read the map at `path`.

    Raises:
        DiagnosticError: the file cannot be read, or is not a valid map; with all errors found, each with its
            location.
    """
    return read_map(load_building_source(path))


def read_map(source: Source) -> Map:
    """Read a map from its text.

    Raises:
        DiagnosticError: the text is not a valid map; with all errors found, in order, each with its location.
    """
    nul = source.text.find("\0")
    if nul >= 0:
        span = Span(source, nul, nul + 1)
        raise DiagnosticError([error("M002", span, "found a NUL character; expected the text of a map")])
    reader = _Reader(source)
    try:
        result = reader.read()
    except TooManyProblemsError:
        result = None
    if result is None or reader.problems:
        raise DiagnosticError(in_order(reader.problems))
    return result


@dataclass(slots=True, kw_only=True)
class _PartialRing:
    """A ring whose rows are being read; `valid` is False once one of them has an error."""

    header: Span
    name: str
    start: Pose
    valid: bool = True
    nodes: list[MapNode] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)
    node_spans: list[Span] = field(default_factory=list)
    light_spans: list[tuple[Span, ...]] = field(default_factory=list)

    def finish(self) -> Ring:
        return Ring(name=self.name, start=self.start, nodes=tuple(self.nodes), edges=tuple(self.edges))

    def spans(self) -> RingSpans:
        return RingSpans(header=self.header, nodes=tuple(self.node_spans), lights=tuple(self.light_spans))


class _Reader:
    """One pass over the lines of a text, collecting problems."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.problems = Problems()
        self.header = Header(self.problems, source)
        self.rings: list[_PartialRing] = []
        self.node_names: dict[str, Span] = {}

    def read(self) -> Map | None:
        """Read the map; None if there are `problems`."""
        lines = lines_of_words(self.source)
        if not self._is_stickrep(next(lines, None)):
            return None
        # The whole header is read before the rings, whose lengths need the unit.
        for words in self._body(lines):
            if words[0].text == "ring":
                self._ring(words)
            elif words[0].looks_like_number:
                self._row(words)
            elif self.rings:
                self.rings[-1].valid = False
        return self._finish()

    def _is_stickrep(self, first: list[LineWord] | None) -> bool:
        hint = f"a map begins with the line `stickrep {FORMAT_VERSION}`"
        if first is None:
            found = "there are only comments" if self.source.text.strip() else "the text is empty"
            if "\r" in self.source.text and "\n" not in self.source.text:
                hint = "its lines end in CR alone: save the file with LF, or CR and LF, at the end of lines"
            self.problems.report("M003", Span(self.source, 0, 0), f"found no map, {found}", hint)
            return False
        if first[0].text != "stickrep":
            message = f"expected `stickrep {FORMAT_VERSION}`; found {first[0].shown}"
            self.problems.report("M003", first[0].span, message, hint)
            return False
        version = first[1] if len(first) == 2 else None
        if version is None or version.text != FORMAT_VERSION:
            found = f"version {version.shown}" if version else f"{len(first) - 1} words after `stickrep`"
            message = f"expected `stickrep {FORMAT_VERSION}`; found {found}"
            self.problems.report("M003", (version or first[0]).span, message, hint)
            return False
        return True

    def _body(self, lines: Iterator[list[LineWord]]) -> list[list[LineWord]]:
        """Read the header lines, and return all other lines."""
        body: list[list[LineWord]] = []
        for words in lines:
            if not self.header.read_line(words):
                body.append(words)
            header = self.header
            repeated = (header.links, header.elevators, header.holes, header.docks)
            if len(body) + sum(len(found) for found in repeated) > MAX_LINES:
                message = f"expected at most {MAX_LINES} rows, links and ring lines; found one more"
                self.problems.report("M023", words[0].span, message, "split it into several maps")
                raise TooManyProblemsError
        return body

    # Rings and rows

    def _mm(self, word: LineWord, what: str, low_mm: float, high_mm: float) -> float | None:
        return fields.length_mm(self.problems, word, what, low_mm, high_mm, self.header.unit)

    def _pose(self, words: tuple[LineWord, ...] | list[LineWord]) -> Pose | None:
        limit = fields.MAX_COORDINATE_MM
        x = self._mm(words[0], "x", 0.0, limit)
        y = self._mm(words[1], "y", 0.0, limit)
        heading = fields.number_in_range(self.problems, words[2], "the heading", 0.0, 360.0, "degrees")
        if x is None or y is None or heading is None:
            return None
        return Pose(x, y, heading % 360.0)

    def _holes(self) -> tuple[Hole, ...]:
        """Read the holes of the header; those with errors are left out."""
        found: list[Hole] = []
        for words in self.header.holes:
            limit = fields.MAX_COORDINATE_MM
            ends = [self._mm(w, what, 0.0, limit) for w, what in zip(words, "xyxy", strict=True)]
            x0, y0, x1, y1 = ends
            if x0 is None or y0 is None or x1 is None or y1 is None:
                continue
            if x0 == x1 or y0 == y1:
                message = "the hole has no area; expected two opposite corners of a rectangle"
                self.problems.report("M007", words[0].span.to(words[-1].span), message)
                continue
            found.append(Hole(x0, y0, x1, y1))
        return tuple(found)

    def _docks(self) -> list[tuple[Pose, Span]]:
        """Read the docks of the header, each with its place in the text; those with errors are left out."""
        read = ((self._pose(words), words[0].span.to(words[-1].span)) for words in self.header.docks)
        return [(pose, span) for pose, span in read if pose is not None]

    def _ring(self, words: list[LineWord]) -> None:
        values = fields.values(self.problems, words, "ring NAME X Y HEADING")
        name = fields.name(self.problems, values[0], "the ring's name") if values else None
        pose = self._pose(values[1:]) if values else None
        if name is not None and any(name == ring.name for ring in self.rings):
            message = f"there is a ring `{name}` already"
            self.problems.report("M015", words[1].span, message, "names of rings are unique in a map")
        span = words[0].span.to(words[min(1, len(words) - 1)].span)
        ring = _PartialRing(header=span, name=name or "", start=pose or Pose(0.0, 0.0, 0.0))
        ring.valid = name is not None and pose is not None
        self.rings.append(ring)

    def _row(self, words: list[LineWord]) -> None:
        if not self.rings:
            message = f"expected a header line or `ring`; found a row that begins with {words[0].shown}"
            self.problems.report("M013", words[0].span, message, "a ring begins with `ring NAME X Y HEADING`")
            return
        ring = self.rings[-1]
        before = len(self.problems)
        node = self._node(words)
        edge = self._edge(words) if len(words) >= 5 else None
        if len(words) < 5:
            message = f"expected a row of at least 5 fields; found {len(words)}"
            hint = "a row is: angle name type lights [offset ...] length attribute"
            self.problems.report("M010", line_end(words), message, hint)
        if node is None or edge is None or len(self.problems) > before:
            ring.valid = False
            return
        ring.nodes.append(node)
        ring.edges.append(edge)
        ring.node_spans.append(words[1].span)
        ring.light_spans.append(tuple(w.span for w in words[4 : 4 + len(edge.lights)]))

    def _node(self, words: list[LineWord]) -> MapNode | None:
        angle = fields.number_in_range(self.problems, words[0], "the angle", 0.0, 360.0, "degrees")
        if angle is not None and abs(angle) in (0.0, 360.0):
            message = f"the angle is {words[0].shown}; expected one between 0 and 360 degrees, either sign"
            self.problems.report("M009", words[0].span, message, "180 goes straight on")
            angle = None
        elif angle == -180.0:
            message = "a negative angle is a corner; expected an angle other than 180 there"
            self.problems.report("M009", words[0].span, message, "write 180 to go straight on")
            angle = None
        name = fields.name(self.problems, words[1], "the node's name") if len(words) > 1 else None
        if name is not None and name in self.node_names:
            line, _ = self.source.position(self.node_names[name].start)
            message = f"there is a node `{name}` in line {line} already"
            self.problems.report("M014", words[1].span, message, "names of nodes are unique in a map")
        elif name is not None:
            self.node_names[name] = words[1].span
        if angle is None or name is None:
            return None
        return MapNode(name=name, angle_deg=abs(angle), corner=angle < 0)

    def _edge(self, words: list[LineWord]) -> Edge | None:
        kind = fields.edge_kind(self.problems, words[2])
        count = fields.whole_number(self.problems, words[3], "the number of lights", fields.MAX_LIGHTS)
        if count is None:
            return None
        length_index = 4 + count
        if len(words) <= length_index or not words[length_index].looks_like_number:
            place = words[length_index].span if len(words) > length_index else line_end(words)
            numbers = sum(w.looks_like_number for w in words[4 : length_index + 1])
            message = f"expected {counted(count, 'offset')} and a length after the number of lights"
            self.problems.report("M012", place, f"{message}; found {counted(numbers, 'number')}")
            return None
        lights = self._light_offsets(words[4:length_index])
        length = self._mm(words[length_index], "the length", fields.MIN_LENGTH_MM, fields.MAX_LENGTH_MM)
        if kind is None or lights is None or length is None:
            return None
        return Edge(
            kind=kind,
            length_mm=abs(length),
            counted=length > 0,
            lights=lights,
            attribute=" ".join(w.text for w in words[length_index + 1 :]),
        )

    def _light_offsets(self, words: list[LineWord]) -> tuple[MapLight, ...] | None:
        lights: list[MapLight] = []
        last = 0.0
        valid = True
        for word in words:
            offset = self._mm(word, "the light's offset", 0.0, fields.MAX_LENGTH_MM)
            if offset is None:
                valid = False
                continue
            offset_mm = abs(offset) + (last if self.header.light_offsets == "incremental" else 0.0)
            if offset_mm < last:
                message = f"the offset {word.shown} is less than the one before"
                hint = "cumulative offsets all count from the node; `lights incremental` is the other way"
                self.problems.report("M019", word.span, message, hint)
                valid = False
            lights.append(MapLight(offset_mm=offset_mm, shared=word.text.startswith("-")))
            last = offset_mm
        return tuple(lights) if valid else None

    # The whole

    def _finish(self) -> Map | None:
        header = self.header
        start = self._pose(header.start) if header.start else None
        tolerance = self._tolerance()
        holes, docks = self._holes(), self._docks()
        self._check_required_lines()
        for ring in self.rings:
            if ring.valid:
                ring.valid = check_ring(self.problems, ring.finish(), ring.spans(), tolerance)
        rings = tuple(ring.finish() for ring in self.rings)
        valid = bool(rings) and all(ring.valid for ring in self.rings)
        # If a row could not be read, its node is unknown, and correct links to it would be reported.
        none = RingConnections(links=(), elevators=())
        connections = read_connections(self.problems, header, rings) if valid else none
        if start is None or header.start is None or tolerance is None or header.name is None:
            return None
        result = Map(
            name=header.name,
            start=start,
            rings=rings,
            links=connections.links,
            elevators=connections.elevators,
            holes=holes,
            docks=tuple(pose for pose, _ in docks),
            floor=header.floor,
            travel=header.travel,
            tolerance_mm=tolerance,
            unit=header.unit,
            light_offsets=header.light_offsets,
        )
        if valid:
            span = header.start[0].span.to(header.start[-1].span)
            spans = MapSpans(
                start=span,
                docks=tuple(dock_span for _, dock_span in docks),
                rings=tuple(ring.spans() for ring in self.rings),
            )
            check_map(self.problems, result, spans)
        return result

    def _tolerance(self) -> float | None:
        word = self.header.tolerance
        if word is None:
            return DEFAULT_TOLERANCE_MM
        tolerance = self._mm(word, "the closure tolerance", 0.0, fields.MAX_LENGTH_MM)
        if tolerance is not None and tolerance < 0.0:
            message = f"expected a closure tolerance of 0 or more; found {word.shown}"
            self.problems.report("M007", word.span, message)
            return None
        return tolerance

    def _check_required_lines(self) -> None:
        end = Span(self.source, len(self.source.text.rstrip()), len(self.source.text.rstrip()))
        for key, usage in (("map", "map NAME"), ("start", "start X Y HEADING")):
            if key not in self.header.seen:
                self.problems.report("M006", end, f"the header has no line `{usage}`")
        if not self.rings:
            message = "expected at least one ring; found none"
            self.problems.report("M006", end, message, "a ring begins with `ring NAME X Y HEADING`")


# --- writer -------------------------------------------------------------------------------------------
#
# Writes StickRep maps, with the unit and the convention for light offsets that each map names.

_DECIMALS = 6
_COLUMNS = ("# alpha", "node", "type", "lights", "length", "attribute")


def write_map(source: Map) -> str:
    """Return the text of a map; reading it gives the map back, up to the sixth decimal of its unit.

    Reading and writing a written text again reproduces it. Comments are not kept.
    """
    scale = LENGTH_UNITS[source.unit]
    header = [
        f"stickrep {FORMAT_VERSION}",
        f"map {source.name}",
        f"unit {source.unit}",
        f"lights {source.light_offsets}",
        f"closure {_number(source.tolerance_mm / scale)}",
        *([f"floor {source.floor}"] if source.floor else []),
        *([f"travel {source.travel}"] if source.travel != "either" else []),
        f"start {_pose(source.start, scale)}",
    ]
    connections = [f"link {_site(link.first, scale)} {_site(link.second, scale)}" for link in source.links]
    connections += [f"elevator {link.node} {link.file} {link.other_node}" for link in source.elevators]
    connections += [f"hole {' '.join(_number(value / scale) for value in hole)}" for hole in source.holes]
    connections += [f"dock {_pose(dock, scale)}" for dock in source.docks]
    rings = [_ring(ring, scale, source.light_offsets == "cumulative") for ring in source.rings]
    return "\n\n".join(["\n".join(header), *rings, *(["\n".join(connections)] if connections else [])]) + "\n"


def _ring(ring: Ring, scale: float, cumulative: bool) -> str:
    rows = [
        (
            *_node(node),
            edge.kind.value,
            _lights(edge, scale, cumulative),
            _length(edge, scale),
            edge.attribute,
        )
        for node, edge in zip(ring.nodes, ring.edges, strict=True)
    ]
    table = [_COLUMNS, *rows]
    widths = [max(len(row[column]) for row in table) for column in range(len(_COLUMNS))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in table
    ]
    return "\n".join([f"ring {ring.name} {_pose(ring.start, scale)}", *lines])


def _site(site: RingPosition, scale: float) -> str:
    offset = _number(site.offset_mm / scale)
    return site.node if offset == "0" else f"{site.node}+{offset}"


def _pose(pose: Pose, scale: float) -> str:
    # A heading just below 360 may round up to it, and would then be read as 0.
    heading = _number(round(pose.heading_deg, _DECIMALS) % 360.0)
    return f"{_number(pose.x_mm / scale)} {_number(pose.y_mm / scale)} {heading}"


def _node(node: MapNode) -> tuple[str, str]:
    return ("-" if node.corner else "") + _number(node.angle_deg), node.name


def _lights(edge: Edge, scale: float, cumulative: bool) -> str:
    words, last = [str(len(edge.lights))], 0.0
    for light in edge.lights:
        offset = _number((light.offset_mm - last) / scale)
        words.append(f"-{offset}" if light.shared else offset)
        last = 0.0 if cumulative else light.offset_mm
    return " ".join(words)


def _length(edge: Edge, scale: float) -> str:
    return ("" if edge.counted else "-") + _number(edge.length_mm / scale)


def _number(value: float) -> str:
    text = f"{value:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
