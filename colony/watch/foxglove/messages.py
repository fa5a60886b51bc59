"""The messages of a run for Foxglove, made of its frames; a file and a live server share them.

An executor of the client list follows the run, as it is fast. The interpreter steps only over frames in which
something begins, from the executor's memory, to explain them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import msgspec

from colony.analysis.follower import Follower, Interpreters, ProgramExecutors, UnknownMemory
from colony.analysis.moments import MomentFollower
from colony.compile.pipeline import compile_program
from colony.execute.decisions import BoundsStep
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import MISSED, Reading, given_in_frame
from colony.ir.memory import ProgramMemory, state_cell
from colony.ir.program import Actuator, Program, Sensor
from colony.runtime.frames.run_frame import Keyframe, RunFrame
from colony.runtime.protocol.messages import Verdict
from colony.verify.explain.answer import Why, explain, explain_condition
from colony.verify.explain.moment import Moment
from colony.verify.explain.text import lines, short
from colony.watch.foxglove.schemas import FLAG, NUMBER, TEXT, WELL_KNOWN, Schema, array, optional
from colony.watch.foxglove.shapes import (
    BASE,
    BLUE,
    GRAY,
    MAP,
    MM_PER_M,
    ORANGE,
    ScanShape,
    Shape,
    grid_of,
    line,
    pose_of,
    scene_update,
    sphere,
    time_of,
    zones_of,
)
from colony.watch.scene import (
    ActuatorScene,
    FieldScene,
    PageScene,
    SensorScene,
    StateScene,
    pose_sensors,
    shown_states,
)

ZONE_INTERVAL_NS = 200_000_000
"""Nanoseconds between two pictures of the zones that limits watch."""

PATH_INTERVAL_NS = 1_000_000_000
"""Nanoseconds between two points of the path."""

MAX_PATH_POINTS = 600
"""Maximum number of points of the path; beyond it, every second one is dropped."""

MAX_REASON_LINES = 12
"""Maximum number of lines of a reason."""

MAX_PLOTTED = 64
"""Maximum length of an array that is plotted by its elements; scans show longer ones."""

INFO, WARNING, ERROR = 2, 3, 4

_NOBODY = "nobody"

_encode = msgspec.json.Encoder().encode


class RunChannel(NamedTuple):
    """A topic with the schema of its messages, which are JSON."""

    topic: str
    schema_name: str
    schema: Schema


class RunMessage(NamedTuple):
    """A message of a topic at a time of the run."""

    topic: str
    t_ns: int
    data: bytes


class RunMessages:
    """Makes the messages of a run. Stateful; takes every frame, in order.

    Args:
        program: the program of the run.
        scene: what is shown of it.
    """

    def __init__(self, program: Program, scene: PageScene) -> None:
        self._program, self._scene = program, scene
        self._follower: Follower[ProgramExecutor] = Follower(ProgramExecutors(program))
        self._log = RunLog(program)
        self._scans = [ScanShape(s) for s in scene.sensors if s.kind == "polar" and s.is_distance]
        scanned = [scan.sensor for scan in self._scans]
        self._plotted = [s for s in scene.sensors if s not in scanned]
        self._zones = zones_of(program, scanned)
        self._pose = pose_sensors(program) if scene.has_pose else ()
        variables = {s.field: s for s in program.robot.sensors if s.server == "DServer"}
        goal = [variables[name] for name in ("GoalX", "GoalY") if name in variables]
        self._goal = goal if len(goal) == 2 else []
        self._actuators = tuple(zip(program.robot.actuators, scene.actuators, strict=True))
        kept = compile_program(program).compiled.code.memory_cells  # without states that nothing reads
        states = zip(shown_states(program), scene.states, strict=True)
        self._states = [(state_cell(s.name), shown) for s, shown in states if state_cell(s.name) in kept]
        self._ranges: dict[str, Sequence[float]] = {}
        self._path: list[tuple[float, float]] = []
        self._due = dict.fromkeys(("/path", "/zones"), 0)
        self._sent: dict[str, object] | None = None  # what topics that seldom change had last
        self.channels = tuple(self._channels())

    def _channels(self) -> Iterator[RunChannel]:
        drawn = {f"/scans/{scan.sensor.name}": "LaserScan" for scan in self._scans}
        drawn |= {"/footprint": "SceneUpdate"} if self._scene.footprint_mm else {}
        drawn |= {"/zones": "SceneUpdate"} if self._zones else {}
        drawn |= {"/goal": "SceneUpdate"} if self._goal else {}
        drawn |= {"/map": "Grid"} if self._scene.map is not None else {}
        if self._pose:
            drawn |= {"/tf": "FrameTransform", "/pose": "PoseInFrame", "/path": "SceneUpdate"}
        for topic, name in {**drawn, "/log": "Log"}.items():
            yield RunChannel(topic, f"foxglove.{name}", WELL_KNOWN[f"foxglove.{name}"])
        plots: dict[str, Mapping[str, Schema]] = {
            "/sensors": {s.name: _schema(s) for s in self._plotted},
            "/modules": dict.fromkeys(self._scene.modules, TEXT),
            "/contracts": {c.name: FLAG for c in self._program.contracts},
            "/states": {s.name: _schema(s) for _, s in self._states},
            **{f"/actuators/{a.name}": _actuator_schema(a) for _, a in self._actuators},
        }
        for topic, members in plots.items():
            if members:
                name = f"colony{topic.replace('/', '.')}"
                yield RunChannel(topic, name, optional(name, members))

    def still(self, t_ns: int) -> Iterator[RunMessage]:
        """Yield what does not change, and let the next frame have all that seldom changes, for newcomers."""
        self._sent = {}
        if self._scene.footprint_mm:
            corners = [(x / MM_PER_M, y / MM_PER_M) for x, y in self._scene.footprint_mm]
            outline = [line(corners, BLUE, closed=True), line([(0, 0), (max(corners)[0], 0)], BLUE)]
            yield _message("/footprint", t_ns, scene_update(t_ns, BASE, "footprint", outline))
        if self._scene.map is not None:
            yield _message("/map", t_ns, grid_of(self._scene.map, t_ns))

    def take(self, frame: RunFrame) -> Iterator[RunMessage]:
        """Yield the messages of the next frame; take all of them before the next frame."""
        before: ProgramMemory | None = None
        after: ProgramMemory | None = None
        bounds: Mapping[str, BoundsStep] = {}
        breaches, t_ns = frame.breaches, frame.frame.t_ns
        executor = self._follower.feed(frame)
        if not isinstance(executor, UnknownMemory):
            before = executor.memory
            given = given_in_frame(self._program.robot.actuators, frame.verdicts)
            breaches = executor.step(frame.frame, frame.answers, given).breaches
            bounds, after = executor.bounds(), executor.memory
        if self._sent is None:
            yield from self.still(t_ns)
        for scan in self._scans:
            yield from self._scanned(scan, frame)
        yield from self._places(frame)
        yield from self._shown_zones(t_ns, bounds)
        if self._plotted:
            yield _message("/sensors", t_ns, dict(self._plots(frame)))
        for actuator, scene in self._actuators:
            verdict = frame.verdicts.get(actuator.name)
            if verdict is not None:
                plot = _actuator_plot(actuator, scene, verdict, bounds.get(actuator.name))
                yield _message(f"/actuators/{actuator.name}", t_ns, plot)
        fates = {client: fate for v in frame.verdicts.values() for client, fate in v.fates}
        yield from self._changed("/modules", t_ns, fates)
        if after is not None:
            states = {s.name: _shown(after.cells[cell], s, s.factor) for cell, s in self._states}
            yield from self._changed("/states", t_ns, states)
        if breaches is not None:
            held = {c.name: c.name not in breaches for c in self._program.contracts}
            yield from self._changed("/contracts", t_ns, held)
        yield from self._log.take(frame, before, breaches)

    def _is_new(self, topic: str, content: object) -> bool:
        """Return True, and keep the content, if a topic has not had it last."""
        assert self._sent is not None, "a frame is taken"
        is_new = self._sent.get(topic) != content
        self._sent[topic] = content
        return is_new

    def _changed(self, topic: str, t_ns: int, now: Mapping[str, object]) -> Iterator[RunMessage]:
        if now and self._is_new(topic, now):
            yield _message(topic, t_ns, now)

    def _scanned(self, scan: ScanShape, frame: RunFrame) -> Iterator[RunMessage]:
        """Yield a scan that is new: a lidar may give one in every second frame."""
        name, topic, t_ns = scan.sensor.name, f"/scans/{scan.sensor.name}", frame.frame.t_ns
        reading = _elements(frame.frame.readings.get(name), len(scan.beams))
        if not self._is_new(topic, reading):
            return
        self._ranges.pop(name, None)
        if reading:
            factor = scan.sensor.factor
            self._ranges[name] = ranges = scan.in_range([round(x * factor, 4) for x in reading])
            yield _message(topic, t_ns, scan.message(t_ns, ranges))

    def _plots(self, frame: RunFrame) -> Iterator[tuple[str, object]]:
        """Yield the readings of the other sensors, without those that are missing or faulty."""
        for sensor in self._plotted:
            reading = frame.frame.readings.get(sensor.name)
            if not isinstance(reading, list | tuple):
                found = _shown(reading, sensor, sensor.factor)
                if found is not None:
                    yield sensor.name, found
            elif len(reading) <= MAX_PLOTTED:
                elements = [_shown(x, sensor, sensor.factor) for x in reading]
                if None not in elements:
                    yield sensor.name, elements

    def _places(self, frame: RunFrame) -> Iterator[RunMessage]:
        """Yield the robot's place, its path and its goal."""
        t_ns = frame.frame.t_ns
        if (goal := _numbers(frame, self._goal)) and self._is_new("/goal", goal):
            ball = sphere(goal[0] / MM_PER_M, goal[1] / MM_PER_M, 0.3, ORANGE)
            yield _message("/goal", t_ns, scene_update(t_ns, MAP, "goal", spheres=[ball]))
        place = _numbers(frame, self._pose)
        if not place:
            return
        x, y, heading = place
        pose, now = pose_of(x, y, heading), {"timestamp": time_of(t_ns)}
        step = {"translation": pose["position"], "rotation": pose["orientation"]}
        yield _message("/tf", t_ns, {**now, "parent_frame_id": MAP, "child_frame_id": BASE, **step})
        yield _message("/pose", t_ns, {**now, "frame_id": MAP, "pose": pose})
        if t_ns >= self._due["/path"]:
            self._due["/path"] = t_ns + PATH_INTERVAL_NS
            self._path.append((round(x / MM_PER_M, 3), round(y / MM_PER_M, 3)))
            if len(self._path) > MAX_PATH_POINTS:
                self._path = self._path[::2]
            yield _message("/path", t_ns, scene_update(t_ns, MAP, "path", [line(self._path, BLUE)]))

    def _shown_zones(self, t_ns: int, bounds: Mapping[str, BoundsStep]) -> Iterator[RunMessage]:
        """Yield the sectors that limits watch; those of a bound that is in force are orange."""
        if not self._zones or t_ns < self._due["/zones"]:
            return
        self._due["/zones"] = t_ns + ZONE_INTERVAL_NS
        fields = {a.name: a.fields for a, _ in self._actuators}
        drawn = []
        for zone in self._zones:
            step, i = bounds.get(zone.limit.actuator), zone.limit.field_index
            end = "high" if zone.limit.relation == "<=" else "low"
            now: tuple[float | None, ...] = () if step is None else getattr(step, end)
            is_narrow = bool(now) and now[i] != getattr(fields[zone.limit.actuator][i], end)
            if corners := zone.outline(self._ranges):
                drawn.append(line(corners, ORANGE if is_narrow else GRAY, closed=True))
        yield _message("/zones", t_ns, scene_update(t_ns, BASE, "zones", drawn))


