"""What a page shows of a frame is what the interpreter and the verdicts say of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import pytest

from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.runtime.frames.run_frame import HeardCommand
from colony.runtime.protocol.messages import Stopped, Tick
from colony.verify.reference.interpreter import Interpreter
from colony.watch.snapshot import FrameMark, mark_of
from colony.watch.sources import RunFollower
from colony.watch.store import SnapshotStore
from colony.watch.trail import RunTrail
from tests.analysis.recorded_runs import logs
from tests.watch.runs import PROGRAM, frame, replace_verdict, run, scene, snapshots

MODULES = ("back_off", "avoid", "tired", "cruise")


def test_modules_have_their_fates() -> None:
    shown = snapshots()
    assert shown[0].modules == ("inactive", "inactive", "inactive", "won")
    assert shown[3].modules == ("inactive", "won", "inactive", "suppressed")
    assert shown[8].modules == ("inactive", "inactive", "inactive", "late")
    assert shown[15].modules == ("won", "inactive", "inactive", "suppressed")
    assert shown[18].modules == ("won", "inactive", "silent", "suppressed")


class NeverApplicable:
    """A module in Python that never commands."""

    def step(self, frame: Mapping[str, object]) -> None:
        """Answer "not applicable"."""


def test_a_module_in_python_that_is_not_applicable_is_inactive() -> None:
    program = load_text(
        f"""language 1
        robot tiny {{ sensor bump : bool from RServer.bumper
          actuator drive {{ velocity : mm/s range -400 .. 400 }} to RServer.drive idle drive(velocity = 0) }}
        module never from python "{__name__}:NeverApplicable" {{ reads bump commands drive }}
        network {{ drive = never }}"""
    )
    store = SnapshotStore(("never",))
    follower = RunFollower(program, store, RunTrail(program))
    for readings, state in (({"bump": True}, "inactive"), ({}, "silent")):
        (log,) = logs(program, [Frame(0, readings)])
        verdict = replace_verdict(log.verdicts["drive"], fates=(("never", "silent"),))
        assert follower.take(replace(log, verdicts={"drive": verdict})).modules == (state,)
    store.close()


def test_live_wires_lead_from_the_winner_to_the_actuator() -> None:
    for k, shown in enumerate(snapshots()):
        interpreter = Interpreter(PROGRAM)
        for i in range(k + 1):
            interpreter.step(frame(i))
        ends = {to: start for start, to in shown.live}
        at, names = "drive", scene().nodes
        while at in ends:
            at = ends[at]
        by = shown.commands[0].by
        if by is None:
            assert shown.live == ()
        else:
            assert names[at] == "module"
            assert interpreter.is_active(by)


def test_time_constants_run_down() -> None:
    left = [sum(s.windows.values()) for s in snapshots()[3:12]]
    assert left == [
        0,
        0,
        pytest.approx(0.4),
        pytest.approx(0.3),
        pytest.approx(0.2),
        pytest.approx(0.1),
        0,
        0,
        0,
    ]


def test_nobody_commands_while_a_time_constant_runs() -> None:
    assert [s.commands[0].by for s in snapshots()[4:10]] == ["avoid", None, None, None, None, "cruise"]


def test_commands_have_their_limits() -> None:
    shown = snapshots()
    assert shown[0].commands[0].sent == (400.0, 0.0)
    assert (shown[0].commands[0].low, shown[0].commands[0].high) == ((-400.0, -90.0), (400.0, 90.0))
    assert (shown[12].commands[0].sent, shown[12].commands[0].high) == ((300.0, 0.0), (300.0, 90.0))


def test_a_command_of_another_controller_is_beside_ours() -> None:
    frames = run()
    broken = PROGRAM.contracts[1].name
    command = HeardCommand((123.0, 4.0), 0)
    frames[2] = replace(frames[2], heard={"drive": command}, heard_breaches=(broken,))
    frames[3] = replace(frames[3], heard={"drive": None})
    assert [snapshot.heard_broken for snapshot in snapshots(frames)[2:4]] == [(1,), ()]
    shown = [snapshot.commands[0] for snapshot in snapshots(frames)[2:4]]
    assert [command.heard for command in shown] == [(123.0, 4.0), None]
    assert [command.sent for command in shown] == [s.commands[0].sent for s in snapshots()[2:4]]


def test_contracts_are_lamps() -> None:
    shown = snapshots()
    assert shown[3].contracts == ("held", "held")
    assert shown[15].contracts == ("held", "broken")


def test_sensors_states_and_pose() -> None:
    shown = snapshots()
    assert shown[3].sensors == ((4.0, 0.5, 4.0, 1.0), False, 300.0, 0.0, 270.0, 0.9)
    assert shown[18].sensors[-1] is None
    assert shown[3].pose == (300.0, 0.0, 270.0)
    assert [s.states for s in shown[14:18]] == [(0.0,), (1.0,), (1.0,), (1.0,)]


def test_a_faulty_reading_counts_as_missing_and_is_shown() -> None:
    frames = run()
    readings = {**frames[2].frame.readings, "charge": True}
    frames[2] = replace(frames[2], frame=frames[2].frame._replace(readings=readings))
    shown = snapshots(frames)[2]
    assert shown.stale == (5,)
    assert shown.sensors[5] is True


def test_without_memory_only_verdicts_are_shown_until_a_keyframe() -> None:
    frames = run()
    first_key = next(i for i, log in enumerate(frames) if i > 0 and log.keyframe is not None)
    shown = snapshots([replace(frames[1], memory_unknown=True), *frames[2:]])
    assert not shown[0].is_known
    assert shown[0].active == ()
    assert shown[0].modules == ("inactive", "inactive", "inactive", "won")
    assert shown[first_key - 1].is_known
    assert [s.windows for s in shown[first_key - 1 :]] == [s.windows for s in snapshots()[first_key:]]


def test_an_emergency_stop_is_shown() -> None:
    frames = run()
    tick = Tick(k=5, t_ns=frames[5].tick.t_ns, stopped=Stopped(by="ada/1", t_ns=0))
    shown = snapshots([*frames[:5], replace(frames[5], tick=tick)])
    assert [s.stopped_by for s in shown[4:]] == [None, "ada/1"]
    assert mark_of(shown[4], shown[5]) & FrameMark.OUTSIDE


def test_marks() -> None:
    shown = snapshots()
    marks = [mark_of(None, shown[0]), *(mark_of(a, b) for a, b in pairwise(shown))]
    found = {k: mark for k, mark in enumerate(marks) if mark}
    assert found == {
        3: FrameMark.WINNER,
        5: FrameMark.WINNER,
        8: FrameMark.LATE,
        9: FrameMark.WINNER,
        15: FrameMark.WINNER | FrameMark.BREACH,
    }
