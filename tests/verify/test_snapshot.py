"""Snapshots of frames and of tests keep None of what an actuator was given last."""

from __future__ import annotations

from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.verify.reference.interpreter import Interpreter
from colony.verify.snapshot import snapshot_of
from colony.verify.testing.frames import frames_of, snapshots_of

PROGRAM = load_text("""
robot r {
  sensor near : m range 0 .. 10 from PServer.near
  actuator drive { velocity : mm/s range 0 .. 400 } to RServer.drive idle drive(velocity = 0)
}
module ramp { when true do drive(velocity = last.drive.velocity + 25 mm/s) }
network { drive = ramp }
test "the server goes down" {
  at 0 s     given near = 1 m
  at 50 ms   given near = missing
  at 100 ms  given last.drive.velocity = missing
}
""")
LAST = "last.drive.velocity"


def test_a_missing_sensor_is_left_out_and_what_was_given_last_is_none() -> None:
    assert snapshot_of(PROGRAM, Frame(0, {"near": None, LAST: None})).readings == {LAST: None}
    assert snapshot_of(PROGRAM, Frame(0, {"near": 2.0})).readings == {"near": 2000.0}


def test_the_snapshots_of_a_test_run_as_its_frames_do() -> None:
    [example] = PROGRAM.tests
    snapshots = snapshots_of(PROGRAM, example)
    assert [s.readings for s in snapshots] == [{"near": 1000.0}, {}, {LAST: None}]
    declared, base = Interpreter(PROGRAM), Interpreter(PROGRAM)
    sent = [declared.step(f).commands["drive"].values for f in frames_of(PROGRAM, example)]
    assert sent == [(25.0,), (50.0,), (25.0,)]
    assert sent == [base.step_in_base_units(s.t_ns, s.readings).commands["drive"].values for s in snapshots]