class RunLog:
    """Writes what begins with a frame, and why. Stateful; takes every frame, in order."""

    def __init__(self, program: Program) -> None:
        self._program, self._interpreters = program, Interpreters(program)
        self._winners: dict[str, str] = {}
        self._broken: frozenset[str] = frozenset()
        self._missed: frozenset[str] = frozenset()
        self._is_stopped = False
        self._is_first = True

    def take(
        self, frame: RunFrame, before: ProgramMemory | None, breaches: tuple[str, ...] | None
    ) -> Iterator[RunMessage]:
        """Yield what begins with a frame: winners, broken contracts, missed clients, stops, restarts.

        Args:
            frame: the frame.
            before: the memory before it, None if it is not known.
            breaches: the contracts that are broken, None if that is not known.
        """
        t_ns = frame.frame.t_ns
        winners = {name: v.outside or v.by or v.hold or _NOBODY for name, v in frame.verdicts.items()}
        changed = {name: by for name, by in winners.items() if by != self._winners.get(name, _NOBODY)}
        broken = self._broken if breaches is None else frozenset(breaches)
        newly = [c for c in self._program.contracts if c.name in broken - self._broken]
        moment = self._moment(frame, before) if changed or newly else None
        for name, by in changed.items():
            why = () if moment is None else lines(explain(moment, Why(name)))[1 : MAX_REASON_LINES + 1]
            text = "\n".join((f"{self._winners.get(name, _NOBODY)} -> {by}", *why))
            yield _entry(t_ns, INFO, name, text)
        for c in newly:
            why = () if moment is None else (short(explain_condition(moment, c.name, c.expression)),)
            kind, level = ("assumption", WARNING) if c.is_assumption else ("contract", ERROR)
            yield _entry(t_ns, level, f"{kind} {c.name}", ": ".join(("broken", *why)))
        missed = {
            f"{n}/{c}": fate for n, v in frame.verdicts.items() for c, fate in v.fates if fate in MISSED
        }
        for name in [n for n in missed if n not in self._missed]:
            yield _entry(t_ns, WARNING, name, missed[name])
        stopped = frame.tick.stopped
        if (stopped is not None) != self._is_stopped:
            text = "released" if stopped is None else f"by {stopped.by}"
            yield _entry(t_ns, WARNING, "emergency stop", text)
        if not self._is_first and (frame.begins_epoch or frame.frame.restarted):
            yield _entry(t_ns, WARNING, "clock", "all memory restarts")
        self._winners |= winners
        self._broken, self._missed = broken, frozenset(missed)
        self._is_stopped, self._is_first = stopped is not None, False

    def _moment(self, frame: RunFrame, before: ProgramMemory | None) -> Moment | None:
        """Return a frame as a moment, from the memory before it; None if that is not known."""
        if before is None:
            return None
        follower = MomentFollower(self._program, interpreters=self._interpreters)
        return follower.take(replace(frame, keyframe=Keyframe(before), damaged=False, memory_unknown=False))


