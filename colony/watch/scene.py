"""What a page shows of a program once, before any frame: its sensors, commands, modules, contracts, network.

A `PageScene` is data that the page draws; it decides nothing. Names and order are those of the program, and a
`PageFrame` refers to them by index.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, assert_never

from colony.body.model import Body, Polygon, radius_mm
from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor
from colony.compile.passes.elaborate import elaborate
from colony.ir.expression import SensorValue
from colony.ir.program import ActuatorField, Machine, Module, Program, Sensor, State
from colony.ir.types import (
    DISTANCE,
    Array,
    Bool,
    Enum,
    Quantity,
    Scalar,
    bearings_of,
    element_type,
    unit_shown,
)
from colony.ir.walk import all_subexpressions
from colony.view.graph.svg import to_live_svg

SensorKind = Literal["polar", "row", "strip", "slider", "lamp", "word"]
"""The way a sensor is drawn: around the robot, as a row of elements, over time, as a lamp, or as a word.

A tunable param is a slider.
"""

_MM_PER_M = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorScene:
    """A sensor.

    Attributes:
        name: its name.
        kind: the way it is drawn.
        unit: the unit of its values in snapshots; distances around the robot are in meters.
        factor: what readings in declared units are multiplied by for that unit.
        low: lower end of its range, None if it has none.
        high: upper end of its range.
        words: the names of enumerators, or of false and true; empty for quantities.
        numbers: the value of each of `words`.
        bearings: the direction of each element, in degrees counterclockwise from straight ahead.
        is_distance: True if a value at the upper end means that nothing is in range.
        origin: the server and field that it comes from.
        is_read: True if the program reads it; others are shown once they have a value.
    """

    name: str
    kind: SensorKind
    unit: str
    factor: float
    low: float | None
    high: float | None
    words: tuple[str, ...]
    numbers: tuple[float, ...]
    bearings: tuple[float, ...]
    is_distance: bool
    origin: str
    is_read: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldScene:
    """A field of a command, with the actuator's range in its declared unit."""

    name: str
    unit: str
    low: float | None
    high: float | None
    words: tuple[str, ...]
    numbers: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorScene:
    """An actuator, and its clients, highest priority first."""

    name: str
    fields: tuple[FieldScene, ...]
    clients: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class StateScene:
    """A state, or a machine with its phases in `words`; that of a sequence has the names of its `tasks`."""

    name: str
    unit: str
    factor: float
    words: tuple[str, ...]
    numbers: tuple[float, ...]
    tasks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class MapScene:
    """A map: its name, walls x0, y0, x1, y1, and holes as polygons, in mm, x east and y north."""

    name: str
    walls: tuple[tuple[float, ...], ...]
    holes: tuple[tuple[tuple[float, float], ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PageScene:
    """All that a page shows of a program once.

    Attributes:
        title: name of the run or recording.
        robot: name of the robot at run time.
        description: name of its description.
        frame_s: period of the frames in seconds.
        sensors: the sensors that are shown.
        actuators: the actuators.
        modules: names of the modules.
        contracts: names of the contracts.
        states: states and machines of the program.
        network: the network's picture, SVG without style.
        nodes: the kind of each node of the network: module, suppressor or inhibitor.
        windows: the time constant of each node in seconds, 0 for none.
        has_pose: True if the program reads the robot's position and heading.
        map: the map, if one was given.
        footprint_mm: the corners of the robot seen from above, x ahead and y left; empty if unknown.
        is_idle: True if the robot runs no program, so that all of this is of its description.
    """

    title: str
    robot: str
    description: str
    frame_s: float
    sensors: tuple[SensorScene, ...]
    actuators: tuple[ActuatorScene, ...]
    modules: tuple[str, ...]
    contracts: tuple[str, ...]
    states: tuple[StateScene, ...]
    network: str
    nodes: tuple[str, ...]
    windows: tuple[float, ...]
    has_pose: bool
    map: MapScene | None = None
    footprint_mm: tuple[tuple[float, float], ...] = ()
    is_idle: bool = False


def scene_of(
    program: Program,
    title: str,
    clients: Sequence[tuple[str, str, int]],
    map_: MapScene | None = None,
    footprint_mm: tuple[tuple[float, float], ...] = (),
    robot: str | None = None,
) -> PageScene:
    """Return the scene of a program.

    Args:
        program: the program.
        title: name of the run or recording.
        clients: actuator, module and priority, highest priority first.
        map_: the map, if there is one.
        footprint_mm: the corners of the robot.
        robot: name of the robot at run time; None for that of its description.
    """
    network = elaborate(program)
    read = {node.name for node in all_subexpressions(program) if isinstance(node, SensorValue)}
    return PageScene(
        title=title,
        robot=program.robot.name if robot is None else robot,
        description=program.robot.name,
        frame_s=program.robot.frame_ns / 1e9,
        sensors=tuple(_sensor(s, is_read=s.name in read) for s in shown_sensors(program)),
        actuators=tuple(
            ActuatorScene(
                name=a.name,
                fields=tuple(map(_field, a.fields)),
                clients=tuple(module for actuator, module, _ in clients if actuator == a.name),
            )
            for a in program.robot.actuators
        ),
        modules=tuple(m.name for m in program.modules),
        contracts=tuple(f"{c.name} (assumption)" if c.is_assumption else c.name for c in program.contracts),
        states=tuple(map(_state, shown_states(program))),
        network=to_live_svg(network),
        nodes=tuple(map(_node_kind, network.nodes)),
        windows=tuple(_window_s(network, i) for i in range(len(network.nodes))),
        has_pose=len(pose_sensors(program)) == len(POSE_FIELDS),
        map=map_,
        footprint_mm=footprint_mm,
    )


def shown_sensors(program: Program) -> tuple[Sensor, ...]:
    """Return the sensors that a page shows: all but what actuators were given, which the commands show."""
    return tuple(s for s in program.robot.sensors if s.sent is None)


def shown_states(program: Program) -> tuple[State | Machine, ...]:
    """Return states and machines: first those of the file, then those of modules."""
    return tuple(_states(program))


def _states(program: Program) -> Iterator[State | Machine]:
    for derived in program.derived:
        if isinstance(derived, State | Machine):
            yield derived
    for module in program.modules:
        if isinstance(module, Module):
            yield from module.states


POSE_FIELDS = ("x", "y", "heading")
"""Fields of RServer that give the pose: mm to the east and north, degrees counterclockwise from north."""


def pose_sensors(program: Program) -> tuple[Sensor, ...]:
    """Return the sensors of the pose in the order of `POSE_FIELDS`; fewer if the program reads fewer."""
    by_field = {s.field: s for s in program.robot.sensors if s.server == "RServer" and s.sent is None}
    return tuple(by_field[name] for name in POSE_FIELDS if name in by_field)


def _sensor(sensor: Sensor, *, is_read: bool) -> SensorScene:
    bearings = bearings_of(sensor.type)
    element = element_type(sensor.type)
    words, numbers = _words(element)
    is_distance = element == DISTANCE
    in_meters = bearings is not None and is_distance
    factor = sensor.factor / _MM_PER_M if in_meters else 1.0
    return SensorScene(
        name=sensor.name,
        kind=_kind(sensor),
        unit="m" if in_meters else sensor.unit,
        factor=factor,
        low=_bound(sensor.low, sensor.factor, factor),
        high=_bound(sensor.high, sensor.factor, factor),
        words=words,
        numbers=numbers,
        bearings=() if bearings is None else bearings.angles,
        is_distance=is_distance,
        origin=f"{sensor.server}.{sensor.field}",
        is_read=is_read,
    )


def _kind(sensor: Sensor) -> SensorKind:
    if isinstance(sensor.type, Array):
        return "row" if sensor.type.bearings is None else "polar"
    match sensor.type:
        case Bool():
            return "lamp"
        case Enum():
            return "word"
        case Quantity():
            return "slider" if sensor.tunable else "strip"
        case _:
            assert_never(sensor.type)


def _bound(bound: float | None, declared: float, factor: float) -> float | None:
    return None if bound is None or not math.isfinite(bound) else bound / declared * factor


def _words(type_: Scalar) -> tuple[tuple[str, ...], tuple[float, ...]]:
    match type_:
        case Bool():
            return ("false", "true"), (0.0, 1.0)
        case Enum(members=members):
            return tuple(name for name, _ in members), tuple(number for _, number in members)
        case Quantity():
            return (), ()
        case _:
            assert_never(type_)


def _field(field: ActuatorField) -> FieldScene:
    words, numbers = _words(field.type)
    return FieldScene(
        name=field.name,
        unit=field.unit,
        low=_bound(field.low, field.factor, 1.0),
        high=_bound(field.high, field.factor, 1.0),
        words=words,
        numbers=numbers,
    )


def _state(state: State | Machine) -> StateScene:
    words, numbers = _words(state.type)
    unit, factor = "", 1.0
    if isinstance(state.type, Quantity):
        readable = unit_shown(state.type)
        unit, factor = readable.text, float(1 / readable.factor)
    tasks = state.tasks if isinstance(state, Machine) else ()
    return StateScene(name=state.name, unit=unit, factor=factor, words=words, numbers=numbers, tasks=tasks)


def _node_kind(node: ModuleLeaf | Suppressor | Inhibitor) -> str:
    match node:
        case ModuleLeaf():
            return "module"
        case Suppressor():
            return "suppressor"
        case Inhibitor():
            return "inhibitor"
        case _:
            assert_never(node)


def _window_s(network: Network, index: int) -> float:
    node = network.nodes[index]
    return 0.0 if isinstance(node, ModuleLeaf) else node.window_ns / 1e9


# --- footprint -----------------------------------------------------------------------------------------
#
# The footprint of a robot, for a page.


def footprint_of(body: Body) -> tuple[tuple[float, float], ...]:
    """Return the corners of a robot, x ahead and y left, in mm."""
    footprint = body.chassis.footprint
    if isinstance(footprint, Polygon):
        return tuple((corner.x_mm, corner.y_mm) for corner in footprint.corners)
    return circle(radius_mm(body))


CORNERS = 24
"""Corners of a circle in a picture."""


def circle(radius: float) -> tuple[tuple[float, float], ...]:
    """Return the corners of a circle."""
    angles = [2.0 * math.pi * i / CORNERS for i in range(CORNERS)]
    return tuple((round(radius * math.cos(a), 1), round(radius * math.sin(a), 1)) for a in angles)
