"""The robot as other nodes of ROS 2 see it: what follows from its state and its verdicts."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest

from colony.ros2.introspection import (
    ERROR,
    MAX_CALLS,
    OK,
    WARN,
    Diagnosis,
    RobotIntrospection,
    WinnerListener,
    diagnoses,
    params_of,
    press,
    winner_of,
)
from colony.runtime.kit.emergency import StopReport
from colony.runtime.kit.robot_state import RobotState, ServerState
from colony.runtime.library.clock import Participants, TunedParam
from colony.runtime.library.leader import ClientStanding, RunStatus
from colony.runtime.protocol.deployment import Tunable
from colony.runtime.protocol.messages import Stopped, Tick, Verdict
from colony.runtime.transport.live.robot_address import local

CLOCK = Participants(
    k=1,
    t_ns=0,
    start=0,
    frame_ns=1,
    run="",
    program="",
    leader=None,
    begun=False,
    restarts=0,
    servers=(),
    clients=(),
)
RUN = RunStatus(
    run="r1",
    program="p",
    file="patrol.colony",
    process=1,
    k=7,
    frames=8,
    restarts=0,
    disagreements=0,
    commanded_by={},
    clients=(),
)


def robot(*servers: ServerState, **parts: Any) -> RobotState:
    """Return the state of a robot."""
    given = {"run": None, "arbitration": None, "participants": CLOCK, **parts}
    return RobotState(robot="burger", servers=servers, **given)


def one(state: RobotState, name: str) -> Diagnosis:
    """Return a diagnosis by its name."""
    (found,) = [each for each in diagnoses(state) if each.name == f"burger: {name}"]
    return found


@pytest.mark.parametrize(
    ("server", "level", "message"),
    [
        (ServerState(server="Lidar", state="up", process=7), OK, "up"),
        (
            ServerState(server="Lidar", state="up", process=7, opening=True),
            WARN,
            "the device is being opened",
        ),
        (
            ServerState(server="Lidar", state="up", process=7, failing=("no node publishes /scan",)),
            ERROR,
            "no node publishes /scan",
        ),
        (ServerState(server="Lidar", state="down", process=7), ERROR, "down"),
        (ServerState(server="Lidar", state="silent", process=7, problem="no answer"), ERROR, "no answer"),
    ],
)
def test_a_server_is_diagnosed(server: ServerState, level: int, message: str) -> None:
    assert one(robot(server), "Lidar") == (level, "burger: Lidar", message, {"process": "7"})


@pytest.mark.parametrize(
    ("changes", "level", "message"),
    [
        ({}, OK, "released"),
        ({"stopped": Stopped(by="ada", t_ns=0)}, WARN, "stopped by ada"),
        ({"trouble": "the disk is full"}, ERROR, "the disk is full"),
    ],
)
def test_an_emergency_stop_is_diagnosed(changes: dict[str, Any], level: int, message: str) -> None:
    state = robot(participants=msgspec.structs.replace(CLOCK, **changes))
    assert one(state, "emergency stop")[::2] == (level, message)
    assert one(robot(participants=None), "emergency stop").level == ERROR


def client(standing: Any) -> ClientStanding:
    """Return a client that was late in two frames and lost in one."""
    return ClientStanding(
        address="drive/turn", standing=standing, on_time=5, late=2, lost=1, restarts=0, last_error=None
    )


@pytest.mark.parametrize(
    ("changes", "level", "message"),
    [
        ({}, OK, "runs"),
        ({"clients": (client("alive"),)}, OK, "runs"),
        ({"still": "no module is active"}, OK, "no module is active"),
        ({"clients": (client("late"),)}, WARN, "drive/turn is late"),
        ({"faults": ("battery",)}, WARN, "`battery` has a value of the wrong type"),
        ({"clients": (client("lost"),)}, ERROR, "drive/turn is lost"),
        ({"assumptions": {"slow": 3}}, WARN, "the assumption `slow` was broken in 3 frames"),
        ({"broken": {"clear": 3}}, ERROR, "the contract `clear` was broken in 3 frames"),
        ({"disagreements": 2}, ERROR, "2 frames disagree with the program"),
    ],
)
def test_a_run_is_diagnosed(changes: dict[str, Any], level: int, message: str) -> None:
    found = one(robot(run=msgspec.structs.replace(RUN, **changes)), "run")
    assert (found.level, found.message) == (level, message)
    assert found.values["program"] == "patrol.colony"
    assert found.values.get("drive/turn late, lost") == ("2, 1" if changes.get("clients") else None)
    assert one(robot(), "run").message == "no program runs"


def test_params_are_those_that_the_site_set() -> None:
    run = msgspec.structs.replace(
        RUN, params="lab.toml", site={"gain": "0.5", "on": "true", "reach": "0.6 m"}
    )
    rows = [(name, value) for name, value, _ in params_of(robot(run=run))]
    assert rows == [("gain", 0.5), ("on", True), ("reach", "0.6 m")]
    assert params_of(robot()) == []


def test_tunable_params_are_numbers_in_their_units() -> None:
    run = msgspec.structs.replace(RUN, params="lab.toml", site={"reach": "0.6 m"})
    reach = Tunable(name="reach", unit="m", initial=0.6, low=0.5, high=2.0)
    rows = params_of(robot(run=run), [TunedParam(tunable=reach, value=0.7)])
    assert rows == [("reach", 0.7, "m, tunable from 0.5 to 2")]


# --- winners --------------------------------------------------------------------------------------


def verdict(by: str | None, *fates: tuple[str, Any], **changes: Any) -> Verdict:
    """Return a verdict on the drive."""
    return Verdict(k=1, t_ns=0, actuator="drive", by=by, values=None, fates=fates, **changes)


@pytest.mark.parametrize(
    ("found", "by", "reason"),
    [
        (verdict("turn", ("turn", "won"), ("cruise", "suppressed")), "turn", "suppresses cruise"),
        (verdict("cruise", ("turn", "inactive"), ("cruise", "won")), "cruise", "the only active module"),
        (verdict(None, ("turn", "late"), ("cruise", "won")), None, "turn is late"),
        (verdict(None, ("turn", "inactive")), None, "no module is active"),
        (verdict("turn", ("turn", "won"), fault="missing"), "turn", "idle: missing"),
        (verdict(None, ("turn", "overridden"), outside="ada"), "ada", "a connection commands"),
        (verdict(None, ("turn", "stopped"), hold="stopped"), None, "emergency stop"),
    ],
)
def test_a_winner_has_its_reason(found: Verdict, by: str | None, reason: str) -> None:
    assert winner_of(found) == (by, reason)


def test_winners_are_passed_on_when_they_change_and_forgotten_with_the_run() -> None:
    changes: list[int] = []
    listener = WinnerListener(lambda: changes.append(1))
    for each in (verdict("turn", ("turn", "won")), verdict("turn", ("turn", "won")), verdict(None)):
        listener.handle(each, 0)
    assert len(changes) == 2
    assert json.loads(listener.text) == {"drive": {"by": None, "reason": "no module is active"}}
    listener.handle(Tick(k=2, t_ns=0, start=2, run="next"), 0)
    assert listener.text == "{}"


# --- calls ----------------------------------------------------------------------------------------


class Button:
    """A stop button with these reports."""

    def __init__(self, report: StopReport) -> None:
        self._report = report

    def press(self) -> StopReport:
        return self._report

    def insist(self, pressed: StopReport) -> StopReport:
        return pressed


@pytest.mark.parametrize(
    ("report", "expected"),
    [
        (
            StopReport(acknowledged=("Clock", "RServer"), problems={}),
            (True, "stopped; acknowledged by Clock, RServer"),
        ),
        (
            StopReport(acknowledged=("Clock",), problems={"RServer": "RServer is frozen"}),
            (False, "stop sent, but: RServer is frozen"),
        ),
    ],
)
def test_a_stop_is_acknowledged_only_when_it_is_kept(report: StopReport, expected: tuple[bool, str]) -> None:
    assert press(Button(report)) == expected  # type: ignore[arg-type]


def test_calls_beyond_the_limit_are_refused() -> None:
    sent: list[Any] = []
    found = RobotIntrospection(local("nobody", {"XDG_RUNTIME_DIR": "/nowhere"}), sent.append)
    for number in range(MAX_CALLS + 1):
        found.on_call(number, "stop")
    assert sent == [{"answer": [MAX_CALLS, False, f"{MAX_CALLS} calls wait already"]}]