def _message(topic: str, t_ns: int, payload: object) -> RunMessage:
    return RunMessage(topic, t_ns, _encode(payload))


def _entry(t_ns: int, level: int, name: str, text: str) -> RunMessage:
    entry = {"level": level, "message": text, "name": name, "file": "", "line": 0}
    return _message("/log", t_ns, {"timestamp": time_of(t_ns), **entry})


def _elements(reading: Reading, size: int) -> Sequence[float]:
    """Return the elements of an array of numbers; none if it is missing or faulty."""
    is_array = isinstance(reading, list | tuple) and len(reading) == size
    return reading if is_array and set(map(type, reading)) <= {int, float} else ()  # type: ignore[arg-type,return-value]


def _numbers(frame: RunFrame, sensors: Sequence[Sensor]) -> list[float]:
    """Return readings in base units; none if one of them is missing or faulty."""
    readings = _elements([frame.frame.readings.get(s.name) for s in sensors], len(sensors))  # type: ignore[misc]
    found = [x * s.factor for x, s in zip(readings, sensors, strict=False)]
    return found if all(map(math.isfinite, found)) else []


Plotted = SensorScene | StateScene | FieldScene


def _schema(shown: Plotted) -> Schema:
    """Return the schema of a sensor, a state or a field as it is plotted."""
    own = TEXT if shown.words and shown.words != _TRUTHS else FLAG if shown.words else NUMBER
    described = {**own, "description": shown.unit} if shown.unit else own
    return (
        array(described) if isinstance(shown, SensorScene) and shown.kind in ("polar", "row") else described
    )


