"""CTracker: counts the ceiling lights that the robot passes, and keeps its place along the corridor right
(thesis sections 5.6 and 5.8).

It waits for $TrackData, reads the lights to come from LightOffset, and looks at the ceiling every `period_s`.
CeilingLight is how many lights were passed; at each, $LightDet is upped. After the last one Overshoot is how
far beyond it the robot is, and $EndLMode is upped. A tracker that is started anew goes on where one before
it was ended (`track_goals.py`). Lights are given up where the robot has a goal of another kind meanwhile,
from another Planner.

The map knows the place of a light to centimeters, so each valid light also corrects the position at RServer
along the corridor, and its tilted edges the heading. From light to light the scale of the odometry is
learned, and what the robot travels is corrected by it, tracking or not.

One script does that for any number of cameras: their lights meet in the same track, where one that is seen by
two cameras is still one light. That is cheaper than the children of the thesis, and needs no token. Where
cameras are far apart, each may have a child beside it all the same (`light_looks.camera_child`), and `parent`
then verifies what they tell, with the same track.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import Any

from colony.nav.shared import (
    CEILING_LIGHT,
    END_L_MODE,
    LIGHT_DETECTED,
    OVERSHOOT,
    TRACK_DATA,
)
from colony.runtime.kit.script import Script, Step, do, sleep
from colony.runtime.library import data, robot
from colony.runtime.library.robot import Position
from colony.vision.along_track import Scale
from colony.vision.ceiling_camera import UPWARD, CeilingCamera
from colony.vision.light_looks import SILENT, Looker, cameras_looker, children_looker, hurry
from colony.vision.light_track import LightTrack, Passing, Seen
from colony.vision.thesis_track import ThesisTrack
from colony.vision.track_goals import (
    Unfinished,
    end_goal,
    give_up,
    is_given_up,
    new_goal,
    take_goal,
    unfinished_goal,
)

PERIOD_S, THESIS_PERIOD_S = 0.25, 0.5
"""From one look at the ceiling to the next. Half a second is 250 mm at full speed."""

IDLE_S = 0.5
"""How often the travel is corrected while no light is tracked."""

ASK_AGAIN_S = 1.0
"""How often it is asked, while tracking, whether there is a new goal in place of the present one."""

LEAST_CORRECTION_MM = 10.0
"""The least correction that RServer is told between lights."""

LEAST_TURN_DEG, MOST_TURN_DEG = 0.3, 20.0
"""Headings that are off by less are let be; more than that is no heading but a mistake."""

LEAP_MM = 1_000.0
"""Nobody travels that far between two looks at the position."""

_SOONEST_S = 0.02
_OLDEST_IMAGE_S = 1.0
_STANDING_MM = 2.0
_POSITIONS = 8

Track = LightTrack | ThesisTrack


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackerSettings:
    """How a tracker works: how often it looks, whether it corrects RServer, whether it is the thesis's."""

    period_s: float
    correct: bool
    correct_heading: bool
    thesis: bool


def light_tracker(
    *,
    cameras: Sequence[str] = ("CServerUp",),
    geometry: CeilingCamera | Sequence[CeilingCamera] = UPWARD,
    period_s: float | None = None,
    correct: bool = True,
    correct_heading: bool = True,
    thesis: bool = False,
) -> Script:
    """CTracker, which looks at its cameras itself.

    Args:
        geometry: of all cameras, or of each.
        period_s: from one look at the ceiling to the next; 0.25 unless told, 0.5 as printed.
        correct: correct the position at RServer; `correct_heading` also the heading.
        thesis: count as printed, without any correction.

    Raises:
        ValueError: there is not a geometry for each camera, or no period; later, in the script: the variables
            of a goal are not what the Planner should have set.
    """
    geometries = (geometry,) * len(cameras) if isinstance(geometry, CeilingCamera) else tuple(geometry)
    if not cameras or len(geometries) != len(cameras):
        raise ValueError(f"{len(cameras)} cameras with {len(geometries)} geometries; expected one for each")
    settings = TrackerSettings(
        period_s=_period_s(period_s, thesis),
        correct=correct and not thesis,
        correct_heading=correct and correct_heading and not thesis,
        thesis=thesis,
    )
    return _tracker(cameras_looker(cameras, geometries), settings, cameras)


