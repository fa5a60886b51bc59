"""The modes of the base: how far, which way, how fast, and that they end standing."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from colony.runtime.arbitration import motion
from colony.runtime.arbitration.motion import (
    STILL,
    Arc,
    BaseObservation,
    ConstantSpeeds,
    Go,
    Halt,
    Jog,
    Motion,
    Move,
    OdometerPose,
    Speeds,
    Turn,
    braking_speed,
    interrupt,
    mode,
    step,
)

DT = 0.05
AT_ONCE = Speeds(1e9, 1e9)


class Ground:
    """A base on which a motion is tried: its speeds follow what it is told as fast as `accelerations`."""

    def __init__(self, *, pushed: float = 0.0, accelerations: Speeds = AT_ONCE) -> None:
        self.x = self.y = self.heading = 0.0
        self.speeds = self.sent = STILL
        self.pushed = pushed
        self.accelerations = accelerations
        self.log: list[Speeds] = []

    def run(self, wanted: Motion, frames: int = 2000, *, held: bool = False) -> motion.End | None:
        for _ in range(frames):
            seen = BaseObservation(OdometerPose(self.x, self.y, self.heading), self.sent, DT)
            self.sent, wanted, end = step(wanted, seen)
            self.log.append(self.sent)
            if not held:
                self.roll()
            if end is not None:
                for _ in range(40):  # it stands, or slows down
                    self.sent = STILL
                    self.roll()
                return end
        return None

    def roll(self) -> None:
        dt = 0.001
        for _ in range(round(DT / dt)):
            velocity = motion.approach(
                self.speeds.velocity, self.sent.velocity, self.accelerations.velocity * dt
            )
            turn = motion.approach(self.speeds.turn, self.sent.turn, self.accelerations.turn * dt)
            self.speeds = Speeds(velocity, turn)
            self.heading += (turn + self.pushed) * dt
            self.x -= math.sin(math.radians(self.heading)) * velocity * dt
            self.y += math.cos(math.radians(self.heading)) * velocity * dt


@pytest.fixture
def ground() -> Ground:
    return Ground()


@pytest.mark.parametrize("distance", [1500.0, -1500.0, 120.0, -7.0, 0.5, 0.0])
@pytest.mark.parametrize("velocity", [600.0, 40.0])
def test_a_move_goes_as_far_as_it_was_told_and_no_further(
    ground: Ground, distance: float, velocity: float
) -> None:
    assert ground.run(Move(distance=distance, velocity=velocity, acceleration=400.0)) == "done"
    assert ground.y == pytest.approx(distance, abs=motion.DISTANCE_TOLERANCE_MM)
    assert abs(ground.y) <= abs(distance)
    assert ground.x == 0.0
    assert all(abs(speeds.velocity) <= velocity for speeds in ground.log)
    assert ground.sent == STILL


def test_a_move_speeds_up_goes_along_and_slows_down(ground: Ground) -> None:
    ground.run(Move(distance=1000.0, velocity=200.0, acceleration=400.0))
    speeds = [s.velocity for s in ground.log]
    assert speeds[:10] == pytest.approx([20.0 * k for k in range(1, 11)])
    assert speeds.count(200.0) > 50
    top = len(speeds) - speeds[::-1].index(200.0)
    assert all(b < a for a, b in pairwise(speeds[top:-1]))
    assert all(a - b <= 400.0 * DT + 1e-9 for a, b in pairwise(speeds[:-1]))


def test_motions_are_as_exact_on_a_base_that_follows_slowly() -> None:
    ground = Ground(accelerations=Speeds(800.0, 240.0))
    assert ground.run(Move(distance=1000.0, velocity=500.0, acceleration=400.0)) == "done"
    assert ground.y == pytest.approx(1000.0, abs=2.0)
    ground = Ground(accelerations=Speeds(800.0, 240.0))
    assert ground.run(Turn(degrees=-90.0, velocity=60.0, acceleration=120.0, braking=400.0)) == "done"
    assert ground.heading == pytest.approx(90.0, abs=0.5)


@pytest.mark.parametrize("degrees", [90.0, -90.0, 720.0, 0.1, 0.0])
def test_a_turn_is_clockwise_where_it_is_positive_and_so_lowers_the_heading(
    ground: Ground, degrees: float
) -> None:
    assert ground.run(Turn(degrees=degrees, velocity=45.0, acceleration=90.0, braking=400.0)) == "done"
    assert ground.heading == pytest.approx(-degrees, abs=motion.ANGLE_TOLERANCE_DEG)
    assert (ground.x, ground.y) == (0.0, 0.0)


@pytest.mark.parametrize(("degrees", "side"), [(90.0, 1.0), (-90.0, -1.0)])
def test_an_arc_ends_where_its_circle_says(ground: Ground, degrees: float, side: float) -> None:
    assert ground.run(Arc(degrees=degrees, radius=500.0, velocity=200.0, acceleration=400.0)) == "done"
    assert ground.heading == pytest.approx(-degrees, abs=motion.ANGLE_TOLERANCE_DEG)
    assert (ground.x, ground.y) == pytest.approx((side * 500.0, 500.0), abs=5.0)


def test_a_held_heading_forgets_a_push_only_with_integration() -> None:
    off = {}
    for integrating in (True, False):
        ground = Ground(pushed=3.0)
        ground.run(Go(velocity=200.0, acceleration=400.0, integrating=integrating), 600)
        off[integrating] = abs(ground.heading)
    assert off[True] < 0.05
    assert off[False] == pytest.approx(3.0 / motion.HEADING_GAIN, rel=0.1)


def test_go_speeds_up_with_the_acceleration_and_goes_backward_too(ground: Ground) -> None:
    assert ground.run(Go(velocity=-100.0, acceleration=400.0), 20) is None
    assert [s.velocity for s in ground.log[:6]] == [-20.0, -40.0, -60.0, -80.0, -100.0, -100.0]
    assert ground.heading == 0.0


def test_a_base_that_was_held_fast_does_not_swing_by_what_it_integrated() -> None:
    wanted: Motion = Go(velocity=100.0, acceleration=400.0)
    _, wanted, _ = step(wanted, BaseObservation(OdometerPose(0.0, 0.0, 0.0), STILL, DT))
    for _ in range(10_000):
        speeds, wanted, _ = step(
            wanted, BaseObservation(OdometerPose(0.0, 0.0, 30.0), Speeds(100.0, 0.0), DT)
        )
    assert wanted.integral == -motion.MAX_INTEGRAL
    assert speeds.turn == -motion.MAX_CORRECTION


def test_jog_turns_clockwise_on_top_of_forward_motion(ground: Ground) -> None:
    ground.run(Jog(velocity=100.0, rate=10.0, acceleration=4000.0, turn_acceleration=4000.0), 100)
    assert ground.heading == pytest.approx(-50.0)
    assert ground.log[-1] == Speeds(100.0, -10.0)


def test_standing_still_at_once_or_gradually() -> None:
    seen = BaseObservation(None, Speeds(300.0, -40.0), DT)
    brake = {"acceleration": 400.0, "turn_acceleration": 100.0}
    assert step(Halt(gradual=False, **brake), seen).speeds == STILL
    assert step(Halt(gradual=True, **brake), seen).speeds == Speeds(280.0, -35.0)
    shoved = BaseObservation(None, Speeds(0.0, 0.0, -300.0), DT)
    assert step(Halt(gradual=True, **brake), shoved).speeds == Speeds(0.0, 0.0, -280.0)


def test_drive_is_what_it_says() -> None:
    speeds = Speeds(1.0, 2.0, 3.0)
    assert step(ConstantSpeeds(speeds=speeds), BaseObservation(None, STILL, DT)).speeds == speeds


def test_a_motion_ahead_or_around_commands_no_sideways_speed() -> None:
    seen = BaseObservation(OdometerPose(0.0, 0.0, 0.0), Speeds(0.0, 0.0, 200.0), DT)
    motions: tuple[Motion, ...] = (
        Go(velocity=100.0, acceleration=400.0),
        Jog(velocity=100.0, rate=10.0, acceleration=400.0, turn_acceleration=100.0),
        Move(distance=1000.0, velocity=100.0, acceleration=400.0),
        Turn(degrees=90.0, velocity=30.0, acceleration=100.0, braking=400.0),
        Arc(degrees=90.0, radius=500.0, velocity=100.0, acceleration=400.0),
    )
    assert [step(motion, seen).speeds.sideways for motion in motions] == [0.0] * 5


def test_what_cannot_be_measured_is_not_begun() -> None:
    for wanted in (
        Move(distance=10.0, velocity=10.0, acceleration=10.0),
        Turn(degrees=10.0, velocity=10.0, acceleration=10.0, braking=10.0),
    ):
        assert step(wanted, BaseObservation(None, STILL, DT)) == (STILL, wanted, None)
    begun = step(Go(velocity=10.0, acceleration=1000.0), BaseObservation(None, STILL, DT))
    assert begun.speeds == Speeds(10.0, 0.0)


def test_a_base_that_does_not_move_is_given_up_in_time(ground: Ground) -> None:
    assert ground.run(Move(distance=100.0, velocity=50.0, acceleration=400.0), held=True) == "stalled"
    assert len(ground.log) == pytest.approx(motion.STALL_TIMEOUT_S / DT, abs=3)


def test_after_an_interruption_go_holds_the_heading_it_finds_and_a_move_goes_on() -> None:
    go = step(
        Go(velocity=10.0, acceleration=1000.0), BaseObservation(OdometerPose(0.0, 0.0, 5.0), STILL, DT)
    ).motion
    assert go.heading == 5.0
    left = interrupt(go)
    assert left.heading is None
    move = step(
        Move(distance=100.0, velocity=50.0, acceleration=400.0),
        BaseObservation(OdometerPose(0.0, 0.0, 0.0), STILL, DT),
    ).motion
    assert interrupt(move) is move


def test_modes_are_the_labmates() -> None:
    fast = {"acceleration": 1.0, "turn_acceleration": 1.0}
    assert [
        mode(m)
        for m in (
            Go(velocity=1.0, acceleration=1.0),
            Go(velocity=1.0, acceleration=1.0, integrating=False),
            Arc(degrees=1.0, radius=1.0, velocity=1.0, acceleration=1.0),
            Move(distance=1.0, velocity=1.0, acceleration=1.0),
            Turn(degrees=1.0, velocity=1.0, acceleration=1.0, braking=1.0),
            Jog(velocity=1.0, rate=1.0, **fast),
            Halt(gradual=True, **fast),
        )
    ] == [
        "go",
        "proportional go",
        "continuous turn",
        "point-to-point go",
        "point-to-point turn",
        "jog",
        "go",
    ]


def test_a_braking_base_stops_in_what_is_left() -> None:
    for left in (0.1, 1.0, 10.0, 1000.0):
        speed = braking_speed(left, 400.0, DT)
        assert speed * DT + speed * speed / 800.0 == pytest.approx(left)
    assert braking_speed(0.0, 400.0, DT) == 0.0