_TRUTHS = ("false", "true")


def _shown(value: object, shown: Plotted, factor: float = 1.0) -> object:
    """Return a value as it is plotted: a bool, an enumerator's name, a number times a factor, or None."""
    if isinstance(value, bool):
        return value
    if not isinstance(value, int | float) or not math.isfinite(value):
        return None
    if not shown.words:
        return value * factor
    return next((w for w, n in zip(shown.words, shown.numbers, strict=True) if n == value), None)


def _actuator_schema(actuator: ActuatorScene) -> dict[str, Schema]:
    members: dict[str, Schema] = dict.fromkeys(("by", "outside", "hold", "fault"), TEXT)
    for field in actuator.fields:
        ends = () if field.words else (f"{field.name}_low", f"{field.name}_high")
        members |= dict.fromkeys((field.name, *ends), _schema(field))
    return members


def _actuator_plot(
    actuator: Actuator, shown: ActuatorScene, verdict: Verdict, bounds: BoundsStep | None
) -> Shape:
    """Return what an actuator was sent, with its bounds, in the declared units."""
    plot: Shape = {"by": verdict.by or _NOBODY}
    others = {"outside": verdict.outside, "hold": verdict.hold, "fault": verdict.fault}
    plot |= {name: text for name, text in others.items() if text is not None}
    for i, (field, scene) in enumerate(zip(actuator.fields, shown.fields, strict=True)):
        if verdict.values is not None:
            plot[field.name] = _shown(verdict.values[i], scene)
        if bounds is not None and bounds.fault is None and not scene.words:
            ends = {"low": bounds.low[i], "high": bounds.high[i]}
            plot |= {f"{field.name}_{end}": x / field.factor for end, x in ends.items() if x is not None}
    return plot
