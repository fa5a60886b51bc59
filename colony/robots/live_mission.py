"""A plan driven by a robot that is served: the scripts of a variant over live connections.

    with Session.open("rome") as rome, LiveMission(rome, building, plan) as mission:
        mission.wait()
    print(mission.arrival)

In virtual time the same scripts are nodes (`mission.py`), in an experiment they run in the fast loop.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from typing import Any

from colony.nav.maps.building import Building
from colony.nav.missions.goal_verification import Verdict
from colony.nav.plan.plan import Plan
from colony.nav.shared import ELEVATOR_CALL, FLOOR, FLOOR_REACHED, GOAL_TYPE, GoalKind
from colony.robots.variants import CEILING_CAMERA, FRONT_CAMERA, OURS, PLANNER, SIDE_CAMERA
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import CallRefused, ConnectionProblem, ServerNotFound
from colony.runtime.kit.script import Script, do
from colony.runtime.kit.scripts_live import LiveScripts
from colony.runtime.library import camera, data, robot
from colony.runtime.library.ask import Ask
from colony.vision.level_camera import AHEAD, SIDE

DEVICE_S = 10.0
"""For how long a device may be about to start."""


class NoCamera(ConnectionProblem):
    """The robot lacks the camera by which it finds its way."""


class LiveMission:
    """The scripts that lead a robot along a plan, from `__enter__` on. Mutable: how far they are.

    The robot has to stand before the first room, and is told so. In the end it has no goal any more: nobody
    is there who could give it the next one. It needs the camera that looks up; those that look to the left
    and ahead are of use where it has them, with images as large as their finders expect.

    Args:
        session: what this process has with the robot.
        building, plan: where it is, and where to.
        operator: who has elevators' buttons pressed; by default nobody, and the robot goes by what it sees.
    """

    def __init__(
        self, session: Session, building: Building, plan: Plan, *, operator: Script | None = None
    ) -> None:
        self._session, self._building, self._plan = session, building.part(plan.floors), plan
        self._operator = operator or nobody()
        self._scripts: LiveScripts | None = None
        self._began_s = time.monotonic()
        self.took_s = 0.0
        self.off_mm = math.nan
        self.verdict = Verdict.UNSEEN

    @property
    def over(self) -> bool:
        """Whether the planner is done, or a script has failed."""
        return self._scripts is not None and self._scripts.over

    @property
    def arrived(self) -> bool:
        """Whether the planner is done, after the end."""
        return self._scripts is not None and self._scripts.done

    @property
    def problem(self) -> str:
        """What a script raised; "" where none did."""
        return "" if self._scripts is None else self._scripts.problem

    def wait(self) -> None:
        """Until it is over."""
        if self._scripts is not None:
            self._scripts.wait()

    def __enter__(self) -> LiveMission:
        self._begin()
        scripts = OURS.scripts(self._plan, self._building, cameras=self._cameras(), on_verdict=self._verified)
        self._scripts = LiveScripts(self._session, {**scripts, "operator": self._operator}, leader=PLANNER)
        self._began_s = time.monotonic()
        self._scripts.__enter__()
        return self

    def __exit__(self, *raised: object) -> None:
        assert self._scripts is not None
        try:
            self._scripts.close()
        finally:  # also where somebody does not wait for the scripts' end
            self.took_s = time.monotonic() - self._began_s
            with suppress(ConnectionProblem):
                self._end()

    def _begin(self) -> None:
        """Tell the base where it stands, and all on which floor; and see to it that the camera is there.

        Raises:
            NoCamera: it is not.
            ConnectionProblem: the base or the data server does not answer.
        """
        first = self._plan.segments[0]
        # Before the scripts begin: what there is may be of a mission that ended on another floor.
        with self._session.connect("DServer", name=PLANNER) as store:
            store.do(data.set_many({FLOOR: first.start.floor, ELEVATOR_CALL: []}))
        with self._session.connect("RServer", name=PLANNER) as base:
            _once_there(base, robot.position())
            base.do(robot.set_position(first.start.x_mm, first.start.y_mm, first.heading_deg))
        try:
            with self._session.connect(CEILING_CAMERA, name=PLANNER) as eye:
                _once_there(eye, camera.size())
        except ServerNotFound as problem:
            hint = f"it finds its way by ceiling lights: serve it with `--camera {CEILING_CAMERA}=up`"
            raise NoCamera(f"{problem}; {hint}") from None

    def _cameras(self) -> frozenset[str]:
        """Those that the robot has and the scripts understand."""
        there = {CEILING_CAMERA}
        for name, geometry in ((SIDE_CAMERA, SIDE), (FRONT_CAMERA, AHEAD)):
            with suppress(ConnectionProblem), self._session.connect(name, name=PLANNER) as eye:
                size = eye.do(camera.size())
                if (size.width, size.height) == (geometry.columns, geometry.rows):
                    there.add(name)
        return frozenset(there)

    def _verified(self, verdict: Verdict) -> None:
        self.verdict = verdict

    def _end(self) -> None:
        """Nothing is to be driven any more; where is it?"""
        with self._session.connect("DServer", name=PLANNER) as store:
            store.do(data.set(GOAL_TYPE, int(GoalKind.NONE)))
        with self._session.connect("RServer", name=PLANNER) as base:
            here, goal = base.do(robot.position()), self._plan.segments[-1].end
        self.off_mm = math.hypot(here.x - goal.x_mm, here.y - goal.y_mm)


def nobody() -> Script:
    """In place of an operator: the robot is not held back inside an elevator by one that was there before."""
    yield from do("DServer", data.set(FLOOR_REACHED, 1))


def _once_there(server: Connection, ask: Ask[Any]) -> None:
    """Ask until the device has given something: it may have been started just now."""
    end = time.monotonic() + DEVICE_S
    while True:
        try:
            server.do(ask)
        except CallRefused:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)
        else:
            return
