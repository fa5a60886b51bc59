"""The Path Planner's global part: from one node of a building to another (thesis section 5.3)."""

from __future__ import annotations

from colony.nav.maps.building import Building
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import EdgeKind, Map, Travel
from colony.nav.plan.graph import Layout, Lift, Spot, Stretch, Way, layout_of, shortest_way
from colony.nav.plan.legs import Apart, Leg, legs_of, segments_of
from colony.nav.plan.plan import Place, Plan, Segment
from colony.nav.shared import GoalKind
from colony.text.suggestions import did_you_mean

JAMBS = ("L", "R", ".L", ".R")
"""Suffixes of a door's name in the names of its jambs."""


class NoPlanError(Exception):
    """There is no plan, and why: what was found and where, and what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(f"{message}; {hint}")
        self.message = message
        self.hint = hint


def plan(source: Map | Building, origin: str, goal: str, *, travel: Travel | None = None) -> Plan:
    """Return the shortest path from one node to another.

    A name without a jamb ("376" where there are 376L and 376R) stands for both jambs of that door, and the
    path is the shortest of those between them. A name is looked up on the first floor of a building, and only
    then on the others; the name of a map or floor before it says where: "msu_engineering_2:250R" or "2:250R".

    Args:
        source: a floor, or all that elevators join.
        origin: name of the node or door where the path begins.
        goal: name of the node or door where it ends.
        travel: direction in which rings are followed, in place of what the maps say.

    Raises:
        NoPlanError: a name is unknown, both are one place, or no path leads from one to the other.
    """
    building = source if isinstance(source, Building) else Building(maps=(source,))
    layouts = tuple(layout_of(one) for one in building.maps)
    known = _known(layouts)
    starts, goals = _spots(layouts, known, origin, "start"), _spots(layouts, known, goal, "goal")
    if set(starts) == set(goals):
        message = f"{_quoted(origin)} and {_quoted(goal)} are one place"
        raise NoPlanError(message, "name a start and a goal that differ")
    lifts = _lifts(building)
    ways = [
        (_length(way), start, end, way)
        for start in starts
        for end in goals
        if start != end and (way := shortest_way(layouts, lifts, start, end, travel)) is not None
    ]
    if not ways:
        raise _no_way(layouts, starts[0], goals[0], travel)
    length, start, end, way = min(ways, key=lambda found: found[0])
    segments, modes = _segments(layouts, way)
    return Plan(
        origin=_name(layouts, start),
        goal=_name(layouts, end),
        segments=segments,
        distance_mm=length,
        modes=modes,
    )


def _length(way: Way) -> float:
    return sum(part.length_mm for part in way if isinstance(part, Stretch))


def _name(layouts: tuple[Layout, ...], spot: Spot) -> str:
    return layouts[spot.floor].source.rings[spot.ring].nodes[spot.node].name


# --- names ----------------------------------------------------------------------------------------------


Known = dict[str, list[Spot]]


def _known(layouts: tuple[Layout, ...]) -> Known:
    """Return all nodes by their names, with and without their floors'."""
    known: Known = {}
    for f, layout in enumerate(layouts):
        for r, ring in enumerate(layout.source.rings):
            for n, node in enumerate(ring.nodes):
                prefixes = {"", f"{layout.source.name}:"}
                if layout.source.floor:
                    prefixes.add(f"{layout.source.floor}:")
                for prefix in prefixes:
                    known.setdefault(prefix + node.name, []).append(Spot(f, r, n))
    return known


def _spots(layouts: tuple[Layout, ...], known: Known, name: str, what: str) -> tuple[Spot, ...]:
    found = known.get(name) or [spot for jamb in JAMBS for spot in known.get(name + jamb, ())]
    if any(spot.floor == 0 for spot in found):
        found = [spot for spot in found if spot.floor == 0]
    maps = [layouts[f].source.name for f in sorted({spot.floor for spot in found})]
    if len(maps) > 1:
        message = f"the {what} {_quoted(name)} is on several floors: {', '.join(f'`{m}`' for m in maps)}"
        raise NoPlanError(message, f"say which one: `{maps[0]}:{name.rpartition(':')[2]}`")
    if found:
        return tuple(found)
    where = " or ".join(f"`{layout.source.name}`" for layout in layouts)
    hint = _similar(name, known) or "`colony map` draws the names"
    raise NoPlanError(f"there is no {what} {_quoted(name)} in the map {where}", hint)


def _quoted(name: str) -> str:
    """Quote a name for a message: in one line, shortened."""
    shown = name if name.isprintable() else ascii(name)[1:-1]
    return f"`{shown if len(shown) <= 40 else shown[:37] + '...'}`"


def _similar(name: str, known: Known) -> str | None:
    """Return a hint with similar names.

    It has the same name in other letters, or else up to three names much like this one: of doors, or of nodes
    that are no jambs.
    """
    folded = [one for one in known if one.lower() == name.lower()]
    doors = {one.removesuffix(jamb) for one in known for jamb in JAMBS if one.endswith(jamb)} - {""}
    others = {one for one in known if not any(one.removesuffix(jamb) in doors for jamb in JAMBS)}
    return did_you_mean(name, folded or sorted(doors | others), most=3)


