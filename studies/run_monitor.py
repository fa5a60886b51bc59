"""The monitor of a run: its progress, its contacts, and the detection of a stuck robot."""

from __future__ import annotations

import math
from collections.abc import Sequence

from colony.nav.maps.stickrep.model import Pose
from colony.nav.plan.plan import Plan, Segment
from colony.nav.shared import CEILING_LIGHT, GoalKind
from colony.runs.navigation import TIME_LIMIT_FACTOR
from colony.runtime.assembly.loop import Loop
from colony.sim.world.world import World
from studies.record import MODES, Contacts, FailureReason, LightCount, Mode, ModeCount

STUCK_TIMEOUT_NS = 60_000_000_000
"""Time without progress after which a robot is stuck; people block it for at most a quarter of that."""

STUCK_RADIUS_MM = 500.0
"""Distance in mm that counts as progress."""

BELOW_LIGHT_MM = 1500.0
"""Maximum distance in mm of a counted light from its position; lights are 5 to 6 m apart."""

SLIP_MM = 20.0
"""Minimum error of the odometry in a frame, in mm, that indicates a wheel slip."""

RIDE_MM = 200.0
"""Minimum error of the odometry in a frame, in mm, that indicates an elevator ride."""

PATH_INTERVAL_NS = 1_000_000_000


def mode_of(kind: GoalKind) -> Mode:
    """Return the mode as the tables count it; entering and leaving a corner are one mode."""
    match kind:
        case GoalKind.LIGHTS:
            return "L"
        case GoalKind.CORNER | GoalKind.ENTER_CORNER:
            return "C"
        case GoalKind.DEAD_RECKONING | GoalKind.ELEVATOR | GoalKind.NONE:
            return "D"


