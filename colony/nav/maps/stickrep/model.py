"""StickRep maps: a building as rings of walls, doors and elevators, with the ceiling lights above them.

A ring is a closed contour, traced with the walls on the left hand: the outline of a floor runs clockwise, a
block standing in it counterclockwise, and the free space lies to the right of every edge. A node is a
vertical edge of the building (a corner, a door jamb); an edge is the stretch between two nodes. Source:
thesis section 5.1, after Walsh 1992.

In files lengths are in the unit that the header names (inches, traditionally); here they are floats in
millimeters. Headings count counterclockwise from north, in degrees: 0 is north (+y), 90 west (-x).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Literal, NamedTuple

LightOffsets = Literal["incremental", "cumulative"]
"""Reference of the offsets of an edge's lights in a file: the previous light, or the node."""

Travel = Literal["either", "wall-on-left"]
"""Direction in which paths follow the rings: both ways, or only with the wall on the left hand."""

DEFAULT_TOLERANCE_MM = 50.8
"""Default tolerance of a ring's closure error: two inches, the tolerance of a brick."""


class EdgeKind(Enum):
    """The kind of an edge; the value is its letter in a file."""

    WALL = "W"
    DOOR = "D"
    ELEVATOR = "E"


class Pose(NamedTuple):
    """A position and a heading: x east and y north in mm, heading in degrees counterclockwise from north."""

    x_mm: float
    y_mm: float
    heading_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MapLight:
    """A ceiling light's projection onto an edge, `offset_mm` after the edge's node.

    A `shared` light hangs in a turning space, where corridors meet, and is projected onto two edges; its
    two projections are one light.
    """

    offset_mm: float
    shared: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class MapNode:
    """A vertical edge of the building, where the edge stored with it begins.

    `angle_deg` is measured counterclockwise from the next edge to the previous one, in (0, 360): 180 along
    a straight wall. A `corner` is a node where the corridor itself changes direction, unlike the jambs of an
    alcove.
    """

    name: str
    angle_deg: float
    corner: bool = False

    @property
    def turn_deg(self) -> float:
        """Turn of the ring at this node, counterclockwise: 270 degrees is a right turn of 90 (-90)."""
        return 180.0 - self.angle_deg


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """The stretch between one node and the next.

    Edges that are not `counted`, such as the sides of an alcove, are part of the building, but not of the
    length of a path. `attribute` is a remark on the surface.
    """

    kind: EdgeKind
    length_mm: float
    counted: bool = True
    lights: tuple[MapLight, ...] = ()
    attribute: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ring:
    """A closed contour: edge i leads from node i to node i + 1, the last one back to node 0.

    `start` is the position of node 0 and the heading of edge 0.
    """

    name: str
    start: Pose
    nodes: tuple[MapNode, ...]
    edges: tuple[Edge, ...]

    @property
    def path_length_mm(self) -> float:
        """The length once around: the sum of the counted edges."""
        return sum(edge.length_mm for edge in self.edges if edge.counted)


class RingPosition(NamedTuple):
    """A position on a ring: a node, or `offset_mm` after it on its edge."""

    node: str
    offset_mm: float = 0.0


class RingLink(NamedTuple):
    """Two positions on different rings between which the robot can drive.

    They face each other across a corridor, or are corners of one turning space. A path may change rings
    there, and the distance across is not counted (thesis section 5.1.1, where rings are not linked, and 7.2).
    """

    first: RingPosition
    second: RingPosition


class ElevatorLink(NamedTuple):
    """The elevator that begins at `node` is the one that begins at `other_node` of the map in `file`.

    `file` is a path relative to the folder of this map.
    """

    node: str
    file: str
    other_node: str


class Hole(NamedTuple):
    """A rectangle in which the floor is missing, by two opposite corners, in mm."""

    x0_mm: float
    y0_mm: float
    x1_mm: float
    y1_mm: float

    def corners(self) -> tuple[tuple[float, float], ...]:
        """Return the corners, once around."""
        x0, y0, x1, y1 = self
        return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Map:
    """The map of one floor. `start` is the default pose of a robot, `docks` those of robots that are docked.

    `floor` is the name of the floor in its building, such as "3", or empty if not needed. `unit` and
    `light_offsets` only affect how the map is written to a file.
    """

    name: str
    start: Pose
    rings: tuple[Ring, ...]
    links: tuple[RingLink, ...] = ()
    elevators: tuple[ElevatorLink, ...] = ()
    holes: tuple[Hole, ...] = ()
    docks: tuple[Pose, ...] = ()
    floor: str = ""
    travel: Travel = "either"
    tolerance_mm: float = DEFAULT_TOLERANCE_MM
    unit: str = "inch"
    light_offsets: LightOffsets = "incremental"

    def edges(self) -> Iterator[Edge]:
        """Return all edges, ring by ring, in the order of the file."""
        for ring in self.rings:
            yield from ring.edges

    def count(self, kind: EdgeKind) -> int:
        """Return the number of edges of one kind."""
        return sum(edge.kind is kind for edge in self.edges())
