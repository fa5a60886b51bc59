"""A program in the shadow of a robot decides as a run would, says so in its recording, and sends nothing."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.robots.recording import LiveRun
from colony.runtime.assembly.shadow import MIN_SILENCE_NS, Shadow
from colony.runtime.observe.observer import FrameLog
from colony.runtime.observe.summary import Tally, render
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import bind
from colony.runtime.protocol.deployment import deployment
from colony.runtime.protocol.messages import Message, Sample, ServerFrame, Tick
from colony.verify.audit.audit import audit
from tests.robot_servers import ROME_SERVERS
from tests.runtime.scripted import FAR, Log, Script, session

MS = 1_000_000
S = 1000 * MS

ROBOT = """language 2
robot rome {
  sensor sonar[24] : mm  bearing -180 deg  range 0 .. 10000  from PServer.sonar  within 300 ms
  sensor bumper    : bool                  from RServer.bumper within 300 ms
  sensor wish      : mm/s  default 0       from DServer.Wish
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive  idle drive(velocity = 0, turn = 0)
}
"""

RAMP = f"""{ROBOT}
let before = value_or(last.drive.velocity, 0 mm/s)
module cruise {{ when true  do drive(velocity = before + 7 mm/s, turn = 0) }}
module avoid  {{ when recently(min(sonar) < 900 mm, 400 ms)  do drive(velocity = 60 mm/s, turn = 30 deg/s) }}
module blind  {{ when not fresh(bumper)  do drive(velocity = 0, turn = 5 deg/s) }}
network {{ drive = blind suppresses avoid suppresses cruise }}
limit drive.velocity <= 300 mm/s
contract slow: drive.velocity <= 300 mm/s
"""

OTHER = f"""{ROBOT}
module spin {{ when true  do drive(velocity = 0, turn = 45 deg/s) }}
network {{ drive = spin }}
"""


def program(text: str) -> Program:
    return load_text(text, "test.colony")


def shadow(text: str, *sinks: object) -> Shadow:
    compiled = compile_program(program(text)).compiled
    bindings = bind(compiled.robot, ROME_SERVERS)
    deployed = deployment(compiled, bindings, run="shadow", seed=0)
    return Shadow(compiled, bindings, deployed, sinks)  # type: ignore[arg-type]


def surroundings() -> Script:
    """A wall comes near now and then, and some sonar frames fail."""
    return Script(
        sonar_at=lambda t: (
            None if t % (350 * MS) == 0 else Sample((400.0 + t % (2 * S) / 1e6, *FAR[1:]), t - t % (100 * MS))
        )
    )


def decided(log: FrameLog) -> tuple[object, ...]:
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


# --- on a stage --------------------------------------------------------------------------------------

READINGS: Mapping[str, Mapping[str, object]] = {
    "PServer": {"sonar": FAR},
    "RServer": {"bumper": False},
    "DServer": {"Wish": 0.0},
}


class Stage:
    """Ticks of 50 ms from frame 1000 on, and the servers that answer them."""

    def __init__(self, text: str = RAMP) -> None:
        self.log = Log()
        self.shadow = shadow(text, self.log)
        self.effects: list[object] = list(self.shadow.start(0))

    def take(self, message: Message) -> None:
        self.effects += self.shadow.handle(message, 0)

    def tick(self, k: int, **members: object) -> None:
        settings = {"start": 17, "run": "another", **members}
        self.take(Tick(k=1000 + k, t_ns=(1000 + k) * 50 * MS, **settings))  # type: ignore[arg-type]

    def answer(self, k: int, *servers: str) -> None:
        t_ns = (1000 + k) * 50 * MS
        for server in servers or READINGS:
            fields = {name: Sample(value, t_ns) for name, value in READINGS[server].items()}  # type: ignore[arg-type]
            self.take(ServerFrame(server=server, k=1000 + k, fields=fields))

    def frames(self, ks: range, *servers: str, **members: object) -> None:
        for k in ks:
            self.tick(k, **members)
            self.answer(k, *servers)

    def ks(self) -> list[int]:
        return [log.tick.k - 1000 for log in self.log.frames]

    def restarts(self) -> list[int]:
        return [log.tick.k - 1000 for log in self.log.frames if log.restart]

    def close(self) -> None:
        self.shadow.close()
        assert self.effects == []
        assert audit(program(RAMP), self.log.frames).agrees
        assert not any(log.disagreements for log in self.log.frames)


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
    assert stage.ks()[:3] == [0, 1, 2]
    assert stage.ks()[-1] == 59
    assert len(stage.restarts()) == 1
    stage.close()


# --- what it leaves ----------------------------------------------------------------------------------


def _lines(log: Log, file: io.BytesIO) -> None:
    from colony.runtime.recordings.lines import Recording

    _write(Recording(compile_program(program(RAMP)).compiled, file, shadow=True), log)


def _mcap(log: Log, file: io.BytesIO) -> None:
    from dataclasses import replace

    from colony.runtime.recordings.mcap_writer import McapRecording
    from tests.verify.audit.recorded_runs import run_info

    info = replace(run_info(program(RAMP)), shadow=True)
    _write(McapRecording(compile_program(program(RAMP)).compiled, info, file), log)


def _write(sink: object, log: Log) -> None:
    for frame in log.frames:
        sink.take(frame)  # type: ignore[attr-defined]
    sink.close()  # type: ignore[attr-defined]


class Kept(io.BytesIO):
    """A file whose content outlives it."""

    def close(self) -> None:
        self.seek(0)


@pytest.mark.parametrize("write", [_lines, _mcap])
def test_its_recording_says_that_nothing_was_sent(write: Callable[[Log, io.BytesIO], None]) -> None:
    from colony.cli.audit_text import render as audit_text
    from colony.runtime.recordings.opening import read_recording
    from colony.verify.audit.audit import audit_recording

    stage, file = Stage(), Kept()
    stage.frames(range(4))
    stage.frames(range(6, 20))
    write(stage.log, file)
    file.seek(0)
    reader = read_recording(file, "run")
    report = audit_recording(program(RAMP), reader)
    assert report.agrees
    assert (report.frames, report.compared, report.restarts) == (18, 18, 1)
    assert reader.shadow
    text = audit_text("run", reader, program(RAMP), report, file=None)
    assert "SHADOW: this is what it would have sent; it commanded nothing" in text


def test_other_tools_find_its_verdicts_under_another_topic() -> None:
    stage, file = Stage(), Kept()
    stage.frames(range(3))
    _mcap(stage.log, file)
    from mcap.reader import NonSeekingReader

    file.seek(0)
    topics_ = {channel.topic for _, channel, _ in NonSeekingReader(file).iter_messages()}
    assert topics_ == {"/frames", "/keyframes", "/shadow/verdicts/drive", "/shadow/requests/drive"}


def test_its_summary_says_that_nothing_was_sent() -> None:
    from dataclasses import replace

    stage = Stage()
    stage.frames(range(3))
    tally = Tally(compile_program(program(RAMP)).compiled)
    for log in stage.log.frames:
        tally.take(log)
    summary = replace(tally.summary(seed=0, duration_s=0.15, interrupted=False, travel=None), shadow=True)
    text = render(summary)
    assert "SHADOW: this is what it would have sent; it commanded nothing" in text
    assert "drive would have been commanded by" in text
    assert summary.as_json()["shadow"] is True


def test_a_live_run_has_a_name_and_a_time() -> None:
    live = LiveRun("20260101-120000-7", shadow=True)
    assert (live.name, live.shadow) == ("20260101-120000-7", True)
    assert live.started[:2] == "20"


def test_it_listens_to_measurements_alone() -> None:
    heard = set(Stage().shadow.listens)
    assert heard == {topics.TICKS, *map(topics.frames, ("Clock", *READINGS))}
