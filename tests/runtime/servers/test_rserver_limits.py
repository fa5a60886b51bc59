"""RServer holds connections to the limits of the program that runs, and to the ranges while none does."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from colony.runtime.library import emergency, robot
from colony.runtime.protocol.messages import Bounds, Request, Stopped, Tick
from tests.kit.base import Stage, deployed, silent
from tests.kit.node_stage import FRAME_NS, MS, result_of


def bounds(most: float = 100.0, **changes: object) -> Bounds:
    """Bounds of a frame that is filled in."""
    fields: dict[str, object] = {"low": (-300.0, -60.0), "high": (most, 60.0)}
    return Bounds(k=0, actuator="drive", **(fields | changes))  # type: ignore[arg-type]


def stage_with_limits() -> Stage:
    stage = Stage(run="r1", deployment=deployed(limited=True))
    stage.tick()
    stage.open("ann/1", priority=9)
    return stage


def frames(stage: Stage, *messages: Request | Bounds, count: int = 1) -> tuple[float, float]:
    """Whole frames with these messages in each; gives the speeds that the base got last."""
    for _ in range(count):
        stage.tick()
        for message in messages:
            stage.handle(msgspec.structs.replace(message, k=stage.k))
        stage.until(stage.k * FRAME_NS + FRAME_NS - 1)
    return (stage.base.velocity, stage.base.turn)


def test_bounds_that_come_late_in_a_frame_are_waited_for() -> None:
    stage = stage_with_limits()
    stage.do("ann/1", robot.drive(300.0, 0.0, lease=1.0))
    stage.tick()
    for request in silent():
        stage.handle(msgspec.structs.replace(request, k=stage.k))
    stage.until(stage.k * FRAME_NS + 39 * MS)
    assert stage.base.velocity == 0.0
    stage.handle(msgspec.structs.replace(bounds(), k=stage.k))
    assert stage.base.velocity == 100.0


def test_a_program_that_comes_and_goes_takes_its_limits_along() -> None:
    stage = Stage()
    stage.tick()
    stage.open("ann/1", priority=9)
    stage.do("ann/1", robot.drive(300.0, 0.0, lease=10.0))
    assert frames(stage, count=2) == (300.0, 0.0)
    leader = stage.open("leader/1", priority=0)
    stage.do(leader, robot.deploy(deployed(limited=True)))
    assert frames(stage) == (0.0, 0.0), "a frame of no run"
    stage.run = "r1"
    assert frames(stage, *silent()) == (0.0, 0.0)
    assert frames(stage, bounds(), *silent()) == (100.0, 0.0)
    stage.close(leader)
    stage.run = ""
    assert frames(stage) == (0.0, 0.0), "what its limits held does not go on without them"
    stage.do("ann/1", robot.drive(300.0, 0.0, lease=10.0))
    assert frames(stage) == (300.0, 0.0)
    leader = stage.open("leader/2", priority=0)
    stage.do(leader, robot.deploy(deployed("r2", limited=True)))
    stage.run = "r2"
    assert frames(stage, *silent()) == (0.0, 0.0), "bounds of an earlier run do not count"
    assert frames(stage, bounds(200.0), *silent()) == (200.0, 0.0)


@pytest.mark.parametrize("ignoring", [False, True])
def test_a_move_that_limits_held_ends_with_the_run(ignoring: bool) -> None:
    stage = Stage()
    stage.tick()
    stage.open("ann/1", priority=9)
    leader = stage.open("leader/1", priority=0)
    stage.do(leader, robot.deploy(deployed(limited=True)))
    stage.run = "r1"
    stage.do("ann/1", robot.ignore_limits(ignoring))
    number = stage.send("ann/1", robot.move(1500.0, velocity=300.0))
    frames(stage, bounds(), *silent(), count=10)
    stage.close(leader)
    stage.run = ""
    if ignoring:
        assert frames(stage, count=20) == (300.0, 0.0)
        return
    assert frames(stage) == (0.0, 0.0)
    problem = stage.replies["ann/1", number].problem
    assert (problem.code, problem.message) == ("limits", "the run whose limits held this command ended")


def test_a_program_without_limits_leaves_the_ranges() -> None:
    stage = Stage(run="r1", deployment=deployed())
    stage.tick()
    stage.open("ann/1", priority=9)
    stage.do("ann/1", robot.drive(450.0, 0.0, lease=1.0))
    assert frames(stage, *silent()) == (450.0, 0.0)
    assert not stage.verdicts[-1].unlimited


def test_a_stop_is_not_limited() -> None:
    stage = stage_with_limits()
    stage.do("ann/1", robot.drive(300.0, 0.0, lease=5.0))
    frames(stage, bounds(low=(50.0, -60.0)), *silent())
    assert stage.base.velocity == 100.0
    stage.do("ann/1", emergency.stop())
    assert stage.base.velocity == 0.0


def test_emergency_stop_in_an_undecided_frame_ends_its_motion_for_good() -> None:
    stage = stage_with_limits()
    stage.do("ann/1", robot.drive(300.0, 0.0, lease=60.0))
    assert frames(stage, bounds(), *silent()) == (100.0, 0.0)
    stage.tick()  # its bounds have not come when the next tick does
    stage.advance((stage.k + 1) * FRAME_NS)
    stage.k += 1
    stopped = Stopped(by="eve/1", t_ns=stage.now_ns)
    stage.handle(Tick(k=stage.k, t_ns=stage.now_ns, run="r1", stopped=stopped))
    assert stage.base.velocity == 0.0
    stage.release()
    assert frames(stage, bounds(), *silent(), count=2) == (0.0, 0.0)


def test_a_move_goes_on_where_limits_only_slow_it_down() -> None:
    stage = stage_with_limits()
    number = stage.send("ann/1", robot.move(200.0, velocity=300.0))
    for _ in range(400):
        frames(stage, bounds(50.0), *silent())
        if ("ann/1", number) in stage.replies:
            break
    assert result_of(robot.move(200.0), stage.replies["ann/1", number]) == pytest.approx(200.0, abs=3.0)


def test_a_move_that_is_held_for_a_while_goes_on_after_it() -> None:
    stage = stage_with_limits()
    number = stage.send("ann/1", robot.move(200.0, velocity=300.0))
    frames(stage, bounds(0.0), *silent(), count=30)
    assert ("ann/1", number) not in stage.replies
    frames(stage, bounds(500.0), *silent(), count=40)
    assert result_of(robot.move(200.0), stage.replies["ann/1", number]) == pytest.approx(200.0, abs=3.0)


def test_a_move_whose_limits_nobody_knows_ends_and_says_so() -> None:
    stage = stage_with_limits()
    number = stage.send("ann/1", robot.move(200.0, velocity=300.0))
    frames(stage, *silent(), count=45)
    problem = stage.replies["ann/1", number].problem
    assert (problem.code, problem.message) == (
        "limits",
        "the program's limits were unknown for 2 s, after 0 mm: its clients are late or lost",
    )


@pytest.mark.parametrize(
    "motion", [robot.move(200.0, velocity=300.0), robot.turn(90.0, velocity=50.0)], ids=["move", "turn"]
)
def test_a_base_that_is_blocked_is_not_held_by_limits_that_only_slow_it_down(motion: Any) -> None:
    stage = stage_with_limits()
    stage.base.roll = lambda now_ns: None  # type: ignore[method-assign]
    number = stage.send("ann/1", motion)
    frames(stage, bounds(low=(-100.0, -20.0), high=(100.0, 20.0)), *silent(), count=45)
    problem = stage.replies["ann/1", number].problem
    assert problem.code == "stalled"
    assert problem.message.startswith("no progress for 2 s, after ")


@pytest.mark.parametrize(
    ("motion", "high"),
    [(robot.move(200.0, velocity=300.0), (0.0, 60.0)), (robot.turn(-90.0, velocity=50.0), (500.0, 0.0))],
    ids=["move", "turn"],
)
def test_a_motion_that_limits_keep_at_rest_ends_with_the_code_limits(
    motion: Any, high: tuple[float, float]
) -> None:
    stage = stage_with_limits()
    number = stage.send("ann/1", motion)
    frames(stage, bounds(high=high), *silent(), count=45)
    problem = stage.replies["ann/1", number].problem
    assert problem.code == "limits"
    assert problem.message.startswith("the program's limits held the base for 2 s, after ")