def parent(*, period_s: float | None = None, correct: bool = True, thesis: bool = False) -> Script:
    """CTracker's parent: as `light_tracker`, with what the cameras' children tell."""
    settings = TrackerSettings(
        period_s=_period_s(period_s, thesis),
        correct=correct and not thesis,
        correct_heading=False,
        thesis=thesis,
    )
    return _tracker(children_looker(), settings, ())


def _period_s(told: float | None, thesis: bool) -> float:
    period_s = told if told is not None else THESIS_PERIOD_S if thesis else PERIOD_S
    if not 0.0 < period_s < math.inf:
        raise ValueError(f"period_s is {period_s!r}; expected a finite time above 0")
    return period_s


def _tracker(looker: Looker, settings: TrackerSettings, cameras: Sequence[str]) -> Script:
    yield from hurry(cameras, settings.period_s)
    for name in (TRACK_DATA, LIGHT_DETECTED, END_L_MODE):
        yield from do("DServer", data.create_semaphore(name, 0))
    scale = Scale()
    again = yield from new_goal(0.0)
    left = None if again else (yield from unfinished_goal())
    while True:
        if left is None and not again:
            yield from _awaited_goal(scale if settings.correct else None)
        goal, passed = left or Unfinished((yield from take_goal()), 0)
        left = None
        track: Track = (
            ThesisTrack.start(goal, passed) if settings.thesis else LightTrack.start(goal, scale, passed)
        )
        tracking = _Tracking(track, looker, settings)
        again = yield from tracking.run()
        scale = tracking.scale(scale)


def _awaited_goal(scale: Scale | None) -> Generator[Step, Any, None]:
    """Wait for $TrackData; meanwhile what the robot travels is corrected by the odometry's scale."""
    if scale is None or scale.error == 0.0:
        yield from do("DServer", data.wait(TRACK_DATA))
        return
    last = yield from do("RServer", robot.position())
    while not (yield from new_goal(IDLE_S)):
        now = yield from do("RServer", robot.position())
        dx, dy = scale.error * (now.x - last.x), scale.error * (now.y - last.y)
        if math.hypot(now.x - last.x, now.y - last.y) > LEAP_MM:  # it was told to be elsewhere
            last = now
            continue
        if max(abs(dx), abs(dy)) >= LEAST_CORRECTION_MM:
            yield from do("RServer", robot.adjust_position(dx, dy, 0.0))
            last = Position(x=now.x + dx, y=now.y + dy, heading=now.heading, t_ns=now.t_ns)


