"""A plan driven by a served robot: the scripts around the Navigator over live connections.

    with Session.open("rome") as rome, LiveMission(rome, building, plan) as mission:
        mission.wait()
    print(mission.arrived, mission.goal_error_mm)

In virtual time the same scripts are nodes (`mission.py`); in an experiment they run in the fast loop.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from typing import Any

from colony.nav.maps.building import Building
from colony.nav.missions.goal_verification import GoalVerdict
from colony.nav.plan.plan import Plan
from colony.nav.shared import ELEVATOR_CALL, FLOOR, FLOOR_REACHED, GOAL_TYPE, GoalKind
from colony.runs.navigation import CEILING_CAMERA, FRONT_CAMERA, PLANNER, SIDE_CAMERA, navigation_scripts
from colony.runtime.kit.connection import Connection, Session
from colony.runtime.kit.errors import CallRefusedError, RobotConnectionError, ServerNotFoundError
from colony.runtime.kit.script import Script, do
from colony.runtime.kit.script_live import LiveScripts
from colony.runtime.library import camera, data, robot
from colony.runtime.library.ask import CallRequest
from colony.vision.level_camera import AHEAD, SIDE

DEVICE_TIMEOUT_S = 10.0
"""Timeout in seconds for a device that may still be starting."""


class CameraMissingError(RobotConnectionError):
    """The robot lacks the camera that it navigates by."""


class LiveMission:
    """The scripts that lead a robot along a plan, from `__enter__` on. Mutable.

    The robot must stand before the first room; its base is set to that position. At the end the goal is
    cleared, because no script is left to set the next one. The robot needs the camera that looks up. Cameras
    that look to the left and ahead are used if they have images of the size that the finders expect.

    Args:
        session: the session with the robot.
        building: the building that the robot is in.
        plan: the path to its goal.
        operator: the script that asks for elevator buttons to be pressed; without it the robot relies on its
            sensors.
    """

    def __init__(
        self, session: Session, building: Building, plan: Plan, *, operator: Script | None = None
    ) -> None:
        self._session, self._building, self._plan = session, building.with_floors(plan.floors), plan
        self._operator = operator or no_operator()
        self._scripts: LiveScripts | None = None
        self._began_s = time.monotonic()
        self.duration_s = 0.0
        self.goal_error_mm, self.floor = math.nan, plan.floors[0]
        self.verdict = GoalVerdict.UNSEEN

    @property
    def over(self) -> bool:
        """True if the planner is done, or a script has failed."""
        return self._scripts is not None and self._scripts.over

    @property
    def arrived(self) -> bool:
        """True if the planner was done when the mission ended."""
        return self._scripts is not None and self._scripts.done

    @property
    def problem(self) -> str:
        """The error that a script raised; "" for none."""
        return "" if self._scripts is None else self._scripts.problem

    def wait(self) -> None:
        """Wait until the mission is over."""
        if self._scripts is not None:
            self._scripts.wait()

    def __enter__(self) -> LiveMission:
        """Prepare the robot and start the scripts."""
        self._begin()
        scripts = navigation_scripts(
            self._plan, self._building, cameras=self._cameras(), on_verdict=self._on_verdict
        )
        self._scripts = LiveScripts(self._session, {**scripts, "operator": self._operator}, leader=PLANNER)
        self._began_s = time.monotonic()
        self._scripts.__enter__()
        return self

    def __exit__(self, *raised: object) -> None:
        """End the scripts and clear the robot's goal."""
        assert self._scripts is not None
        try:
            self._scripts.close()
        finally:  # even if waiting for the scripts to end is interrupted
            self.duration_s = time.monotonic() - self._began_s
            with suppress(RobotConnectionError):
                self._end()

    def _begin(self) -> None:
        """Set the position of the base and the floor, and check that the camera is running.

        Raises:
            CameraMissingError: the camera is missing.
            RobotConnectionError: the base or the data server does not answer.
        """
        # Before the scripts begin: stored values may come from a mission that ended on another floor.
        with self._session.connect("DServer", name=PLANNER) as store:
            store.do(data.set_many({FLOOR: self._plan.floors[0], ELEVATOR_CALL: []}))
        with self._session.connect("RServer", name=PLANNER) as base:
            _retry_until_available(base, robot.position())
            base.do(robot.set_position(*self._plan.start))
        try:
            with self._session.connect(CEILING_CAMERA, name=PLANNER) as camera_server:
                _retry_until_available(camera_server, camera.size())
        except ServerNotFoundError as problem:
            hint = f"it finds its way by ceiling lights: serve it with `--camera {CEILING_CAMERA}=up`"
            raise CameraMissingError(f"{problem}; {hint}") from None

    def _cameras(self) -> frozenset[str]:
        """Return the robot's cameras that the scripts can use."""
        available = {CEILING_CAMERA}
        for name, geometry in ((SIDE_CAMERA, SIDE), (FRONT_CAMERA, AHEAD)):
            with suppress(RobotConnectionError), self._session.connect(name, name=PLANNER) as camera_server:
                size = camera_server.do(camera.size())
                if (size.width, size.height) == (geometry.columns, geometry.rows):
                    available.add(name)
        return frozenset(available)

    def _on_verdict(self, verdict: GoalVerdict) -> None:
        self.verdict = verdict

    def _end(self) -> None:
        """Clear the goal, and read where the robot believes to be."""
        with self._session.connect("DServer", name=PLANNER) as store:
            store.do(data.set(GOAL_TYPE, int(GoalKind.NONE)))
            self.floor = store.do(data.get(FLOOR))
        with self._session.connect("RServer", name=PLANNER) as base:
            here, goal = base.do(robot.position()), self._plan.segments[-1].end
        self.goal_error_mm = math.hypot(here.x - goal.x_mm, here.y - goal.y_mm)


def no_operator() -> Script:
    """Set `FloorReached`, in place of an operator.

    A value left by an earlier operator would keep the robot inside an elevator.
    """
    yield from do("DServer", data.set(FLOOR_REACHED, 1))


def _retry_until_available(server: Connection, call: CallRequest[Any]) -> None:
    """Repeat a call until it succeeds: the device may have just been started."""
    deadline = time.monotonic() + DEVICE_TIMEOUT_S
    while True:
        try:
            server.do(call)
        except CallRefusedError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.1)
        else:
            return