def _lifts(building: Building) -> tuple[Lift, ...]:
    spots = {
        (floor.name, node.name): Spot(f, r, n)
        for f, floor in enumerate(building.maps)
        for r, ring in enumerate(floor.rings)
        for n, node in enumerate(ring.nodes)
    }
    return tuple(Lift(spots[ride.one], spots[ride.other]) for ride in building.rides)


def _no_way(layouts: tuple[Layout, ...], start: Spot, goal: Spot, travel: Travel | None) -> NoPlanError:
    message = f"no path leads from `{_name(layouts, start)}` to `{_name(layouts, goal)}`"
    for spot in (start, goal):
        if layouts[spot.floor].corridor_of_node(spot.ring, spot.node) is None:
            message += f": `{_name(layouts, spot)}` stands in no corridor"
            return NoPlanError(message, "a corridor has two walls that face each other, 1 m to 4.5 m apart")
    one, other = layouts[start.floor].source, layouts[goal.floor].source
    if one is not other:
        message += f": the way from `{one.name}` to `{other.name}` has no elevator that can be reached"
        return NoPlanError(
            message, "see whether an elevator's doors open into a corridor that meets the others"
        )
    if (travel or one.travel) == "wall-on-left" and start.ring != goal.ring:
        rings = (one.rings[start.ring].name, one.rings[goal.ring].name)
        message += f": one is on ring `{rings[0]}`, the other on `{rings[1]}`, and no links join these"
        return NoPlanError(message, "write lines `link` into the map, or travel it either way")
    return NoPlanError(f"{message}: their corridors do not meet", "`colony map` draws their walls")


# --- segments -------------------------------------------------------------------------------------------


def _segments(layouts: tuple[Layout, ...], way: Way) -> tuple[tuple[Segment, ...], str]:
    segments: list[Segment] = []
    modes = ""
    landings = {spot for part in way if isinstance(part, Lift) for spot in (part.one, part.other)}
    for part in way:
        match part:
            case Stretch():
                layout = layouts[part.goal.floor]
                legs = _legs(layouts, part, landings)
                found, letters = segments_of(legs, layout.lights, layout.source.name)
                segments += found
                modes += letters
            case Lift():
                segments.append(_ride(layouts, part))
                modes += "v"
    return tuple(segments), modes


def _legs(layouts: tuple[Layout, ...], stretch: Stretch, landings: set[Spot]) -> tuple[Leg, ...]:
    layout = layouts[stretch.origin.floor]
    message = f"the path from `{_name(layouts, stretch.origin)}` to `{_name(layouts, stretch.goal)}`"
    corridors = tuple(layout.corridors[k] for k in layout.joined(stretch.corridors))
    if not corridors:
        raise NoPlanError(f"{message} is in no corridor", "a corridor has two walls that face each other")
    ends = [
        _doors(layout, spot) if spot in landings else layout.nodes[spot.ring][spot.node]
        for spot in (stretch.origin, stretch.goal)
    ]
    legs = legs_of(corridors, ends[0], ends[1])
    if isinstance(legs, Apart):
        places = [_shown(c.at(c.length_mm / 2)) for c in (legs.one, legs.other)]
        message += f" leads from the corridor around {places[0]} to the one around {places[1]}"
        raise NoPlanError(f"{message}, and these do not meet", "`colony map` draws their walls")
    return legs


def _shown(at: Point) -> str:
    return f"({at.x / 1000:.1f} m, {at.y / 1000:.1f} m)"


def _doors(layout: Layout, spot: Spot) -> Point:
    """Return the middle of an elevator's doors."""
    nodes = layout.nodes[spot.ring]
    here, there = nodes[spot.node], nodes[(spot.node + 1) % len(nodes)]
    return Point((here.x + there.x) / 2, (here.y + there.y) / 2)


def _ride(layouts: tuple[Layout, ...], lift: Lift) -> Segment:
    places, headings, ways = [], [], []
    for spot in (lift.one, lift.other):
        layout = layouts[spot.floor]
        k = layout.corridor_of_node(spot.ring, spot.node)
        if k is None:
            message = f"the elevator `{_name(layouts, spot)}` opens into no corridor"
            raise NoPlanError(message, "a corridor has two walls that face each other, 1 m to 4.5 m apart")
        corridor = layout.corridors[k]
        doors = _doors(layout, spot)
        places.append(Place(*corridor.at(corridor.abreast(*doors)), layout.source.name))
        ways.append(abs(corridor.beside(*doors)))
        # The elevator is behind its doors, on the left along the wall.
        headings.append((layout.headings_deg[spot.ring][spot.node] + 90.0) % 360.0)
    ring = layouts[lift.one.floor].source.rings[lift.one.ring]
    assert ring.edges[lift.one.node].kind is EdgeKind.ELEVATOR
    return Segment(
        kind=GoalKind.ELEVATOR,
        heading_deg=headings[0],
        start=places[0],
        end=places[1],
        width_mm=ring.edges[lift.one.node].length_mm,
        turn_deg=(headings[1] - headings[0]) % 360.0,
        doors_mm=(ways[0], ways[1]),
        doors=(_name(layouts, lift.one), _name(layouts, lift.other)),
    )
