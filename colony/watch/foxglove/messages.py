"""The messages of a run for Foxglove, made of its frames; a file and a live server share them.

An executor of the client list follows the run, as it is fast. The interpreter steps only over frames in which
something begins, from the executor's memory, to explain them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import msgspec

from colony.analysis.follower import Follower, Interpreters, ProgramExecutors, UnknownMemory
from colony.analysis.moments import MomentFollower
from colony.compile.pipeline import compile_program
from colony.execute.decisions import BoundsStep
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import MISSED, given_in_frame
from colony.ir.memory import ProgramMemory, state_cell
from colony.ir.program import Actuator, Program
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
    PageScene,
    SensorScene,
    pose_sensors,
    shown_sensors,
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
        self._interpreters = Interpreters(program)
        pairs = tuple(zip(shown_sensors(program), scene.sensors, strict=True))
        self._scans = [ScanShape(s) for _, s in pairs if s.kind == "polar" and s.is_distance]
        scanned = {scan.sensor.name for scan in self._scans}
        self._plotted = [s for _, s in pairs if s.name not in scanned]
        self._zones = zones_of(program, [scan.sensor for scan in self._scans])
        self._pose = pose_sensors(program) if scene.has_pose else ()
        fields = {s.field: s for s in program.robot.sensors if s.server == "DServer"}
        self._goal = [fields[name] for name in ("GoalX", "GoalY") if name in fields]
        self._actuators = tuple(zip(program.robot.actuators, scene.actuators, strict=True))
        kept = compile_program(program).compiled.code.memory_cells  # without states that nothing reads
        states = zip(shown_states(program), scene.states, strict=True)
        self._states = [(state_cell(s.name), shown) for s, shown in states if state_cell(s.name) in kept]
        self._ranges: dict[str, Sequence[float]] = {}
        self._path: list[tuple[float, float]] = []
        self._due = dict.fromkeys(("/path", "/zones"), 0)
        self._last: dict[str, Any] = {}
        self.channels = tuple(self._channels())

    def _channels(self) -> Iterator[RunChannel]:
        drawn = {f"/scans/{scan.sensor.name}": "LaserScan" for scan in self._scans}
        if self._scene.footprint_mm:
            drawn["/footprint"] = "SceneUpdate"
        if self._zones:
            drawn["/zones"] = "SceneUpdate"
        if self._pose:
            drawn |= {"/tf": "FrameTransform", "/pose": "PoseInFrame", "/path": "SceneUpdate"}
        if len(self._goal) == 2:
            drawn["/goal"] = "SceneUpdate"
        if self._scene.map is not None:
            drawn["/map"] = "Grid"
        for topic, name in {**drawn, "/log": "Log"}.items():
            yield RunChannel(topic, f"foxglove.{name}", WELL_KNOWN[f"foxglove.{name}"])
        plots = {"/sensors": {s.name: _schema(s) for s in self._plotted}}
        plots["/modules"] = dict.fromkeys(self._scene.modules, TEXT)
        plots["/contracts"] = {c.name: FLAG for c in self._program.contracts}
        plots["/states"] = {s.name: _schema(s) for _, s in self._states}
        for _, actuator in self._actuators:
            plots[f"/actuators/{actuator.name}"] = _actuator_schema(actuator)
        for topic, members in plots.items():
            if members:
                name = f"colony{topic.replace('/', '.')}"
                yield RunChannel(topic, name, optional(name, members))

    def still(self, t_ns: int) -> Iterator[RunMessage]:
        """Yield what does not change, and let the next frame have all that seldom changes, for newcomers."""
        self._last = {name: x for name, x in self._last.items() if not name.startswith("/")}
        if self._scene.footprint_mm:
            corners = [(x / MM_PER_M, y / MM_PER_M) for x, y in self._scene.footprint_mm]
            outline = [line(corners, BLUE, closed=True), line([(0, 0), (max(corners)[0], 0)], BLUE)]
            yield _message("/footprint", t_ns, scene_update(t_ns, BASE, "footprint", outline))
        if self._scene.map is not None:
            yield _message("/map", t_ns, grid_of(self._scene.map, t_ns))

    def take(self, frame: RunFrame) -> Iterator[RunMessage]:
        """Yield the messages of the next frame; take all of them before the next frame."""
        executor = self._follower.feed(frame)
        before: ProgramMemory | None = None
        bounds: Mapping[str, BoundsStep] = {}
        breaches = frame.breaches
        memory: ProgramMemory | None = None
        if not isinstance(executor, UnknownMemory):
            before = executor.memory
            given = given_in_frame(self._program.robot.actuators, frame.verdicts)
            breaches = executor.step(frame.frame, frame.answers, given).breaches
            bounds, memory = executor.bounds(), executor.memory
        t_ns = frame.frame.t_ns
        if "winners" not in self._last:
            yield from self.still(t_ns)
        for scan in self._scans:
            yield from self._scanned(scan, frame)
        yield from self._places(frame)
        if self._plotted:
            yield _message("/sensors", t_ns, dict(self._plots(frame)))
        for actuator, scene in self._actuators:
            verdict = frame.verdicts.get(actuator.name)
            if verdict is not None:
                plot = _actuator_plot(actuator, scene, verdict, bounds.get(actuator.name))
                yield _message(f"/actuators/{actuator.name}", t_ns, plot)
        yield from self._shown_zones(t_ns, bounds)
        yield from self._changed(
            t_ns, "/modules", {m: f for v in frame.verdicts.values() for m, f in v.fates}
        )
        if memory is not None:
            shown = {s.name: _shown(memory.cells[cell], s, s.factor) for cell, s in self._states}
            yield from self._changed(t_ns, "/states", shown)
        if breaches is not None:
            held = {c.name: c.name not in breaches for c in self._program.contracts}
            yield from self._changed(t_ns, "/contracts", held)
        yield from self._log(frame, before, breaches)

    # --- what there is to see --------------------------------------------------------------------------

    def _scanned(self, scan: ScanShape, frame: RunFrame) -> Iterator[RunMessage]:
        """Yield a scan that is new: lidars give one in every second frame, or fewer."""
        name, topic = scan.sensor.name, f"/scans/{scan.sensor.name}"
        reading = frame.frame.readings.get(name)
        if not isinstance(reading, Sequence) or len(reading) != len(scan.beams):
            self._ranges.pop(name, None)
        elif name not in self._ranges or self._last.get(topic) != reading:
            factor = scan.sensor.factor
            self._last[topic], self._ranges[name] = reading, [round(x * factor, 4) for x in reading]
            yield _message(topic, frame.frame.t_ns, scan.message(frame.frame.t_ns, self._ranges[name]))

    def _plots(self, frame: RunFrame) -> Iterator[tuple[str, object]]:
        for sensor in self._plotted:
            reading = frame.frame.readings.get(sensor.name)
            if isinstance(reading, Sequence):
                if len(reading) <= MAX_PLOTTED:
                    yield sensor.name, [_shown(x, sensor, sensor.factor) for x in reading]
            elif reading is not None:
                yield sensor.name, _shown(reading, sensor, sensor.factor)

    def _places(self, frame: RunFrame) -> Iterator[RunMessage]:
        """Yield the robot's place, its path and its goal."""
        t_ns, readings = frame.frame.t_ns, frame.frame.readings
        goal = [_base(readings.get(s.name), s.factor) for s in self._goal]
        if len(goal) == 2 and None not in goal and self._last.get("/goal") != goal:
            self._last["/goal"] = goal
            ball = sphere(goal[0] / MM_PER_M, goal[1] / MM_PER_M, 0.3, ORANGE)  # type: ignore[operator]
            yield _message("/goal", t_ns, scene_update(t_ns, MAP, "goal", spheres=[ball]))
        place = [_base(readings.get(s.name), s.factor) for s in self._pose]
        if not place or None in place:
            return
        x, y, heading = place
        assert x is not None and y is not None and heading is not None  # noqa: PT018
        pose = pose_of(x, y, heading)
        yield _message(
            "/tf",
            t_ns,
            {
                "timestamp": time_of(t_ns),
                "parent_frame_id": MAP,
                "child_frame_id": BASE,
                "translation": pose["position"],
                "rotation": pose["orientation"],
            },
        )
        yield _message("/pose", t_ns, {"timestamp": time_of(t_ns), "frame_id": MAP, "pose": pose})
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
        actuators = {a.name: a for a, _ in self._actuators}
        drawn = []
        for zone in self._zones:
            step, i = bounds.get(zone.limit.actuator), zone.limit.field_index
            field = actuators[zone.limit.actuator].fields[i]
            widest = field.high if zone.limit.relation == "<=" else field.low
            now = (step.high if zone.limit.relation == "<=" else step.low) if step is not None else ()
            in_force = bool(now) and now[i] != widest
            drawn.append(line(zone.outline(self._ranges), ORANGE if in_force else GRAY, closed=True))
        yield _message("/zones", t_ns, scene_update(t_ns, BASE, "zones", drawn))

    def _changed(self, t_ns: int, topic: str, now: Mapping[str, object]) -> Iterator[RunMessage]:
        """Yield a message of a topic if it has changed."""
        if now and self._last.get(topic) != now:
            self._last[topic] = now
            yield _message(topic, t_ns, now)

    # --- the log -----------------------------------------------------------------------------------------

    def _log(
        self, frame: RunFrame, before: ProgramMemory | None, breaches: tuple[str, ...] | None
    ) -> Iterator[RunMessage]:
        """Yield what begins with a frame: winners, broken contracts, missed clients, stops, restarts."""
        t_ns, last = frame.frame.t_ns, self._last
        winners = {name: _winner(v) for name, v in frame.verdicts.items()}
        previous = last.get("winners", {})
        changed = {n: w for n, w in winners.items() if w != previous.get(n, _NOBODY)}
        newly = [
            c for c in self._program.contracts if c.name in set(breaches or ()) - last.get("broken", set())
        ]
        moment = self._moment(frame, before) if changed or newly else None
        for name, winner in changed.items():
            text = f"{previous.get(name, _NOBODY)} -> {winner}"
            if moment is not None:
                text = "\n".join((text, *lines(explain(moment, Why(name)))[1 : MAX_REASON_LINES + 1]))
            yield _log(t_ns, INFO, name, text)
        for contract in newly:
            text = "broken"
            if moment is not None:
                text += f": {short(explain_condition(moment, contract.name, contract.expression))}"
            kind = "assumption" if contract.is_assumption else "contract"
            yield _log(t_ns, WARNING if contract.is_assumption else ERROR, f"{kind} {contract.name}", text)
        missed = {f"{n}/{c}": f for n, v in frame.verdicts.items() for c, f in v.fates if f in MISSED}
        for name in missed.keys() - last.get("missed", {}).keys():
            yield _log(t_ns, WARNING, name, missed[name])
        stopped = frame.tick.stopped
        if (stopped is None) != (last.get("stopped") is None):
            text = "released" if stopped is None else f"by {stopped.by or 'a user'}"
            yield _log(t_ns, WARNING, "emergency stop", text)
        if "winners" in last and (frame.begins_epoch or frame.frame.restarted):
            yield _log(t_ns, WARNING, "clock", "all memory restarts")
        if breaches is not None:
            last["broken"] = set(breaches)
        last |= {"winners": {**previous, **winners}, "missed": missed, "stopped": stopped}

    def _moment(self, frame: RunFrame, before: ProgramMemory | None) -> Moment | None:
        """Return a frame as a moment, from the memory before it; None if that is not known."""
        if before is None:
            return None
        follower = MomentFollower(self._program, interpreters=self._interpreters)
        return follower.take(replace(frame, keyframe=Keyframe(before), damaged=False, memory_unknown=False))


