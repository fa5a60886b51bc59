"""The Path Planner's global part: from one node of a building to another (thesis section 5.3)."""

from __future__ import annotations

from colony.nav.maps.building import Building
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import EdgeKind, Map, Travel
from colony.nav.plan.graph import (
    ElevatorRide,
    FloorLayout,
    NodeIndex,
    Route,
    Stretch,
    layout_of,
    shortest_route,
)
from colony.nav.plan.plan import DisconnectedCorridors, FloorPoint, Leg, Plan, Segment, legs_of, segments_of
from colony.nav.shared import GoalKind
from colony.text.wording import did_you_mean

JAMB_SUFFIXES = ("L", "R", ".L", ".R")
"""Suffixes that turn a door's name into the names of its jambs."""


class NoPlanError(Exception):
    """No plan exists; the message says what was found and where, the hint what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(f"{message}; {hint}")
        self.message = message
        self.hint = hint


def plan(source: Map | Building, origin: str, goal: str, *, travel: Travel | None = None) -> Plan:
    """Return the shortest path from one node to another.

    A name without a jamb ("376" for 376L and 376R) stands for both jambs of that door, and the path is the
    shortest between any of them. A name is looked up on the first floor of a building, then on the others; a
    prefix names the map or floor: "msu_engineering_2:250R" or "2:250R".

    Args:
        source: a floor, or a building.
        origin: name of the node or door where the path begins.
        goal: name of the node or door where it ends.
        travel: direction of travel on all floors; None for each map's own.

    Raises:
        NoPlanError: a name is unknown, both names are the same place, or no path leads from one to the
            other.
    """
    building = source if isinstance(source, Building) else Building(maps=(source,))
    layouts = tuple(layout_of(floor) for floor in building.maps)
    nodes_by_name = _nodes_by_name(layouts)
    starts, goals = (
        _find_nodes(layouts, nodes_by_name, origin, "start"),
        _find_nodes(layouts, nodes_by_name, goal, "goal"),
    )
    if set(starts) == set(goals):
        message = f"{_quote(origin)} and {_quote(goal)} are the same place"
        raise NoPlanError(message, "name a start and a goal that differ")
    rides = _elevator_rides(building)
    routes = [
        (_length(route), start, end, route)
        for start in starts
        for end in goals
        if start != end and (route := shortest_route(layouts, rides, start, end, travel)) is not None
    ]
    if not routes:
        raise _no_route(layouts, starts[0], goals[0], travel)
    length, start, end, route = min(routes, key=lambda found: found[0])
    segments, modes = _segments(layouts, route)
    return Plan(
        origin=_name(layouts, start),
        goal=_name(layouts, end),
        segments=segments,
        distance_mm=length,
        modes=modes,
    )


def _length(route: Route) -> float:
    return sum(part.length_mm for part in route if isinstance(part, Stretch))


def _name(layouts: tuple[FloorLayout, ...], node_index: NodeIndex) -> str:
    return layouts[node_index.floor].source.rings[node_index.ring].nodes[node_index.node].name


# --- names ----------------------------------------------------------------------------------------------


NodesByName = dict[str, list[NodeIndex]]


def _nodes_by_name(layouts: tuple[FloorLayout, ...]) -> NodesByName:
    """Return all nodes by name, with and without the floor's prefix."""
    nodes_by_name: NodesByName = {}
    for f, layout in enumerate(layouts):
        for r, ring in enumerate(layout.source.rings):
            for n, node in enumerate(ring.nodes):
                prefixes = {"", f"{layout.source.name}:"}
                if layout.source.floor:
                    prefixes.add(f"{layout.source.floor}:")
                for prefix in prefixes:
                    nodes_by_name.setdefault(prefix + node.name, []).append(NodeIndex(f, r, n))
    return nodes_by_name


def _find_nodes(
    layouts: tuple[FloorLayout, ...], nodes_by_name: NodesByName, name: str, what: str
) -> tuple[NodeIndex, ...]:
    found = nodes_by_name.get(name) or [
        node_index for jamb in JAMB_SUFFIXES for node_index in nodes_by_name.get(name + jamb, ())
    ]
    if any(node_index.floor == 0 for node_index in found):
        found = [node_index for node_index in found if node_index.floor == 0]
    maps = [layouts[f].source.name for f in sorted({node_index.floor for node_index in found})]
    if len(maps) > 1:
        message = f"the {what} {_quote(name)} is on several floors: {', '.join(f'`{m}`' for m in maps)}"
        raise NoPlanError(message, f"say which one: `{maps[0]}:{name.rpartition(':')[2]}`")
    if found:
        return tuple(found)
    where = " or ".join(f"`{layout.source.name}`" for layout in layouts)
    hint = _similar_names(name, nodes_by_name) or "`colony map` draws the names"
    raise NoPlanError(f"there is no {what} {_quote(name)} in the map {where}", hint)


def _quote(name: str) -> str:
    """Quote a name for a message, in one line and shortened."""
    shown = name if name.isprintable() else ascii(name)[1:-1]
    return f"`{shown if len(shown) <= 40 else shown[:37] + '...'}`"


def _similar_names(name: str, known: NodesByName) -> str | None:
    """Return a hint with similar names.

    The hint has the same name in different case, or up to three similar names of doors and of nodes that
    are not jambs.
    """
    same_letters = [known_name for known_name in known if known_name.lower() == name.lower()]
    doors = {
        known_name.removesuffix(jamb)
        for known_name in known
        for jamb in JAMB_SUFFIXES
        if known_name.endswith(jamb)
    } - {""}
    others = {
        known_name
        for known_name in known
        if not any(known_name.removesuffix(jamb) in doors for jamb in JAMB_SUFFIXES)
    }
    return did_you_mean(name, same_letters or sorted(doors | others), max_names=3)


