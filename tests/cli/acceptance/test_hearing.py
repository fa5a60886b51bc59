"""What follows from the ticks and verdicts of a robot that is tested."""

from __future__ import annotations

from colony.cli.robot.acceptance.hearing import (
    HeardFrame,
    VerdictListener,
    brakes_ns,
    disturbances,
    recovered_ns,
    slip,
    stopped_ns,
)
from colony.runtime.protocol.deployment import LIMITS_RUN
from colony.runtime.protocol.messages import Fate, Hold, Tick, Verdict

MS = 1_000_000
DRIVE = frozenset({"drive"})
NOBODY = frozenset[str]()


def verdict(k: int, *, hold: Hold | None = None, fate: Fate = "won", actuator: str = "drive") -> Verdict:
    by = None if hold or fate != "won" else "cruise"
    return Verdict(
        k=k, t_ns=50 * MS * k, actuator=actuator, by=by, values=None, fates=(("cruise", fate),), hold=hold
    )


def frame(
    k: int, *verdicts: Verdict, down: tuple[str, ...] = (), lost: tuple[str, ...] = (), run: str = "r"
) -> HeardFrame:
    """A frame that was decided 10 ms after it began."""
    made = HeardFrame(tick=Tick(k=k, t_ns=50 * MS * k, run=run, down=down, lost=lost))
    for one in verdicts:
        made.take(one, (50 * k + 10) * MS)
    return made


def good(k: int) -> HeardFrame:
    return frame(k, verdict(k))


def test_messages_become_frames_in_whatever_order_they_come() -> None:
    listener = VerdictListener()
    for now_ns, message in ((3, verdict(1)), (4, Tick(k=1, t_ns=50 * MS)), (6, Tick(k=2, t_ns=100 * MS))):
        listener.handle(message, now_ns)
    listener.handle(verdict(2), 8)
    listener.poll()
    assert [(f.tick.k, f.heard_ns, [*f.verdicts]) for f in listener.since(0)] == [
        (1, 3, ["drive"]),
        (2, 8, ["drive"]),
    ]
    assert [f.tick.k for f in listener.since(100 * MS)] == [2]


def test_each_part_that_is_missing_disturbs_a_frame() -> None:
    cases = {
        "Lidar is down": frame(1, verdict(1), down=("Lidar",)),
        "drive/cruise is lost": frame(1, verdict(1), lost=("drive/cruise",)),
        "cruise is late": frame(1, verdict(1, fate="late")),
        "no verdict on drive": frame(1),
        "the behavior does not run": frame(1, verdict(1), run=LIMITS_RUN),
    }
    assert [*disturbances(good(1), DRIVE, NOBODY)] == []
    for text, made in cases.items():
        assert [*disturbances(made, DRIVE, NOBODY)] == [text]
    assert [*disturbances(cases["Lidar is down"], DRIVE, frozenset({"Lidar"}))] == []


def test_a_robot_has_recovered_at_the_first_of_three_good_frames() -> None:
    frames = [good(1), good(2), frame(3), good(4), good(5)]
    assert recovered_ns(frames, DRIVE, NOBODY) is None
    assert recovered_ns([*frames, good(6)], DRIVE, NOBODY) == 210 * MS


def test_frames_of_a_stopped_robot_are_good_but_not_driven() -> None:
    frames = [frame(k, verdict(k, hold="stopped")) for k in range(3)]
    assert recovered_ns(frames, DRIVE, NOBODY) == 10 * MS
    assert recovered_ns(frames, DRIVE, NOBODY, driven=True) is None


def test_a_stop_holds_from_the_frame_in_which_it_holds_every_actuator() -> None:
    both = frozenset({"drive", "lift"})
    half = frame(2, verdict(2, hold="stopped"), verdict(2, actuator="lift"))
    whole = frame(3, *(verdict(3, hold="stopped", actuator=name) for name in both))
    assert stopped_ns([good(1), half], both, 100 * MS) is None
    assert stopped_ns([good(1), half, whole], both, 100 * MS) == 160 * MS


def test_a_command_in_spite_of_a_stop_is_a_slip_and_a_missing_verdict_is_none() -> None:
    held = [frame(k, verdict(k, hold="stopped")) for k in (1, 2)]
    assert slip([good(0), *held, frame(3)], 60 * MS) is None
    assert slip([good(0), *held, good(3)], 60 * MS) == (150 * MS, "drive by cruise")


def test_a_base_brakes_from_the_last_moment_at_which_it_did_not_slow_down() -> None:
    samples = [
        (t * MS, (float(v), 0.0)) for t, v in ((0, 300), (20, 300), (40, 300), (60, 200), (80, 0), (100, 0))
    ]
    assert brakes_ns(samples, 10 * MS, 100 * MS) == 30 * MS
    assert brakes_ns([*samples, (120 * MS, (50.0, 0.0))], 10 * MS, 110 * MS) == 30 * MS
    assert brakes_ns([(0, (0.0, 5.0)), (20 * MS, (0.0, 5.0))], 0, 50 * MS) == 20 * MS
