"""The topics of a graph that a robot's description uses: its base, its scanner, and what else it can read."""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from colony.cli.robot.graph.geometry import Frames, Transform, Urdf
from colony.cli.ros2_texts import TAKEN
from colony.ir.ros2_messages import (
    BATTERY_STATE,
    BOOL,
    IMU,
    LASER_SCAN,
    ODOMETRY,
    RANGE,
    TWIST,
    TWIST_STAMPED,
)
from colony.ros2.survey import SurveyedTopic

NUMBERS = ("std_msgs/msg/Float32", "std_msgs/msg/Float64", "std_msgs/msg/Int32")
VALUES = (BOOL, RANGE, *NUMBERS)
"""The types of topics that become a sensor each."""

MAX_VALUES = 30
"""Maximum number of topics that become a sensor each."""

PLUMBING = re.compile(r".*/(?:parameter_events|rosout|tf|tf_static|robot_description|clock|_action/\w+)")
"""The topics that belong to ROS and not to a robot."""

STEPS_DEG = (0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 9.0, 10.0, 12.0, 15.0, 18.0, 20.0, 30.0)
"""The steps between the elements of a scan; a full turn is a multiple of each."""

MAX_BEAMS = 720
"""Maximum number of elements of a scan; one with more beams gets every second one, and so on."""

TILTED = 0.9
"""Cosine of the tilt from which a scanner does not look along the floor."""

Values = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanElements:
    """The elements of a scan in the interface: `count` of them from `first_deg` on, `step_deg` apart."""

    first_deg: float
    step_deg: float
    count: int

    @property
    def is_full(self) -> bool:
        """True if the elements go all around."""
        return self.count * self.step_deg == 360.0

    @property
    def last_deg(self) -> float:
        """The bearing of the last element."""
        return self.first_deg + self.step_deg * (self.count - 1)


def scan_elements(scan: Values, bearing_deg: float, is_upside_down: bool) -> ScanElements | None:
    """Return the elements for a scan with this mounting; None if its angles make no sense."""
    count, step = len(scan["ranges"]), math.degrees(scan["angle_increment"])
    first = math.degrees(scan["angle_min"])
    if count < 2 or not step or not math.isfinite(first + step):
        return None
    ends = sorted(-angle if is_upside_down else angle for angle in (first, first + step * (count - 1)))
    span = ends[1] - ends[0]
    for wanted in STEPS_DEG:
        if wanted < 0.99 * abs(step) or span / wanted > MAX_BEAMS:
            continue
        if span + abs(step) >= 360.0 - wanted:
            return ScanElements(first_deg=-180.0, step_deg=wanted, count=round(360.0 / wanted))
        low = math.ceil((ends[0] + bearing_deg) / wanted - 1e-3) * wanted
        elements = math.floor((ends[1] + bearing_deg - low) / wanted + 1e-3) + 1
        return ScanElements(first_deg=(low + 180.0) % 360.0 - 180.0, step_deg=wanted, count=elements)
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenScan:
    """The scan that a robot has, with the mounting of its scanner.

    Attributes:
        topic: its topic.
        frame: the frame of its messages.
        x_m, y_m, bearing_deg: where the scanner is, and looks with its angle 0.
        is_upside_down: True if its angles go clockwise.
        is_placed: True if the graph says where it is.
        elements: its elements in the interface.
        range_m: its range.
        has_zeros: True if it sends 0, which is below its range.
    """

    topic: SurveyedTopic
    frame: str
    x_m: float
    y_m: float
    bearing_deg: float
    is_upside_down: bool
    is_placed: bool
    elements: ScanElements
    range_m: float
    has_zeros: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenTopics:
    """The topics of a robot, and what the graph says of its body.

    Attributes:
        namespace: the namespace of the robot, "" or without a final slash.
        drive, odom, scan, battery, imu: its topics, as far as it has them.
        values: topics of one value, by the names of their sensors.
        base: the frame of the base.
        hull_m: radius and height of the hull; None if no URDF says it.
        wheel_base_m: the distance of its wheels; None if no URDF says it.
        is_simulated: True if /clock has the time of a simulation.
        notes: what was chosen among several, and what is odd.
        unused: the topics that the description does not use.
    """

    namespace: str
    drive: SurveyedTopic | None
    odom: SurveyedTopic | None
    scan: ChosenScan | None
    battery: SurveyedTopic | None
    imu: SurveyedTopic | None
    values: Mapping[str, SurveyedTopic]
    base: str
    hull_m: tuple[float, float] | None
    wheel_base_m: float | None
    is_simulated: bool
    notes: tuple[str, ...]
    unused: tuple[SurveyedTopic, ...]

    @property
    def used(self) -> tuple[SurveyedTopic, ...]:
        """The topics that the description uses."""
        scan = None if self.scan is None else self.scan.topic
        found = (self.drive, self.odom, scan, self.battery, self.imu, *self.values.values())
        return tuple(topic for topic in found if topic is not None)

    def relative(self, topic: SurveyedTopic) -> str:
        """Return the name of a topic as the body has it: within the namespace, if it is there."""
        return topic.name.removeprefix(f"{self.namespace}/")


