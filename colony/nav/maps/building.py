"""A building: the maps of its floors, and the elevators between them."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from colony.nav.maps.source import load_building_source
from colony.nav.maps.stickrep.fields import lines_of_words
from colony.nav.maps.stickrep.model import EdgeKind, ElevatorLink, Map
from colony.nav.maps.stickrep.reader import read_map
from colony.text.diagnostics import Diagnostic, DiagnosticError, error, in_order
from colony.text.source import Source, Span

MAX_MAPS = 100


class Landing(NamedTuple):
    """An elevator's doors on one floor: the name of the floor's map, and the node where its edge begins."""

    map: str
    node: str


class LandingRide(NamedTuple):
    """A ride of an elevator between two landings, in either direction."""

    first: Landing
    second: Landing


@dataclass(frozen=True, slots=True, kw_only=True)
class Building:
    """The floors that elevators connect.

    Attributes:
        maps: the floors; the requested one first, then the others by the number of rides to reach them.
        rides: the rides, each pair of landings once, in the order of the maps.
    """

    maps: tuple[Map, ...]
    rides: tuple[LandingRide, ...] = ()

    def map_named(self, name: str) -> Map:
        """Return the floor whose map has this name.

        Raises:
            KeyError: there is none.
        """
        for floor in self.maps:
            if floor.name == name:
                return floor
        raise KeyError(f"the building has no map `{name}`; it has {', '.join(m.name for m in self.maps)}")

    def with_floors(self, names: Sequence[str]) -> Building:
        """Return the part of the building with the floors of these maps, and the rides between them.

        Raises:
            KeyError: there is no such floor.
        """
        rides = (r for r in self.rides if r.first.map in names and r.second.map in names)
        return Building(maps=tuple(self.map_named(name) for name in names), rides=tuple(rides))


def load_building(path: str | os.PathLike[str]) -> Building:
    """Load the map at `path` and those that its elevators lead to, directly or through others.

    Raises:
        DiagnosticError: one of the files cannot be read or is not a valid map, or its elevators do not match
            those of another. The exception lists all errors found, file by file, each with its location.
    """
    loaded = _load_all(os.fspath(path))
    problems = [*_duplicates(loaded), *(p for item in loaded for p in _link_errors(item))]
    if problems:
        raise DiagnosticError(problems)
    return Building(maps=tuple(item.map for item in loaded), rides=_rides(loaded))


@dataclass(slots=True, kw_only=True, eq=False)
class _LoadedMap:
    """A map, its text, and the maps to which its elevators lead, in the order of `map.elevators`."""

    source: Source
    map: Map
    destinations: list[_LoadedMap] = field(default_factory=list)


def _load_all(path: str) -> list[_LoadedMap]:
    """Load the maps breadth first, and each file only once, even under several paths."""
    first = _LoadedMap(source=(source := load_building_source(path)), map=read_map(source))
    by_path = {os.path.realpath(path): first}
    queue = deque([first])
    while queue:
        current = queue.popleft()
        problems: list[Diagnostic] = []
        for elevator in current.map.elevators:
            target = os.path.join(os.path.dirname(current.source.name), elevator.file)
            key = os.path.realpath(target)
            if key not in by_path:
                if len(by_path) == MAX_MAPS:
                    message = (
                        f"expected a building of at most {MAX_MAPS} maps; this elevator leads to one more"
                    )
                    problems.append(error("M023", _elevator_span(current, elevator, 2), message))
                    break
                try:
                    source = load_building_source(target)
                except DiagnosticError as failure:
                    problems.append(_unreadable(current, elevator, failure))
                    continue
                by_path[key] = _LoadedMap(source=source, map=read_map(source))
                queue.append(by_path[key])
            current.destinations.append(by_path[key])
        if problems:
            raise DiagnosticError(in_order(problems))
    return list(by_path.values())


def _elevator_span(current: _LoadedMap, elevator: ElevatorLink, index: int) -> Span:
    """Return the span of a word of an elevator's line: 1 its node, 2 its file, 3 the other node."""
    wanted = ["elevator", *elevator]
    lines = lines_of_words(current.source)
    return next(words[index].span for words in lines if [w.text for w in words] == wanted)


def _unreadable(current: _LoadedMap, elevator: ElevatorLink, failure: DiagnosticError) -> Diagnostic:
    reason = failure.diagnostics[0].message
    message = f"the elevator `{elevator.node}` leads to a map that cannot be loaded: {reason}"
    hint = "give the path relative to the folder of this map"
    return error("M029", _elevator_span(current, elevator, 2), message, hint)


def _link_errors(current: _LoadedMap) -> list[Diagnostic]:
    """Return the errors of a map's `elevator` lines."""
    problems: list[Diagnostic] = []
    for elevator, target in zip(current.map.elevators, current.destinations, strict=True):
        kind = _kind_at(target.map, elevator.other_node)
        if target is current:
            message = f"the elevator `{elevator.node}` leads to its own map; expected another floor's"
            problems.append(error("M029", _elevator_span(current, elevator, 2), message))
        elif kind is not EdgeKind.ELEVATOR:
            what = "no such node" if kind is None else f"a {kind.name.lower()} after it"
            message = f"expected an elevator at `{elevator.other_node}` of `{target.map.name}`; it has {what}"
            hint = f"name the node of {target.source.name} where the elevator's edge begins"
            problems.append(error("M029", _elevator_span(current, elevator, 3), message, hint))
        elif not _leads_back(current, elevator, target):
            message = f"the elevator `{elevator.other_node}` of `{target.map.name}` does not lead back here"
            back = os.path.relpath(current.source.name, os.path.dirname(target.source.name) or ".")
            line = f"elevator {elevator.other_node} {back} {elevator.node}"
            hint = f"add `{line}` to {target.source.name}"
            problems.append(error("M030", _elevator_span(current, elevator, 3), message, hint))
    return problems


def _kind_at(floor: Map, name: str) -> EdgeKind | None:
    for ring in floor.rings:
        for node, edge in zip(ring.nodes, ring.edges, strict=True):
            if node.name == name:
                return edge.kind
    return None


def _leads_back(current: _LoadedMap, elevator: ElevatorLink, target: _LoadedMap) -> bool:
    return any(
        back is current and (other.node, other.other_node) == (elevator.other_node, elevator.node)
        for other, back in zip(target.map.elevators, target.destinations, strict=True)
    )


def _duplicates(loaded: list[_LoadedMap]) -> list[Diagnostic]:
    """Return errors for maps that share their name or floor with an earlier one."""
    problems: list[Diagnostic] = []
    for key in ("map", "floor"):
        seen: dict[str, _LoadedMap] = {}
        for item in loaded:
            value = item.map.name if key == "map" else item.map.floor
            first = seen.setdefault(value, item)
            if first is not item and value:
                message = f"the {key} `{value}` is also that of {first.source.name}, in the same building"
                hint = f"give each map of a building a `{key}` of its own"
                problems.append(error("M031", _header_span(item, key), message, hint))
    return problems


def _header_span(item: _LoadedMap, key: str) -> Span:
    """Return the span of the value of a header line."""
    return next(words[1].span for words in lines_of_words(item.source) if words[0].text == key)


def _rides(loaded: list[_LoadedMap]) -> tuple[LandingRide, ...]:
    rides: list[LandingRide] = []
    for item in loaded:
        for elevator, other in zip(item.map.elevators, item.destinations, strict=True):
            ride = LandingRide(
                Landing(item.map.name, elevator.node), Landing(other.map.name, elevator.other_node)
            )
            if LandingRide(ride.second, ride.first) not in rides:
                rides.append(ride)
    return tuple(rides)
