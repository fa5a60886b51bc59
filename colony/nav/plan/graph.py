"""The routes through a building as a directed graph, and the shortest of them.

On a map that is traveled with the wall on the left, positions are on rings, and a route follows the rings in
the direction in which they are traced; its length is that of the counted edges. It changes rings only at
links, and never between two nodes of one ring (thesis sections 5.1 and 6.1). On a map that is traveled either
way, positions are on the centerlines of corridors, and a route changes corridors in turning spaces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import networkx as nx

from colony.nav.maps.corridors import Corridor, TurningSpace, corridors_of, turning_spaces_of
from colony.nav.maps.stickrep.geometry import Point, corners, trace
from colony.nav.maps.stickrep.model import Map, Travel
from colony.nav.maps.walls import lights_of

_HOP_MM = 0.001  # cost per step, to prefer the fewest steps among equally long routes
_TURN_MM = 0.1
_RIDE_MM = 20_000.0
"""Cost of an elevator ride, in mm of travel."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloorLayout:
    """A floor's map, with the geometry derived from it.

    Attributes:
        source: the map.
        nodes: positions of the nodes, a tuple per ring.
        headings_deg: headings of the edges, a tuple per ring.
        corridors, spaces: corridors and turning spaces, as found by `colony/nav/maps/corridors.py`.
        lights: (x, y) of the ceiling lights in mm.
        corridors_of_edge: indices of the corridors that an edge bounds, by the edge's (ring, edge).
    """

    source: Map
    nodes: tuple[tuple[Point, ...], ...]
    headings_deg: tuple[tuple[float, ...], ...]
    corridors: tuple[Corridor, ...]
    spaces: tuple[TurningSpace, ...]
    lights: tuple[Point, ...]
    corridors_of_edge: Mapping[tuple[int, int], tuple[int, ...]]

    def corridor_at(self, ring: int, edge: int) -> int | None:
        """Return the corridor that an edge bounds; of several, the one nearest to the edge's center."""
        found = self.corridors_of_edge.get((ring, edge), ())
        if len(found) < 2:
            return found[0] if found else None
        here, there = self.nodes[ring][edge], self.nodes[ring][(edge + 1) % len(self.nodes[ring])]
        middle = Point((here.x + there.x) / 2, (here.y + there.y) / 2)
        return min(found, key=lambda i: _distance_beyond(self.corridors[i], middle))

    def corridor_of_node(self, ring: int, node: int) -> int | None:
        """Return the corridor bounded by the edge after a node, or else by the edge before it."""
        after = self.corridor_at(ring, node)
        return after if after is not None else self.corridor_at(ring, (node - 1) % len(self.nodes[ring]))

    def with_skipped(self, corridors: tuple[int, ...]) -> tuple[int, ...]:
        """Insert the corridors that a route skips when it changes rings in a turning space.

        Nothing is inserted between corridors that are not connected by turning spaces.
        """
        graph = nx.Graph(space.corridors for space in self.spaces)
        chain = list(corridors[:1])
        for here, there in pairwise(corridors):
            between = [there]
            if here in graph and there in graph and nx.has_path(graph, here, there):
                between = nx.shortest_path(graph, here, there)[1:]
            chain += between
        return tuple(chain)


@lru_cache(maxsize=32)
def layout_of(source: Map) -> FloorLayout:
    """Derive the layout of a map, once for each map."""
    corridors = corridors_of(source)
    corridors_of_edge: dict[tuple[int, int], tuple[int, ...]] = {}
    for i, corridor in enumerate(corridors):
        for edge in corridor.edges:
            corridors_of_edge[edge] = (*corridors_of_edge.get(edge, ()), i)
    return FloorLayout(
        source=source,
        nodes=tuple(corners(ring) for ring in source.rings),
        headings_deg=tuple(trace(ring).headings_deg for ring in source.rings),
        corridors=corridors,
        spaces=turning_spaces_of(corridors),
        lights=tuple(Point(float(x), float(y)) for x, y in lights_of(source)),
        corridors_of_edge=corridors_of_edge,
    )


def _distance_beyond(corridor: Corridor, at: Point) -> float:
    along = corridor.along(at.x, at.y)
    return max(-along, along - corridor.length_mm, 0.0)


class NodeIndex(NamedTuple):
    """A node of a building, by its indices: of the floor, of the ring, and of the node on the ring."""

    floor: int
    ring: int
    node: int


@dataclass(frozen=True, slots=True)
class ElevatorRide:
    """An elevator ride between the doors at two nodes, in either direction."""

    first: NodeIndex
    second: NodeIndex


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """The part of a route on one floor, from node to node.

    `corridors` are the indices of the corridors on it, `length_mm` is its counted length.
    """

    origin: NodeIndex
    goal: NodeIndex
    corridors: tuple[int, ...]
    length_mm: float


Route = tuple[Stretch | ElevatorRide, ...]
"""The parts of a route, in order; an elevator ride joins two floors."""


@dataclass(frozen=True, slots=True, order=True)
class _RingPosition:
    floor: int
    ring: int
    edge: int
    offset_mm: float


@dataclass(frozen=True, slots=True, order=True)
class _CorridorPosition:
    floor: int
    corridor: int
    along_mm: float


def shortest_route(
    layouts: tuple[FloorLayout, ...],
    rides: tuple[ElevatorRide, ...],
    origin: NodeIndex,
    goal: NodeIndex,
    travel: Travel | None,
) -> Route | None:
    """Return the shortest route from node to node, or None if there is none.

    A route between nodes of the same floor uses elevators only if there is no route on the floor.

    Args:
        layouts: the layouts of all floors.
        rides: the elevator rides between them.
        origin: the node where the route begins.
        goal: the node where it ends.
        travel: direction of travel on all floors; None for that of each floor's map.
    """
    if origin.floor == goal.floor:
        route = _shortest(layouts, (), origin, goal, travel)
        if route is not None:
            return route
    return _shortest(layouts, rides, origin, goal, travel) if rides else None