def _elevator_rides(building: Building) -> tuple[ElevatorRide, ...]:
    nodes_by_name = {
        (floor.name, node.name): NodeIndex(f, r, n)
        for f, floor in enumerate(building.maps)
        for r, ring in enumerate(floor.rings)
        for n, node in enumerate(ring.nodes)
    }
    return tuple(
        ElevatorRide(nodes_by_name[ride.first], nodes_by_name[ride.second]) for ride in building.rides
    )


def _no_route(
    layouts: tuple[FloorLayout, ...], start: NodeIndex, goal: NodeIndex, travel: Travel | None
) -> NoPlanError:
    message = f"no path leads from `{_name(layouts, start)}` to `{_name(layouts, goal)}`"
    for node_index in (start, goal):
        if layouts[node_index.floor].corridor_of_node(node_index.ring, node_index.node) is None:
            message += f": `{_name(layouts, node_index)}` is in no corridor"
            return NoPlanError(message, "a corridor has two walls that face each other, 1 m to 4.5 m apart")
    start_map, goal_map = layouts[start.floor].source, layouts[goal.floor].source
    if start_map is not goal_map:
        message += f": no elevator that can be reached leads from `{start_map.name}` to `{goal_map.name}`"
        return NoPlanError(
            message, "check that an elevator's doors open into a corridor that meets the others"
        )
    if (travel or start_map.travel) == "wall-on-left" and start.ring != goal.ring:
        rings = (start_map.rings[start.ring].name, start_map.rings[goal.ring].name)
        message += f": one is on ring `{rings[0]}`, the other on `{rings[1]}`, and no links join these"
        return NoPlanError(message, "add `link` lines to the map, or travel it either way")
    return NoPlanError(f"{message}: their corridors do not meet", "`colony map` draws their walls")


# --- segments -------------------------------------------------------------------------------------------


def _segments(layouts: tuple[FloorLayout, ...], route: Route) -> tuple[tuple[Segment, ...], str]:
    segments: list[Segment] = []
    modes = ""
    rides = [part for part in route if isinstance(part, ElevatorRide)]
    landings = {landing for ride in rides for landing in (ride.first, ride.second)}
    for part in route:
        match part:
            case Stretch():
                layout = layouts[part.goal.floor]
                legs = _legs(layouts, part, landings)
                found, letters = segments_of(legs, layout.lights, layout.source.name)
                segments += found
                modes += letters
            case ElevatorRide():
                segments.append(_ride(layouts, part))
                modes += "v"
    return tuple(segments), modes


def _legs(layouts: tuple[FloorLayout, ...], stretch: Stretch, landings: set[NodeIndex]) -> tuple[Leg, ...]:
    layout = layouts[stretch.origin.floor]
    message = f"the path from `{_name(layouts, stretch.origin)}` to `{_name(layouts, stretch.goal)}`"
    corridors = tuple(layout.corridors[k] for k in layout.with_skipped(stretch.corridors))
    if not corridors:
        raise NoPlanError(f"{message} is in no corridor", "a corridor has two walls that face each other")
    ends = [
        _doors_center(layout, node_index)
        if node_index in landings
        else layout.nodes[node_index.ring][node_index.node]
        for node_index in (stretch.origin, stretch.goal)
    ]
    legs = legs_of(corridors, ends[0], ends[1])
    if isinstance(legs, DisconnectedCorridors):
        places = [_format_point(c.point_at(c.length_mm / 2)) for c in (legs.first, legs.second)]
        message += f" leads from the corridor around {places[0]} to the one around {places[1]}"
        raise NoPlanError(f"{message}, and these do not meet", "`colony map` draws their walls")
    return legs


def _format_point(at: Point) -> str:
    return f"({at.x / 1000:.1f} m, {at.y / 1000:.1f} m)"


def _doors_center(layout: FloorLayout, node_index: NodeIndex) -> Point:
    """Return the center of an elevator's doors."""
    nodes = layout.nodes[node_index.ring]
    here, there = nodes[node_index.node], nodes[(node_index.node + 1) % len(nodes)]
    return Point((here.x + there.x) / 2, (here.y + there.y) / 2)


def _ride(layouts: tuple[FloorLayout, ...], ride: ElevatorRide) -> Segment:
    points, headings, doors_mm = [], [], []
    for node_index in (ride.first, ride.second):
        layout = layouts[node_index.floor]
        k = layout.corridor_of_node(node_index.ring, node_index.node)
        if k is None:
            message = f"the elevator `{_name(layouts, node_index)}` opens into no corridor"
            raise NoPlanError(message, "a corridor has two walls that face each other, 1 m to 4.5 m apart")
        corridor = layout.corridors[k]
        doors = _doors_center(layout, node_index)
        points.append(FloorPoint(*corridor.point_at(corridor.reachable_along(*doors)), layout.source.name))
        doors_mm.append(abs(corridor.offset(*doors)))
        # The elevator is to the left of its edge.
        headings.append((layout.headings_deg[node_index.ring][node_index.node] + 90.0) % 360.0)
    ring = layouts[ride.first.floor].source.rings[ride.first.ring]
    assert ring.edges[ride.first.node].kind is EdgeKind.ELEVATOR
    return Segment(
        kind=GoalKind.ELEVATOR,
        heading_deg=headings[0],
        start=points[0],
        end=points[1],
        width_mm=ring.edges[ride.first.node].length_mm,
        turn_deg=(headings[1] - headings[0]) % 360.0,
        doors_mm=(doors_mm[0], doors_mm[1]),
        doors=(_name(layouts, ride.first), _name(layouts, ride.second)),
    )