class _Tracking:
    """One goal. Mutable: the track, and the robot's last positions, oldest first."""

    def __init__(self, track: Track, looker: Looker, settings: TrackerSettings) -> None:
        self._track = track
        self._looker = looker
        self._settings = settings
        self._positions: deque[Position] = deque(maxlen=_POSITIONS)
        self._looked_at_mm: float | None = None
        self._asked_ns: int | None = None

    def scale(self, known: Scale) -> Scale:
        """What is known of the odometry's scale now."""
        return self._track.reckoning.scale if isinstance(self._track, LightTrack) else known

    def run(self) -> Generator[Step, Any, bool]:
        """Until all lights were passed or given up; True: until there was a new goal in place of this one."""
        if self._track.done:
            yield from do("DServer", data.set(OVERSHOOT, 0.0))
            yield from end_goal()
            return False
        wait_s = 0.0
        while True:
            now_ns = yield from sleep(wait_s)
            if self._is_time_to_ask(now_ns):
                if (yield from new_goal(0.0)):
                    return True
                if (yield from is_given_up()):
                    yield from give_up()
                    return False
            wait_s = self._settings.period_s
            try:
                here = yield from do("RServer", robot.position())
            except SILENT:
                continue
            if not self._positions or here.t_ns > self._positions[-1].t_ns:
                self._positions.append(here)
            if self._settings.correct:  # by the odometry's scale
                yield from self._correct(least_mm=LEAST_CORRECTION_MM)
            yield from self._look(here)
            while not self._track.done:
                progress = self._progress(self._positions[-1])
                self._track, passing = self._track.passing(progress)
                if passing is None:
                    break
                if self._track.done and (yield from new_goal(0.0)):
                    return True  # whose Planner must not be told of the end of this one
                yield from self._tell(passing)
            if self._track.done:
                return False
            wait_s = self._wait_s()

    def _is_time_to_ask(self, now_ns: int) -> bool:
        if self._asked_ns is None:
            self._asked_ns = now_ns
        if now_ns - self._asked_ns < ASK_AGAIN_S * 1e9:
            return False
        self._asked_ns = now_ns
        return True

    def _look(self, here: Position) -> Generator[Step, Any, None]:
        """Take in what the cameras show. From where the robot stands, one look tells all."""
        goal = self._track.goal
        at_mm = goal.progress(here.x, here.y)
        if self._looked_at_mm is not None and abs(at_mm - self._looked_at_mm) < _STANDING_MM:
            return
        looks = yield from self._looker(goal.tilt(here.heading))
        for look in looks:
            then = position_at(tuple(self._positions), look.t_ns)
            if here.t_ns - look.t_ns > _OLDEST_IMAGE_S * 1e9:
                continue
            self._looked_at_mm = at_mm
            seen = Seen(look.lights, goal.progress(then.x, then.y), goal.tilt(then.heading))
            self._track = self._track.seen(seen)

    def _tell(self, passing: Passing) -> Generator[Step, Any, None]:
        """A light was passed."""
        if self._settings.correct and passing.valid:
            yield from self._correct(passing.turned_deg)
        values: dict[str, object] = {CEILING_LIGHT: passing.number}
        if self._track.done:
            values[OVERSHOOT] = passing.beyond_mm
        yield from do("DServer", data.set_many(values))
        yield from do("DServer", data.signal(LIGHT_DETECTED))
        if self._track.done:
            yield from end_goal()

    def _correct(
        self, turned_deg: float | None = None, *, least_mm: float = 0.0
    ) -> Generator[Step, Any, None]:
        """Tell RServer by how much it is off, along the corridor and in the heading."""
        if not isinstance(self._track, LightTrack):
            return
        off_mm = self._track.reckoning.moved(self._progress(self._positions[-1])).error_mm
        turn = turned_deg if turned_deg is not None and self._settings.correct_heading else 0.0
        if not LEAST_TURN_DEG <= abs(turn) <= MOST_TURN_DEG:
            turn = 0.0
        if abs(off_mm) < least_mm and turn == 0.0:
            return
        east, north = self._track.goal.ahead
        yield from do("RServer", robot.adjust_position(off_mm * east, off_mm * north, turn))
        self._track = self._track.told(off_mm)
        moved = [
            Position(x=p.x + off_mm * east, y=p.y + off_mm * north, heading=p.heading + turn, t_ns=p.t_ns)
            for p in self._positions
        ]
        self._positions = deque(moved, maxlen=_POSITIONS)

    def _progress(self, position: Position) -> float:
        return self._track.goal.progress(position.x, position.y)

    def _wait_s(self) -> float:
        """Until the next look; less, where the robot's center comes below a light before."""
        period_s = self._settings.period_s
        newest = self._positions[-1]
        rest_mm = self._track.to_next(self._progress(newest))
        if rest_mm is None or len(self._positions) < 2 or rest_mm <= 0.0:
            return period_s
        before = self._positions[-2]
        passed_s = (newest.t_ns - before.t_ns) / 1e9
        way_mm = self._progress(newest) - self._progress(before)
        if passed_s <= 0.0 or way_mm <= 0.0:
            return period_s
        return min(period_s, max(_SOONEST_S, rest_mm * passed_s / way_mm))


def position_at(positions: Sequence[Position], t_ns: int) -> Position:
    """Where the robot was, from positions in the order of their times: on the straight way between the two
    around that time, or the first or last one."""
    after = next((i for i, position in enumerate(positions) if position.t_ns >= t_ns), len(positions) - 1)
    if after == 0 or positions[after].t_ns <= t_ns:
        return positions[after]
    a, b = positions[after - 1], positions[after]
    part = (t_ns - a.t_ns) / (b.t_ns - a.t_ns)
    turned = (b.heading - a.heading + 180.0) % 360.0 - 180.0
    return Position(
        x=a.x + part * (b.x - a.x),
        y=a.y + part * (b.y - a.y),
        heading=a.heading + part * turned,
        t_ns=t_ns,
    )