def _shortest(
    layouts: tuple[FloorLayout, ...],
    rides: tuple[ElevatorRide, ...],
    origin: NodeIndex,
    goal: NodeIndex,
    travel: Travel | None,
) -> Route | None:
    graph = nx.DiGraph()
    ends = {origin, goal, *(end for ride in rides for end in (ride.first, ride.second))}
    for floor in {end.floor for end in ends}:
        layout = layouts[floor]
        floor_ends = [end for end in ends if end.floor == floor]
        match travel or layout.source.travel:
            case "wall-on-left":
                one_ring = origin.floor == goal.floor == floor and origin.ring == goal.ring
                _add_rings(graph, floor, layout, floor_ends, linked=not one_ring)
            case "either":
                _add_corridors(graph, floor, layout, floor_ends)
    for ride in rides:
        for here, there in ((ride.first, ride.second), (ride.second, ride.first)):
            graph.add_edge(here, there, weight=_RIDE_MM, length=0.0, corridor=None)
    try:
        return _split_at_rides(graph, nx.dijkstra_path(graph, origin, goal))
    except (nx.NetworkXNoPath, nx.NodeNotFound):
        return None


def _add_step(
    graph: Any, here: object, there: object, length: float, corridor: int | None, extra: float = 0.0
) -> None:
    """Add an edge to the graph; keep only the shortest edge between the same positions."""
    weight = length + extra + _HOP_MM
    if not graph.has_edge(here, there) or graph[here][there]["weight"] > weight:
        graph.add_edge(here, there, weight=weight, length=length, corridor=corridor)


def _add_rings(graph: Any, floor: int, layout: FloorLayout, ends: list[NodeIndex], linked: bool) -> None:
    links = layout.source.links if linked else ()
    rings = layout.source.rings
    node_indices = {node.name: (r, n) for r, ring in enumerate(rings) for n, node in enumerate(ring.nodes)}
    link_ends = [
        tuple(_RingPosition(floor, *node_indices[site.node], site.offset_mm) for site in link)
        for link in links
    ]
    for r, ring in enumerate(rings):
        positions = [_RingPosition(floor, r, n, 0.0) for n in range(len(ring.nodes))]
        positions += [position for both_ends in link_ends for position in both_ends if position.ring == r]
        positions = sorted(set(positions))
        for here, there in zip(positions, [*positions[1:], positions[0]], strict=True):
            edge = ring.edges[here.edge]
            end_mm = there.offset_mm if there.edge == here.edge and there > here else edge.length_mm
            length = end_mm - here.offset_mm if edge.counted else 0.0
            _add_step(graph, here, there, length, layout.corridor_at(r, here.edge))
    for first, second in link_ends:
        _add_step(graph, first, second, 0.0, None)
        _add_step(graph, second, first, 0.0, None)
    for end in ends:
        position = _RingPosition(floor, end.ring, end.node, 0.0)
        _add_step(graph, end, position, 0.0, None)
        _add_step(graph, position, end, 0.0, None)


def _add_corridors(graph: Any, floor: int, layout: FloorLayout, ends: list[NodeIndex]) -> None:
    positions_on: list[set[_CorridorPosition]] = [set() for _ in layout.corridors]
    for space in layout.spaces:
        pair = [
            _CorridorPosition(floor, k, round(layout.corridors[k].along(*space.center), 3))
            for k in space.corridors
        ]
        for position in pair:
            positions_on[position.corridor].add(position)
        _add_step(graph, pair[0], pair[1], 0.0, None, _TURN_MM)
        _add_step(graph, pair[1], pair[0], 0.0, None, _TURN_MM)
    for end in ends:
        k = layout.corridor_of_node(end.ring, end.node)
        if k is not None:
            at = layout.nodes[end.ring][end.node]
            position = _CorridorPosition(floor, k, round(layout.corridors[k].reachable_along(*at), 3))
            positions_on[k].add(position)
            _add_step(graph, end, position, 0.0, k)
            _add_step(graph, position, end, 0.0, k)
    for k, positions in enumerate(positions_on):
        for here, there in pairwise(sorted(positions)):
            _add_step(graph, here, there, there.along_mm - here.along_mm, k)
            _add_step(graph, there, here, there.along_mm - here.along_mm, k)


def _split_at_rides(graph: Any, path: list[Any]) -> Route:
    """Split a path of the graph at its elevator rides."""
    parts: list[Stretch | ElevatorRide] = []
    origin, length = path[0], 0.0
    corridors: list[int] = []
    for here, there in pairwise(path):
        if isinstance(here, NodeIndex) and isinstance(there, NodeIndex):
            # Successive rides of an elevator are one ride.
            match parts[-1:]:
                case [ElevatorRide(first=first)]:
                    parts[-1] = ElevatorRide(first, there)
                case _:
                    parts.append(ElevatorRide(here, there))
            origin, length, corridors = there, 0.0, []
            continue
        step = graph[here][there]
        length += step["length"]
        if step["corridor"] is not None and corridors[-1:] != [step["corridor"]]:
            corridors.append(step["corridor"])
        if isinstance(there, NodeIndex):
            parts.append(Stretch(origin=origin, goal=there, corridors=tuple(corridors), length_mm=length))
    return tuple(parts)