def choose(topics: Sequence[SurveyedTopic], namespace: str = "") -> ChosenTopics:
    """Choose the topics of a robot.

    Args:
        topics: the topics of the graph.
        namespace: the namespace of the robot; "" for all.
    """
    return _Chooser(topics, namespace).choose()


class _Chooser:
    """Chooses topics. Mutable: notes what was chosen among several."""

    def __init__(self, topics: Sequence[SurveyedTopic], namespace: str) -> None:
        self.namespace = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
        self.topics = [topic for topic in topics if topic.name.startswith(f"{self.namespace}/")]
        self.all = topics
        self.notes: list[str] = []

    def choose(self) -> ChosenTopics:
        odom = self.one("odometry", (ODOMETRY,), ("odom", "odometry/filtered"))
        base = "base_link" if odom is None or odom.newest is None else odom.newest["child_frame_id"]
        urdf = self.urdf()
        frames = urdf.frames if urdf is not None else Frames()
        known = Frames()
        for topic in self.latched("tf_static"):
            known.add_messages(topic.messages)
        chosen = ChosenTopics(
            namespace=self.namespace,
            drive=self.drive(),
            odom=odom,
            scan=self.scan(base, known, frames),
            battery=self.one("battery", (BATTERY_STATE,), ("battery_state", "battery")),
            imu=self.one("inertial unit", (IMU,), ("imu", "imu/data")),
            values=self.values(),
            base=base,
            hull_m=None if urdf is None else urdf.hull(base),
            wheel_base_m=None if urdf is None else urdf.wheel_base(base),
            is_simulated=any(topic.name == "/clock" and topic.publishers for topic in self.all),
            notes=(),
            unused=(),
        )
        faults = [] if chosen.is_simulated else [f"{t.name}: {t.fault}" for t in chosen.used if t.fault]
        unused = [t for t in self.topics if t not in chosen.used and not PLUMBING.fullmatch(t.name)]
        return replace(chosen, notes=(*self.notes, *faults), unused=tuple(unused))

    def one(self, what: str, types: Iterable[str], preferred: Sequence[str]) -> SurveyedTopic | None:
        """Return a topic that is published with one of these types: of a preferred name, or the shortest."""
        found = [t for t in self.topics if t.publishers and len(t.types) == 1 and t.types[0] in types]
        return self.first(what, found, preferred)

    def first(
        self, what: str, found: Sequence[SurveyedTopic], preferred: Sequence[str]
    ) -> SurveyedTopic | None:
        """Return the topic of a preferred name, or the shortest one; note which others there are."""
        if not found:
            return None
        ends = [f"/{name}" for name in preferred]

        def order(topic: SurveyedTopic) -> tuple[bool, int, int, str]:
            place = next((i for i, end in enumerate(ends) if topic.name.endswith(end)), len(ends))
            return topic.newest is None and what != "drive", place, topic.name.count("/"), topic.name

        first, *others = sorted(found, key=order)
        if others:
            names = ", ".join(topic.name for topic in others)
            self.notes.append(f"{what}: took {first.name}, and not {names}")
        return first

    def drive(self) -> SurveyedTopic | None:
        """Return the topic that drives the base: a twist that a node subscribes to."""
        twists = [
            topic
            for topic in self.topics
            if topic.subscribers and set(topic.types) & {TWIST, TWIST_STAMPED} and not _is_private(topic)
        ]
        found = self.first("drive", twists, ("cmd_vel",))
        if found is None:
            self.notes.append("no node subscribes to a twist: `cmd_vel` is guessed")
        elif found.publishers:
            nodes = ", ".join(dict.fromkeys(map(str, found.publishers)))
            self.notes.append(
                f"{nodes} commands {found.name} now: `colony drive` waits until it does not; "
                "`colony shadow` runs beside it"
            )
        return found

    def latched(self, name: str) -> list[SurveyedTopic]:
        """Return the topics of this name, in the namespace or at the root, with their messages."""
        names = (f"{self.namespace}/{name}", f"/{name}")
        return [topic for topic in self.all if topic.name in names and topic.messages]

    def urdf(self) -> Urdf | None:
        """Return the description of the robot, if there is a usable one."""
        for topic in self.latched("robot_description"):
            try:
                return Urdf(topic.messages[-1]["data"])
            except ValueError as problem:
                self.notes.append(f"{topic.name}: {problem}")
        return None

    def scan(self, base: str, known: Frames, described: Frames) -> ChosenScan | None:
        """Return the scan, with the place of its scanner."""
        topic = self.one("scan", (LASER_SCAN,), ("scan", "scan_filtered", "laser", "laser_scan"))
        if topic is None:
            return None
        if topic.newest is None:
            self.notes.append(f"{topic.name}: nothing arrived, so it is left out")
            return None
        scan = topic.newest
        frame = scan["header"]["frame_id"]
        place = known.between(base, frame) or described.between(base, frame)
        if place is None:
            self.notes.append(f"{topic.name}: no transform from `{frame}` to `{base}`: its pose is guessed")
        mounted = Transform() if place is None else place
        if abs(mounted.rows[2][2]) < TILTED:
            self.notes.append(f"{topic.name}: its scanner does not look along the floor: check its pose")
        is_upside_down = mounted.rows[2][2] < 0.0
        bearing = round(math.degrees(math.atan2(mounted.rows[1][0], mounted.rows[0][0])), 1) + 0.0
        elements = scan_elements(scan, bearing, is_upside_down)
        if elements is None:
            self.notes.append(f"{topic.name}: its angles make no sense, so it is left out")
            return None
        range_m = scan["range_max"]
        return ChosenScan(
            topic=topic,
            frame=frame,
            x_m=mounted.place[0],
            y_m=mounted.place[1],
            bearing_deg=bearing,
            is_upside_down=is_upside_down,
            is_placed=place is not None,
            elements=elements,
            range_m=range_m if 0.0 < range_m <= 1000.0 else 100.0,
            has_zeros=scan["range_min"] > 0.0 and 0.0 in scan["ranges"],
        )

    def values(self) -> dict[str, SurveyedTopic]:
        """Return the topics of one value by the names of their sensors."""
        found: dict[str, SurveyedTopic] = {}
        for topic in self.topics:
            is_value = topic.publishers and len(topic.types) == 1 and topic.types[0] in VALUES
            if is_value and not _is_private(topic) and len(found) < MAX_VALUES:
                found[sensor_name(topic.name.removeprefix(self.namespace), found)] = topic
        return found


def _is_private(topic: SurveyedTopic) -> bool:
    """Return True for a topic that ROS hides, such as one of an action."""
    return any(part.startswith("_") for part in topic.name.split("/"))


DECLARED = frozenset(
    {
        *("ranges", "x", "y", "heading", "speed", "front_bumper", "rear_bumper", "battery", "voltage"),
        *("turn_rate", "gyro_heading", "docked_at", "sensing", "shared", "margin", "reaction"),
        *("fastest_ahead", "fastest_behind"),
    }
)
"""The names that a description has besides those of topics of one value."""


def sensor_name(topic: str, others: Container[str] = ()) -> str:
    """Return a name of the language for the sensor of a topic: `/arm/load (kg)` is `arm_load_kg`."""
    name = re.sub(r"[^A-Za-z0-9]+", "_", topic).strip("_").lower()[:40] or "value"
    if not name[0].isalpha():
        name = f"topic_{name}"
    if name in TAKEN | DECLARED:
        name = f"{name}_value"
    return next(each for each in (name, *(f"{name}_{i}" for i in range(2, 1000))) if each not in others)