def _message(topic: str, t_ns: int, payload: object) -> RunMessage:
    return RunMessage(topic, t_ns, _encode(payload))


def _log(t_ns: int, level: int, name: str, text: str) -> RunMessage:
    payload = {
        "timestamp": time_of(t_ns),
        "level": level,
        "message": text,
        "name": name,
        "file": "",
        "line": 0,
    }
    return _message("/log", t_ns, payload)


def _winner(verdict: Verdict) -> str:
    return verdict.outside or verdict.by or verdict.hold or _NOBODY


def _base(reading: object, factor: float) -> float | None:
    return reading * factor if isinstance(reading, int | float) else None


def _schema(shown: Any) -> Schema:
    """Return the schema of a sensor, a state or a field as it is plotted."""
    own = TEXT if shown.words and shown.words != ("false", "true") else FLAG if shown.words else NUMBER
    described = {**own, "description": shown.unit} if shown.unit else own
    return (
        array(described) if isinstance(shown, SensorScene) and shown.kind in ("polar", "row") else described
    )


def _shown(value: Any, shown: Any, factor: float = 1.0) -> object:
    """Return a value as it is plotted: bools, enumerators by their names, or numbers times a factor."""
    if isinstance(value, bool):
        return value
    if not shown.words:
        return value * factor
    return next((w for w, n in zip(shown.words, shown.numbers, strict=True) if n == value), str(value))


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
