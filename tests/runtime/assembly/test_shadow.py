"""A program in the shadow of a robot decides as a run would, and sends nothing."""

from __future__ import annotations

from collections.abc import Mapping

from colony.analysis.audit import audit
from colony.cli.run.shadow_run import LagReports
from colony.runtime.assembly.shadow import MIN_SILENCE_NS, MISSED_FRAMES
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Sample, Tick
from tests.kit.node_stage import MS, S
from tests.runtime.assembly.shadow_stage import RAMP, READINGS, ROBOT, Stage, program, shadow
from tests.runtime.scripted import FAR, Log, Script, session

OTHER = f"""{ROBOT}
module spin {{ when true  do drive(velocity = 0, turn = 45 deg/s) }}
network {{ drive = spin }}
"""


def surroundings() -> Script:
    """A wall comes near now and then, and some sonar frames fail."""
    return Script(
        sonar_at=lambda t: (
            None if t % (350 * MS) == 0 else Sample((400.0 + t % (2 * S) / 1e6, *FAR[1:]), t - t % (100 * MS))
        )
    )


def decided(log: RunFrame) -> tuple[object, ...]:
    requests = sorted(log.requests, key=lambda request: request.client)
    return log.tick.k, log.frame, log.verdicts, log.expected, requests, log.disagreements, log.answers


# --- beside a run ------------------------------------------------------------------------------------


def test_it_decides_what_a_run_decides() -> None:
    run, beside = Log(), Log()
    session(program(RAMP), surroundings(), run, nodes=(shadow(RAMP, beside),), requests=True).run(5 * S)
    assert len(beside.frames) == 100
    assert set(run.winners()) == {"cruise", "avoid"}
    first, *others = zip(beside.frames, run.frames, strict=True)
    assert first[0].verdicts == first[1].verdicts
    assert first[0].frame.readings["last.drive.velocity"] is None  # the base has been given its idle command
    for mine, its in others:
        assert decided(mine) == decided(its)


def test_the_other_program_never_notices() -> None:
    alone, beside, dark = Log(), Log(), Log()
    session(program(OTHER), (first := surroundings()), alone, requests=True).run(5 * S)
    node = shadow(RAMP, dark)
    session(program(OTHER), (second := surroundings()), beside, nodes=(node,), requests=True).run(5 * S)
    assert beside.frames == alone.frames
    assert second.told == first.told
    assert dark.winners() != beside.winners()
    assert audit(program(RAMP), dark.frames).agrees
    speeds = [values[0] for log in dark.frames if (values := log.verdicts["drive"].values) is not None]
    assert max(speeds) > 100.0  # the ramp goes on with what would have been sent, not with what was


class Alternating:
    """A module in Python with a memory: it drives in every third frame that it sees."""

    def __init__(self) -> None:
        self._frames = 0

    def step(self, frame: Mapping[str, object]) -> dict[str, float] | None:
        self._frames += 1
        return {"velocity": 10.0 * self._frames, "turn": 0.0} if self._frames % 3 == 0 else None


def test_modules_in_python_run_beside_it() -> None:
    module = f'module p from python "{__name__}:Alternating" {{ reads bumper commands drive }}'
    text = f"{ROBOT} {module}\nmodule spin {{ when true  do drive(velocity = 0, turn = 45 deg/s) }}"
    text += "\nnetwork { drive = p suppresses spin }"
    run, beside = Log(), Log()
    session(program(text), surroundings(), run, nodes=(shadow(text, beside),), requests=True).run(2 * S)
    assert set(run.winners()) == {"p", "spin"}
    assert list(map(decided, beside.frames)) == list(map(decided, run.frames))


# --- on a stage ---------------------------------------------------------------------------------------


def test_it_goes_on_through_runs_and_epochs_of_others() -> None:
    stage = Stage()
    stage.frames(range(5))
    stage.frames(range(5, 10), run="next", start=1005)
    stage.frames(range(10, 12), run="", start=1010)
    assert stage.ks() == list(range(12))
    assert stage.restarts() == []
    assert [v.values for v in (log.verdicts["drive"] for log in stage.log.frames)][-1] == (84.0, 0.0)
    stage.close()


def test_after_a_missed_tick_all_memory_restarts() -> None:
    stage = Stage()
    stage.frames(range(4))
    stage.frames(range(6, 9))
    assert stage.ks() == [0, 1, 2, 3, 6, 7, 8]
    assert stage.restarts() == [6]
    assert [log.frame.restarted for log in stage.log.frames].index(True) == 4
    assert stage.log.frames[4].verdicts["drive"].values == (7.0, 0.0)
    stage.close()


def test_ticks_that_are_repeated_or_late_change_nothing() -> None:
    stage = Stage()
    stage.frames(range(3))
    stage.tick(1)
    stage.tick(2)
    stage.frames(range(3, 5))
    assert stage.ks() == list(range(5))
    assert stage.restarts() == []
    stage.close()


