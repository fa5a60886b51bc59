"""What a shadow reports of the controller that drives: counts, tolerances, medians, and contracts."""

from __future__ import annotations

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.runtime.assembly.controller import unjudged
from colony.runtime.frames.run_frame import HeardCommand, RunFrame
from colony.runtime.observe import comparison
from colony.runtime.observe.comparison import ControllerComparison, ControllerReport, render_comparison
from colony.runtime.protocol.messages import Tick, Verdict

TEXT = """language 1
enum place { open = 0, closed = 1 }
robot r {
  actuator drive { velocity : mm/s range -500 .. 500, turn : deg/s }
           to RServer.drive  idle drive(velocity = 0, turn = 0)
  actuator hitch { position : place, lamp : bool } to Hitch.move idle hold
}
module go   { when true  do drive(velocity = 1 mm/s, turn = 0) }
module stay { when false do drive(velocity = 0, turn = 0) }
network { drive = stay suppresses go }
contract slow:  drive.velocity <= 300 mm/s
contract owner: drive by go implies drive.velocity <= 300 mm/s
contract wire:  stay is active implies drive.velocity <= 0 mm/s
contract lit:   hitch.lamp implies hitch.position == place.closed
"""
TOPICS = {"drive": "/cmd_vel"}


class Compared:
    """A comparison, and the number of frames so far. Mutable."""

    def __init__(self, tolerance: float = 1.0, topics: dict[str, str] = TOPICS) -> None:
        program = load_text(TEXT, "r.colony")
        self.sink = ControllerComparison(
            compile_program(program).compiled, topics, unjudged(program, topics), tolerance
        )
        self._k = 0

    def frame(self, ours: object, theirs: object, by: str | None = "go", **members: object) -> None:
        t_ns, k = self._k * 50_000_000, self._k
        self._k += 1
        actuator = "drive" if "actuator" not in members else str(members.pop("actuator"))
        verdict = Verdict(k=k, t_ns=t_ns, actuator=actuator, by=by, values=ours, fates=())  # type: ignore[arg-type]
        heard = None if theirs is None else HeardCommand(theirs, 0)  # type: ignore[arg-type]
        self.sink.take(
            RunFrame(
                tick=Tick(k=k, t_ns=t_ns),
                frame=Frame(t_ns, {}),
                verdicts={actuator: verdict},
                heard={actuator: heard},
                **members,  # type: ignore[arg-type]
            )
        )

    def report(self) -> ControllerReport:
        return self.sink.report()


def test_commands_are_the_same_within_a_share_of_the_range() -> None:
    for tolerance, same in ((0.0, 1), (1.0, 2), (2.0, 3)):
        compared = Compared(tolerance)
        for velocity in (100.0, 110.0, 120.0, 121.0):
            compared.frame((100.0, 0.0), (velocity, 0.0))
        assert compared.report().actuators[0].same == same


def test_without_a_range_it_is_a_share_of_the_value() -> None:
    compared = Compared()
    for turn in (100.0, 101.0, 102.0, -100.0):
        compared.frame((0.0, 100.0), (0.0, turn))
    assert compared.report().actuators[0].same == 2
    assert compared.report().actuators[0].tolerance == {"velocity": 10.0}


def test_each_module_has_its_frames_with_the_median_and_the_worst() -> None:
    compared = Compared()
    for velocity in (0.0, 30.0, 10.0):
        compared.frame((0.0, 0.0), (velocity, 0.0))
    compared.frame((5.0, 0.0), (5.0, 0.0), by=None)
    compared.frame((5.0, 0.0), None)
    (actuator,) = compared.report().actuators
    assert (actuator.frames, actuator.silent, actuator.same) == (4, 1, 3)
    modules = {m.module: m for m in actuator.modules}
    assert (modules["stay"].frames, modules["go"].frames, modules[None].frames) == (0, 3, 1)
    velocity, turn = modules["go"].fields
    assert (velocity.median, velocity.worst, velocity.worst_s) == (10.0, 30.0, 0.05)
    assert (turn.median, turn.worst) == (0.0, 0.0)


def test_bools_and_members_are_the_same_or_not() -> None:
    compared = Compared(100.0, {"hitch": "/hitch"})
    compared.frame((1.0, True), (1.0, True), actuator="hitch")
    compared.frame((1.0, True), (0.0, True), actuator="hitch")
    compared.frame((1.0, True), (1.0, False), actuator="hitch")
    compared.frame(None, (1.0, False), actuator="hitch")  # the program would have sent nothing
    (actuator,) = compared.report().actuators
    assert (actuator.frames, actuator.same) == (4, 1)


def test_the_memory_of_a_median_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison, "MAX_KEPT", 8)
    compared = Compared()
    for i in range(1001):
        compared.frame((0.0, 0.0), (float(i), 0.0))
    velocity, _ = compared.report().actuators[0].modules[1].fields
    assert velocity.median == pytest.approx(500.0, abs=130.0)
    assert velocity.worst == 1000.0


def test_broken_contracts_are_counted_and_others_are_named() -> None:
    compared = Compared()
    for broken in ((), ("slow",), (), ("slow",)):
        compared.frame((0.0, 0.0), (400.0, 0.0), heard_breaches=broken)
    report = compared.report()
    assert [(b.contract, b.frames, b.first_k, b.first_s, b.last_s) for b in report.breaches] == [
        ("slow", 2, 1, 0.05, 0.15)
    ]
    assert report.held == ()
    assert report.unjudged == {
        "owner": "it is about `go` of the program",
        "wire": "it is about `stay` of the program",
        "lit": "`hitch` has no topic that is heard",
    }
    assert render_comparison(report).splitlines() == [
        "  the controller commanded drive over /cmd_vel in 4 of 4 frames",
        "  the program would have sent the same in 0 of them (0.0 %), within velocity 10 mm/s",
        "    would command  frames  same  field     off by    at most",
        "    go                  4     0  velocity  400 mm/s  400 mm/s at 0 s",
        "                                 turn      0 deg/s   0 deg/s at 0 s",
        "  contract slow: BROKEN by the controller in 2 frames, first at 0.05 s (frame 1), last at 0.15 s",
        "  contract owner: not judged, as it is about `go` of the program",
        "  contract wire: not judged, as it is about `stay` of the program",
        "  contract lit: not judged, as `hitch` has no topic that is heard",
    ]
