"""Plans in buildings that are drawn: a grid of corridors, whose shortest ways an oracle knows."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise, product

import networkx as nx
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from colony.nav.maps.corridors import corridors_of, turning_spaces_of
from colony.nav.maps.stickrep.geometry import corners, direction
from colony.nav.maps.stickrep.model import Edge, EdgeKind, Map, MapLight, MapNode, Pose, Ring
from colony.nav.maps.stickrep.reader import load_map, read_map, write_map
from colony.nav.maps.walls import lights_of
from colony.nav.plan.plan import LIGHT_AHEAD_MM, Plan, Segment
from colony.nav.plan.route import plan
from colony.nav.shared import GoalKind
from colony.text.source import Source
from studies.confidence.published_runs import PUBLISHED_RUNS
from tests.paths import MAPS

DOOR_MM = 900.0
ALCOVE_MM = 500.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Corridors from west to east and from south to north, with a block of rooms in each cell.

    `columns` and `rows` are the widths of the corridors and of the blocks in turn, beginning and ending with
    a corridor; each block has a door on its south wall and one on its west wall, `door` after the corner.
    Lights hang before the two other walls, the first and the last `light` from the corners, `apart` at most.
    """

    columns: tuple[float, ...]
    rows: tuple[float, ...]
    door: float
    alcoves: bool
    light: float = 1000.0
    apart: float = 5500.0

    @property
    def size(self) -> tuple[float, float]:
        return sum(self.columns), sum(self.rows)

    @property
    def middles(self) -> tuple[list[float], list[float]]:
        """The x of the corridors that lead north, the y of those that lead east."""
        return _middles(self.columns), _middles(self.rows)

    def map(self) -> Map:
        width, height = self.size
        outline = _ring("outline", Pose(0.0, 0.0, 0.0), -1, [[height], [width], [height], [width]], {})
        edges_x, edges_y = [0.0, *accumulate(self.columns)], [0.0, *accumulate(self.rows)]
        blocks = []
        for i, j in product(range(1, len(self.columns), 2), range(1, len(self.rows), 2)):
            wide, high = self.columns[i], self.rows[j]
            walls = [self._wall(wide), [high], [wide], self._wall(high)]
            corner = Pose(edges_x[i], edges_y[j], 270.0)
            lights = {1: self._lights(high), 2: self._lights(wide)}
            blocks.append(_ring(f"b{i}_{j}", corner, 1, walls, lights))
        return Map(name="grid", start=Pose(50.0, 50.0, 0.0), rings=(outline, *blocks))

    def _wall(self, length: float) -> list[float]:
        """A wall with a door; a negative length is the depth of an alcove, in which the door is."""
        rest = length - self.door - DOOR_MM
        if self.alcoves:
            return [self.door, -ALCOVE_MM, DOOR_MM, -ALCOVE_MM, rest]
        return [self.door, DOOR_MM, rest]

    def _lights(self, length: float) -> tuple[MapLight, ...]:
        count = 1 + math.ceil((length - 2 * self.light) / self.apart)
        gap = (length - 2 * self.light) / (count - 1)
        return tuple(MapLight(offset_mm=self.light + k * gap) for k in range(count))

    def places(self) -> dict[str, tuple[str, float, float]]:
        """Of each door's left jamb, how its corridor leads and where in its middle it is."""
        xs, ys = self.middles
        edges_x, edges_y = [0.0, *accumulate(self.columns)], [0.0, *accumulate(self.rows)]
        found = {}
        for i, j in product(range(1, len(self.columns), 2), range(1, len(self.rows), 2)):
            found[f"b{i}_{j}.0L"] = ("east", edges_x[i] + self.door, ys[j // 2])
            # The west wall is traced southward.
            found[f"b{i}_{j}.3L"] = ("north", xs[i // 2], edges_y[j + 1] - self.door)
        return found


def _middles(strips: Sequence[float]) -> list[float]:
    ends = [0.0, *accumulate(strips)]
    return [(ends[k] + ends[k + 1]) / 2 for k in range(0, len(strips), 2)]


def _ring(
    name: str, start: Pose, left: int, walls: list[list[float]], lights: dict[int, tuple[MapLight, ...]]
) -> Ring:
    """A ring that turns left (1) or right (-1) after each of its walls; `lights` of walls in one piece."""
    nodes, edges = [], []
    for w, wall in enumerate(walls):
        alcove = 0
        for k, length in enumerate(wall):
            angle = 180.0 if k else 180.0 - 90.0 * left
            if len(wall) == 5 and k:  # into the alcove to the left, and out of it again
                angle = (90.0, 270.0, 270.0, 90.0)[alcove]
                alcove += 1
            door = len(wall) > 1 and length == DOOR_MM
            label = f"{name}.{w}" + ("L" if door else f"_{k}")
            nodes.append(MapNode(name=label, angle_deg=angle, corner=k == 0))
            kind = EdgeKind.DOOR if door else EdgeKind.WALL
            hung = lights.get(w, ())
            edges.append(Edge(kind=kind, length_mm=abs(length), counted=length > 0, lights=hung))
    return Ring(name=name, start=start, nodes=tuple(nodes), edges=tuple(edges))


widths = st.sampled_from([1800.0, 2000.0, 2540.0, 3050.0, 3700.0])
blocks = st.floats(6_000.0, 25_000.0)


@st.composite
def grids(draw: st.DrawFn) -> Grid:
    """Up to three by three blocks."""
    strips = []
    for _ in range(2):
        count = draw(st.integers(1, 3))
        strip = [draw(widths)]
        for _ in range(count):
            strip += [draw(blocks), draw(widths)]
        strips.append(tuple(strip))
    return Grid(
        columns=strips[0],
        rows=strips[1],
        door=draw(st.floats(1000.0, 4000.0)),
        alcoves=draw(st.booleans()),
        light=draw(st.floats(0.0, 2500.0)),
    )


@given(grid=grids())
@settings(max_examples=60, deadline=None)
def test_a_grid_has_its_corridors(grid: Grid) -> None:
    found = corridors_of(grid.map())
    xs, ys = grid.middles
    north = [c for c in found if c.heading_deg == 0.0]
    east = [c for c in found if c.heading_deg == 90.0]
    assert len(found) == len(north) + len(east)
    assert sorted(c.start.x for c in north) == pytest.approx(xs)
    assert sorted(c.start.y for c in east) == pytest.approx(ys)
    assert sorted(c.width_mm for c in north) == pytest.approx(sorted(grid.columns[::2]))
    assert all(c.length_mm == pytest.approx(grid.size[1]) for c in north)
    assert len(turning_spaces_of(found)) == len(xs) * len(ys)


@given(grid=grids(), data=st.data())
@settings(max_examples=60, deadline=None)
def test_plans_in_a_grid_are_the_shortest_ways(grid: Grid, data: st.DataObject) -> None:
    places = grid.places()
    names = sorted(places)
    origin, goal = data.draw(st.sampled_from(names)), data.draw(st.sampled_from(names))
    if origin == goal:
        return
    found = plan(grid.map(), origin, goal)
    assert found.travel_mm == pytest.approx(oracle(grid, places[origin], places[goal]), abs=1.0)
    assert found.distance_mm == pytest.approx(found.travel_mm, abs=1.0)
    for one, other in pairwise(found.segments):
        turned = round(other.heading_deg - one.heading_deg) % 360
        assert turned in ((90, 270) if chr(other.kind) == "C" else (0,))


@given(grid=grids(), data=st.data())
@settings(max_examples=60, deadline=None)
def test_plans_in_a_grid_are_unbroken_and_as_far_as_back(grid: Grid, data: st.DataObject) -> None:
    """Each segment begins where the one before has ended, and leads where it says; so do both ways."""
    floor, names = grid.map(), sorted(grid.places())
    origin, goal = data.draw(st.sampled_from(names)), data.draw(st.sampled_from(names))
    if origin == goal:
        return
    there, back = plan(floor, origin, goal), plan(floor, goal, origin)
    assert there.distance_mm == pytest.approx(back.distance_mm, abs=1.0)
    for found in (there, back):
        check_grammar(found)
        for one, other in pairwise(found.segments):
            assert one.end[:2] == pytest.approx(other.start[:2], abs=0.01)
        for segment in found.segments:
            unit = direction(segment.heading_deg)
            east, north = (b - a for a, b in zip(segment.start[:2], segment.end[:2], strict=True))
            assert segment.length_mm >= 0.0
            assert (east, north) == pytest.approx(
                (unit.x * segment.length_mm, unit.y * segment.length_mm), abs=0.01
            )
            check_lights(segment, floor)


GRAMMAR = re.compile(r"(?:L?E C )*L?D")


def check_grammar(found: Plan) -> None:
    """[L] E C for each leg but the last one, which is [L] D; a mode is a letter, a corner one of them."""
    kinds = "".join(chr(segment.kind) for segment in found.segments)
    assert GRAMMAR.fullmatch(kinds.replace("EC", "E C ")), kinds
    assert found.modes == kinds.replace("EC", "c").lower()


def check_lights(segment: Segment, floor: Map) -> None:
    """Those of a segment hang above it, none is listed twice, and it ends below the last one."""
    assert (segment.kind is GoalKind.LIGHTS) == bool(segment.lights_mm)
    if not segment.lights_mm:
        return
    assert segment.lights_mm[0] >= LIGHT_AHEAD_MM - 0.01
    assert all(after > before for before, after in pairwise(segment.lights_mm))
    assert segment.lights_mm[-1] == pytest.approx(segment.length_mm, abs=0.01)
    hung, unit = lights_of(floor), direction(segment.heading_deg)
    for light in segment.lights_mm:
        x, y = segment.start.x_mm + light * unit.x, segment.start.y_mm + light * unit.y
        assert min(math.hypot(x - hx, y - hy) for hx, hy in hung.tolist()) <= segment.width_mm / 2


@given(grid=grids())
@settings(max_examples=30, deadline=None)
def test_a_grid_that_was_written_is_read_again(grid: Grid) -> None:
    text = write_map(grid.map())
    again = read_map(Source("grid.stickrep", text))
    assert write_map(again) == text
    for one, other in zip(grid.map().rings, again.rings, strict=True):
        for here, there in zip(corners(one), corners(other), strict=True):
            assert there == pytest.approx(here, abs=0.01)
    assert lights_of(again) == pytest.approx(lights_of(grid.map()), abs=0.01)


@given(grid=grids())
@settings(max_examples=30, deadline=None)
@example(
    grid=Grid(
        columns=(1800.0, 8465.0, 1800.0),
        rows=(1800.0, 6000.0, 2540.0, 6000.0, 1800.0),
        door=1000.0,
        alcoves=False,
        light=0.0,
    )
)
def test_every_light_hangs_in_the_middle_of_a_corridor(grid: Grid) -> None:
    """Also one at a corner, where what is opposite may be just missed; half-way into an alcove before one."""
    xs, ys = grid.middles
    most = ALCOVE_MM / 2 + 1.0 if grid.alcoves else 1.0
    floor = grid.map()
    for drawn in (floor, read_map(Source("grid.stickrep", write_map(floor)))):  # rounded to parts of an inch
        for x, y in lights_of(drawn).tolist():
            off = min(*(abs(x - middle) for middle in xs), *(abs(y - middle) for middle in ys))
            assert off <= most, (x, y)


def oracle(grid: Grid, origin: tuple[str, float, float], goal: tuple[str, float, float]) -> float:
    """The length of the shortest way along the centerlines."""
    xs, ys = grid.middles
    graph = nx.Graph()
    lines: dict[tuple[str, float], set[tuple[float, float]]] = {}
    for x, y in product(xs, ys):
        lines.setdefault(("north", x), set()).add((x, y))
        lines.setdefault(("east", y), set()).add((x, y))
    for way, x, y in (origin, goal):
        lines[way, x if way == "north" else y].add((x, y))
    for points in lines.values():
        for one, other in pairwise(sorted(points)):
            graph.add_edge(one, other, weight=math.dist(one, other))
    return float(nx.dijkstra_path_length(graph, origin[1:], goal[1:]))


def turned(floor: Map, degrees: float) -> Map:
    """The same floor in a world that is turned."""
    angle = math.radians(degrees)

    def at(pose: Pose) -> Pose:
        x = pose.x_mm * math.cos(angle) - pose.y_mm * math.sin(angle)
        y = pose.x_mm * math.sin(angle) + pose.y_mm * math.cos(angle)
        return Pose(x, y, pose.heading_deg + degrees)

    rings = tuple(replace(ring, start=at(ring.start)) for ring in floor.rings)
    return replace(floor, start=at(floor.start), rings=rings)


@pytest.mark.parametrize("degrees", [37.0, -90.0, 163.5])
def test_a_building_may_stand_at_any_angle(degrees: float) -> None:
    """The 40 published runs are the same, with all headings turned."""
    floor = load_map(MAPS / "msu_engineering_3.stickrep")
    elsewhere = turned(floor, degrees)
    for run in {(run.origin, run.goal) for run in PUBLISHED_RUNS}:
        here, there = plan(floor, *run), plan(elsewhere, *run)
        assert there.modes == here.modes
        assert there.distance_mm == pytest.approx(here.distance_mm)
        for one, other in zip(here.segments, there.segments, strict=True):
            off = (other.heading_deg - one.heading_deg - degrees + 180.0) % 360.0 - 180.0
            assert off == pytest.approx(0.0, abs=0.1)
            assert other.length_mm == pytest.approx(one.length_mm, abs=1.0)
            assert other.lights_mm == pytest.approx(one.lights_mm, abs=1.0)