def test_frames_may_come_before_their_ticks_and_late() -> None:
    stage = Stage()
    for k in range(3):
        stage.answer(k, "RServer")
        stage.tick(k)
        stage.answer(k, "DServer")
    for k in range(3):
        stage.answer(k, "PServer")
    stage.frames(range(3, 5))
    assert stage.ks() == list(range(5))
    assert stage.restarts() == []
    stage.close()


def test_a_server_that_is_down_is_missing_at_once() -> None:
    stage = Stage()
    stage.frames(range(3))
    stage.tick(3)
    stage.answer(3, "PServer", "DServer")  # RServer dies before it answers
    assert stage.ks() == [0, 1, 2]
    stage.tick(4, down=("RServer",), void=(("RServer", 1003),))
    stage.answer(4, "PServer", "DServer")
    assert stage.ks() == list(range(5))
    assert stage.log.winners()[-2:] == ["blind", "blind"]
    stage.frames(range(5, 7))
    assert stage.log.winners()[-1] == "cruise"
    assert stage.restarts() == []
    stage.close()


def test_a_frame_that_was_decided_is_not_void_any_more() -> None:
    stage = Stage()
    stage.frames(range(3))
    stage.frames(range(3, 5), void=(("RServer", 1002),))
    assert stage.ks() == list(range(5))
    assert stage.restarts() == []
    stage.close()


def test_a_server_that_the_clock_does_not_watch_may_be_silent() -> None:
    stage = Stage()
    waits = MIN_SILENCE_NS // (50 * MS) + 1
    stage.frames(range(waits), "PServer", "DServer")
    assert stage.ks() == []
    stage.frames(range(waits, waits + 20), "PServer", "DServer")
    assert stage.ks() == list(range(waits + 20))
    assert set(stage.log.winners()) == {"blind"}
    assert stage.restarts() == []
    stage.close()


def test_a_frame_that_never_comes_costs_the_memory_and_no_more() -> None:
    stage = Stage()
    stage.frames(range(3))
    stage.tick(3)
    stage.answer(3, "PServer", "DServer")
    stage.frames(range(4, 60))
    again = 3 + MISSED_FRAMES + 1
    assert stage.ks() == [0, 1, 2, *range(again, 60)]
    assert stage.restarts() == [again]
    stage.close()


def test_a_server_that_is_heard_later_than_the_clock_costs_a_few_frames() -> None:
    """So it is after a suspension, when the links to the robot's processes come back one after the other."""
    stage = Stage()
    stage.frames(range(3))
    for k in range(60, 63):
        stage.tick(k)
        stage.answer(k, "PServer", "DServer")
    stage.frames(range(63, 80))
    again = 60 + MISSED_FRAMES + 1
    assert stage.ks() == [0, 1, 2, *range(again, 80)]
    stage.close()


def test_ticks_that_wait_during_a_suspension_make_no_server_silent() -> None:
    stage = Stage()
    stage.frames(range(3))
    waiting = range(3, 3 + 30)
    for k in waiting:  # all come at once, before the first of the answers
        stage.tick(k, now_ns=(1000 + waiting.stop) * 50 * MS)
    for k in waiting:
        stage.answer(k)
    stage.frames(range(waiting.stop, waiting.stop + 5))
    assert stage.ks() == list(range(waiting.stop + 5))
    assert set(stage.log.winners()) == {"cruise"}
    assert stage.restarts() == []
    stage.close()


def test_it_listens_to_measurements_alone() -> None:
    heard = set(Stage().node.listens)
    assert heard == {topics.TICKS, *map(topics.frames, ("Clock", *READINGS))}


# --- too slow ----------------------------------------------------------------------------------------


def test_it_knows_how_far_it_is_behind_and_says_it_once() -> None:
    node, reports = shadow(RAMP), list[str]()
    lag = LagReports(node, reports.append)
    for k, behind_ms in enumerate([0, 40, 900, 1100, 3000, 600, 1200, 400, 0, 2500]):
        tick = Tick(k=k, t_ns=k * 50 * MS, start=0, run="another")
        node.handle(tick, tick.t_ns + behind_ms * MS)
        assert node.behind_ns == behind_ms * MS
        lag.check(0.0)
    assert [text.partition(" behind")[0] for text in reports] == [
        "the shadow is 1.1 s",
        "the shadow is 2.5 s",
    ]


def test_it_says_once_that_a_frame_takes_long_or_never_ends() -> None:
    node, reports = shadow(RAMP), list[str]()
    lag = LagReports(node, reports.append)
    for now_s, deciding in ((0.0, None), (1.0, 3), (1.9, 3), (2.0, 4), (3.1, 4), (9.0, 4), (9.1, None)):
        node.deciding = deciding
        lag.check(now_s)
    assert [text.partition(" behind")[0] for text in reports] == ["the shadow is 1.1 s"]