class RunMonitor:
    """The monitor of a run, updated after every frame. Mutable.

    Args:
        plan: the plan.
        loop: the run.
        world: the world, in which the robot is number 0.
        expected_s: expected time of the plan in seconds, without incidents.
        begun: the indices of the segments that the planner has begun; the planner appends to it.
    """

    def __init__(self, plan: Plan, loop: Loop, world: World, expected_s: float, begun: Sequence[int]) -> None:
        self._plan, self._loop, self._world, self._begun = plan, loop, world, begun
        self._limit_ns = round(TIME_LIMIT_FACTOR * expected_s * 1e9)
        self._begun_count = 0
        self._began_mm: dict[int, float] = {}
        self.done = False
        self._last_progress_pose = world.true_pose(0)
        self._last_progress_ns = 0
        self._light_count = 0
        self._counted_lights: dict[int, set[float]] = {}
        self._false_count = 0
        self._pose, self._odometry = world.true_pose(0), world.odometry(0)
        self.slips = 0
        self.top_mm_s = 0.0
        self.path: list[tuple[int, int]] = []

    def update(self) -> FailureReason:
        """Record the finished frame; return the reason if the run should be abandoned."""
        now_ns, world = self._loop.now_ns, self._world
        self.top_mm_s = max(self.top_mm_s, world.speed(0).ground_mm_s)
        pose, odometry = world.true_pose(0), world.odometry(0)
        odometry_error_mm = abs(_distance_mm(pose, self._pose) - _distance_mm(odometry, self._odometry))
        self.slips += SLIP_MM < odometry_error_mm < RIDE_MM
        self._pose, self._odometry = pose, odometry
        if now_ns % PATH_INTERVAL_NS == 0:
            self.path.append((round(pose.x_mm), round(pose.y_mm)))
        goal = self._update_segment()
        if goal or _distance_mm(pose, self._last_progress_pose) > STUCK_RADIUS_MM:
            self._last_progress_pose, self._last_progress_ns = pose, now_ns
        if now_ns - self._last_progress_ns > STUCK_TIMEOUT_NS:
            return "stuck"
        return "too long" if now_ns > self._limit_ns else ""

    @property
    def _segment(self) -> int:
        """The index of the current segment, -1 before the first one."""
        return self._begun[-1] if self._begun else -1

    @property
    def mode(self) -> Mode:
        """The mode of the current segment."""
        return mode_of(self._plan.segments[max(self._segment, 0)].kind)

    @property
    def contacts(self) -> Contacts:
        """The contacts of the robot so far."""
        world = self._world
        return Contacts(world.bumps(0), world.contact_speed(0))

    @property
    def lights(self) -> LightCount:
        """The lights of the legs begun so far; of the current leg only those that were passed."""
        seen = missed = 0
        for number in self._begun:
            segment, counted = self._plan.segments[number], self._counted_lights.get(number, set())
            is_over = number != self._segment or self.done
            limit_mm = math.inf if is_over else _along(segment, self._world) - BELOW_LIGHT_MM
            passed = {
                light for light in segment.lights_mm if self._began_mm.get(number, 0.0) < light < limit_mm
            }
            seen += len(counted)
            missed += len(passed - counted)
        return LightCount(seen, missed, self._false_count)

    def mode_counts(self) -> tuple[ModeCount, ModeCount, ModeCount]:
        """Return how often each mode was entered and completed so far, and how often it is planned."""
        counts = {mode: [0, 0, 0] for mode in MODES}
        for first, last, mode in _groups(self._plan):
            count = counts[mode]
            count[0] += self._segment >= first
            count[1] += self._is_over(last)
            count[2] += 1
        lights, corners, end = (ModeCount(*counts[mode]) for mode in MODES)
        return lights, corners, end

    def _is_over(self, segment: int) -> bool:
        return self.done or self._segment > segment

    @property
    def completed(self) -> int:
        """The number of completed modes."""
        return sum(self._is_over(last) for _, last, _ in _groups(self._plan))

    @property
    def first_light(self) -> bool:
        """True if a light of the current segment was found."""
        return bool(self._counted_lights.get(self._segment))

    # --- observations --------------------------------------------------------------------------------

    def _update_segment(self) -> bool:
        """Record segments and counted lights; return True if a new segment has begun."""
        is_new = len(self._begun) != self._begun_count
        if is_new:
            self._begun_count, self._light_count = len(self._begun), 0
            segment = self._plan.segments[self._segment]
            self._began_mm[self._segment] = _along(segment, self._world)
        counted = self._loop.data.value(CEILING_LIGHT)
        light = int(counted) if isinstance(counted, (int, float)) else 0
        if is_new and light:
            self._light_count = light  # the count of the previous leg, until CTracker resets it
        elif light != self._light_count:
            for _ in range(self._light_count, light):
                self._count_light()
            self._light_count = light
        return is_new

    def _count_light(self) -> None:
        """Count the nearest light if it is near and was not counted yet; otherwise count a false light."""
        number = self._segment
        segment = self._plan.segments[number] if number >= 0 else None
        if segment is None or segment.kind is not GoalKind.LIGHTS:
            return
        along, counted = _along(segment, self._world), self._counted_lights.setdefault(number, set())
        nearest = min(segment.lights_mm, key=lambda light: abs(light - along))
        if abs(nearest - along) < BELOW_LIGHT_MM and nearest not in counted:
            counted.add(nearest)
        else:
            self._false_count += 1


def _groups(plan: Plan) -> list[tuple[int, int, Mode]]:
    """Return the modes of a plan with their first and last segments; corners have up to two."""
    groups: list[tuple[int, int, Mode]] = []
    for number, segment in enumerate(plan.segments):
        is_entered = number > 0 and plan.segments[number - 1].kind is GoalKind.ENTER_CORNER
        if segment.kind is GoalKind.CORNER and is_entered:
            groups[-1] = (groups[-1][0], number, "C")
        else:
            groups.append((number, number, mode_of(segment.kind)))
    return groups


def _distance_mm(a: Pose, b: Pose) -> float:
    return math.hypot(a.x_mm - b.x_mm, a.y_mm - b.y_mm)


def _along(segment: Segment, world: World) -> float:
    """Return the true distance of the robot from a segment's start, along it, in mm."""
    heading, pose = math.radians(segment.heading_deg), world.true_pose(0)
    dx, dy = pose.x_mm - segment.start.x_mm, pose.y_mm - segment.start.y_mm
    return -math.sin(heading) * dx + math.cos(heading) * dy
