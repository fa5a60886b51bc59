"""An audit agrees with every right run, and finds whatever was changed in one."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.analysis.audit import Auditor, audit
from colony.analysis.moments import MomentFollower
from colony.dsl.load import load_file, load_text
from colony.ir.frame import Answer, Frame
from colony.runtime.frames.run_frame import RunFrame
from colony.text.diagnostics import DiagnosticError
from colony.verify.testing.frames import Choices, draw_trace
from tests.analysis.recorded_runs import MS, WAYS, as_mcap, brought, logs, read_mcap
from tests.drawn.strategies import Run, network_runs, run_of_seed, runs
from tests.paths import BEHAVIORS
from tests.sampling import sampled

TEXT = """
robot r {
  sensor near : mm range 0 .. 5000 from PServer.near
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0) ON_LOSS
  actuator lamp { on : bool } to DServer.Lamp idle hold
}
module cruise { when near >= 0 mm do drive(velocity = near / 3 s, turn = 0) }
module back   { when recently(bumper, 100 ms) do drive(velocity = -100 mm/s, turn = 20 deg/s) }
module stop   { when near < 50 mm do drive(velocity = 0, turn = 0) }
module shine  { when bumper do lamp(on = true) }
network { drive = stop suppresses back suppresses cruise  lamp = shine }
contract gentle: drive.velocity <= 33.5 mm/s
"""
PROGRAM = load_text(TEXT.replace("ON_LOSS", ""))
DEGRADING = load_text(TEXT.replace("ON_LOSS", "on_loss degrade"))
IDLE = (0.0, 0.0)


def trace(frames: int = 12) -> tuple[Frame, ...]:
    """Driving on, a bump from frame 3 to 8 that `back` holds on to until 9, then on again."""
    return tuple(Frame(k * 50 * MS, {"near": 100.0 + k, "bumper": 3 <= k <= 8}) for k in range(frames))


def changed(frames: list[RunFrame], at: int, actuator: str = "drive", **changes: Any) -> list[RunFrame]:
    """The same with another verdict in frame `at`."""
    verdicts = dict(frames[at].verdicts)
    verdicts[actuator] = msgspec.structs.replace(verdicts[actuator], **changes)
    return [*frames[:at], replace(frames[at], verdicts=verdicts), *frames[at + 1 :]]


@given(runs())
def test_agrees_on_any_program_through_both_formats(run: Run) -> None:
    program, frames = run
    right = logs(program, frames)
    for way in WAYS:
        report = audit(program, brought(way, program, right))
        assert report.first is None
        assert report.frames == len(frames)
        assert report.compared == len(frames) * len(program.robot.actuators)


@given(network_runs(), st.data())
def test_any_other_winner_is_found_in_its_frame(run: Run, data: st.DataObject) -> None:
    program, frames = run
    right = logs(program, frames)
    at = data.draw(st.integers(0, len(frames) - 1))
    actuator = data.draw(st.sampled_from(program.robot.actuators)).name
    others = [m.name for m in program.modules if m.actuator == actuator]
    by = right[at].verdicts[actuator].by
    other = data.draw(st.sampled_from([x for x in (None, *others) if x != by] or [by]))
    report = audit(program, changed(right, at, actuator, by=other))
    assert report.agrees is (other == by)
    if report.first is not None:
        assert (report.first.index, report.first.actuator, report.differing) == (at, actuator, 1)


@pytest.mark.parametrize("file", sampled(BEHAVIORS, every=3), ids=lambda path: path.stem)
def test_agrees_on_the_behaviors(file: Path) -> None:
    program = load_file(file)
    for seed in range(5):
        frames = logs(program, draw_trace(Choices(Random(seed)), program, 30))
        assert audit(program, frames).agrees, seed


def test_counts_what_there_is() -> None:
    report = audit(PROGRAM, logs(PROGRAM, trace()))
    assert (report.frames, report.compared, report.unheard) == (12, 24, 0)
    assert (report.first_ns, report.last_ns) == (0, 550 * MS)
    assert [(c.contract, c.frames, c.first_ns, c.last_ns) for c in report.contracts] == [
        ("gentle", 4, 50 * MS, 550 * MS)
    ]
    json.dumps(report.as_json())


@pytest.mark.parametrize("way", WAYS)
def test_a_value_that_differs_in_the_last_bit(way: str) -> None:
    right = logs(PROGRAM, trace())
    values = right[2].verdicts["drive"].values
    found = changed(right, 2, values=(math.nextafter(values[0], math.inf), values[1]))
    report = audit(PROGRAM, brought(way, PROGRAM, found))
    assert (report.first.k, report.first.actuator, report.differing) == (2, "drive", 1)
    assert report.first.message == "the command sent is not the interpreter's"
    assert report.first.expected.values == values
    assert json.loads(json.dumps(report.as_json()))["first"]["expected"]["values"] == list(values)


def test_the_sign_of_zero_counts() -> None:
    right = logs(PROGRAM, trace())
    report = audit(PROGRAM, changed(right, 6, values=(-100.0, 20.0)))
    assert report.agrees
    assert not audit(PROGRAM, changed(right, 0, values=(right[0].verdicts["drive"].values[0], -0.0))).agrees  # type: ignore[index]


def test_the_difference_tells_what_each_client_does() -> None:
    report = audit(
        PROGRAM,
        changed(logs(PROGRAM, trace()), 6, by="cruise", fates=(("back", "silent"), ("cruise", "won"))),
    )
    parts = [(c.client, c.fate, c.part) for c in report.first.clients]
    assert parts == [("back", "silent", "wins"), ("cruise", "won", "active"), ("stop", None, "inactive")]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("at", [0, 4, 11])
def test_a_dropped_frame(way: str, at: int) -> None:
    right = logs(PROGRAM, trace())
    report = audit(PROGRAM, brought(way, PROGRAM, [*right[:at], *right[at + 1 :]]))
    message = "frame 5 follows frame 3: 1 between them are not in the recording"
    assert (report.first and report.first.message) == (message if at == 4 else None)  # no last one is missed
    if at == 0:
        assert (report.forgotten, report.resumed) == (7, 1), "memory is known from the second keyframe on"


def test_frames_out_of_order() -> None:
    right = logs(PROGRAM, trace())
    first = audit(PROGRAM, [right[0], right[2], right[1]]).first
    assert first is not None
    assert audit(PROGRAM, [right[0], right[0]]).first is not None


def test_another_program() -> None:
    other = load_text(TEXT.replace("ON_LOSS", "").replace("100 ms", "150 ms"))
    first = audit(other, logs(PROGRAM, trace())).first
    assert (first.k, first.recorded.by, first.expected.by) == (10, "cruise", "back")  # type: ignore[union-attr]


def test_a_client_that_the_program_does_not_have() -> None:
    other = load_text(TEXT.replace("ON_LOSS", "").replace("stop ", "halt "))
    first = audit(other, logs(PROGRAM, trace())).first
    assert first.message == "`stop` is not a client of `drive` in this program"


LATE = (("stop", "silent"), ("back", "late"), ("cruise", "suppressed"))


@pytest.mark.parametrize(
    ("changes", "right"),
    [
        ({"fates": LATE}, True),
        ({"fates": LATE, "by": None, "values": IDLE}, True),
        ({"fates": LATE, "by": None, "values": (0.0, -0.0)}, False),
        ({"fates": LATE, "by": None, "values": None}, False),
        ({"fates": LATE, "by": "cruise", "values": (35.0, 0.0)}, False),
        ({"by": None, "values": IDLE}, False),
        ({"violation": True}, False),
        ({"by": None, "values": (1.0, 2.0), "outside": "ann/1"}, True),
        ({"by": None, "values": IDLE, "hold": "stopped"}, True),
        ({"fates": (("cruise", "inhibited"), ("back", "won"))}, True),
        ({"fates": (("back", "suppressed"),)}, False),
        ({"fates": (("back", "silent"),)}, False),
        ({"fates": (("cruise", "silent"),)}, False),
        ({"fates": (("stop", "suppressed"),)}, False),
        ({"fates": (("cruise", "overruled"),)}, False),
    ],
)
def test_what_may_become_of_a_frame(changes: dict[str, Any], right: bool) -> None:
    assert audit(PROGRAM, changed(logs(PROGRAM, trace()), 6, **changes)).agrees is right


def test_what_is_counted() -> None:
    frames = changed(logs(PROGRAM, trace()), 6, fates=LATE, by=None, values=IDLE)
    frames = changed(frames, 7, fates=(("back", "lost"), ("stop", "refused")))
    frames = changed(frames, 8, outside="ann/1", by=None)
    frames = changed(frames, 9, hold="locked", by=None)
    frames[10] = replace(frames[10], verdicts={})
    report = audit(PROGRAM, frames)
    assert report.agrees
    assert (report.late, report.lost, report.refused, report.idled) == (1, 1, 1, 1)
    assert (report.outside, report.holds, report.unheard, report.compared) == (1, 1, 2, 20)
    assert sum(report.unheard_by_server.values()) == 2


def test_a_restart_begins_anew() -> None:
    right = logs(PROGRAM, trace(), restarts=[9])
    assert right[9].verdicts["drive"].by == "cruise"  # the bump is forgotten
    forgotten = [
        replace(log, restart=False, tick=msgspec.structs.replace(log.tick, start=0)) for log in right
    ]
    first = audit(PROGRAM, forgotten).first
    assert (first.k, first.message) == (9, "the command sent is not the interpreter's")
    first = audit(PROGRAM, [*right[:9], *right[10:]]).first
    assert (first.k, first.message) == (
        10,
        "frame 10 follows frame 8: 1 between them are not in the recording",
    )
    for way in WAYS:
        report = audit(PROGRAM, brought(way, PROGRAM, right))
        assert (report.agrees, report.restarts) == (True, 1)


def test_nothing_is_compared_while_memory_is_not_known() -> None:
    right = logs(PROGRAM, trace(), restarts=[9])
    found: Any = [
        replace(log, memory_unknown=5 <= log.tick.k < 9, skipped=2 if log.tick.k == 5 else 0)
        for log in changed(right, 7, by="cruise")
        if log.tick.k not in (3, 4)
    ]
    for way in WAYS:
        report = audit(PROGRAM, brought(way, PROGRAM, found))
        assert (report.agrees, report.unknown, report.compared, report.restarts) == (True, 4, 12, 1)
    assert not audit(PROGRAM, [*found[:3], *found[4:]]).agrees


def lose(frames: list[RunFrame], change: Callable[[RunFrame], RunFrame]) -> list[RunFrame]:
    """`back` is lost in every frame."""
    out = []
    for log in frames:
        lost = replace(log, tick=msgspec.structs.replace(log.tick, lost=("drive/back",)))
        out.append(
            change(changed([lost], 0, fates=(("stop", "silent"), ("back", "lost"), ("cruise", "silent")))[0])
        )
    return out


def test_who_takes_over_where_a_client_is_lost() -> None:
    right = logs(PROGRAM, trace())

    def cruise_on(log: RunFrame) -> RunFrame:
        near = log.frame.readings["near"]
        assert isinstance(near, float)
        fates = (("stop", "silent"), ("back", "lost"), ("cruise", "won"))
        return changed([log], 0, by="cruise", values=(near / 3.0, 0.0), fates=fates)[0]

    taken_over = lose(right, cruise_on)
    assert audit(DEGRADING, taken_over).agrees
    first = audit(PROGRAM, taken_over).first
    assert first.k == 3
    assert first.message.startswith("a client was missing, and neither")


def test_recorded_contracts_are_compared_where_it_is_known_what_was_sent() -> None:
    right = logs(PROGRAM, trace())
    found, _ = read_mcap(PROGRAM, as_mcap(PROGRAM, right).content)
    assert [one.tick.k for one in found] == list(range(12))
    found[2] = replace(found[2], breaches=())
    first = audit(PROGRAM, found).first
    assert first.message == "broken contracts: recorded none; in the interpreter gentle"
    found[2] = replace(found[2], verdicts={})
    assert audit(PROGRAM, found).agrees


def test_an_auditor_tells_at_any_time() -> None:
    auditor = Auditor(PROGRAM)
    assert auditor.report().frames == 0
    for log in logs(PROGRAM, trace()):
        auditor.take(log)
    assert auditor.report() == audit(PROGRAM, logs(PROGRAM, trace()))


def test_a_run_of_a_seed_is_found_out() -> None:
    """Changing any one verdict of many programs is noticed."""
    for seed in range(30):
        program, frames = run_of_seed(seed, network=True)
        right = logs(program, frames)
        for name, verdict in right[-1].verdicts.items():
            report = audit(
                program, changed(right, len(right) - 1, name, fault="x" if not verdict.fault else None)
            )
            assert report.first is not None, seed
            assert report.first.index == len(right) - 1


PULSES = load_text("""
robot r {
  sensor near : mm range 0 .. 5000 from PServer.near
  actuator drive { velocity : mm/s range -600 .. 600 } to RServer.drive idle drive(velocity = 0)
}
module pulse from python "tests.verify.scripted_modules:Pulses" { reads near  commands drive }
module cruise { when near >= 0 mm do drive(velocity = near / 3 s) }
network { drive = pulse suppresses[100 ms] cruise }
contract gentle: drive.velocity <= 300 mm/s
""")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("missed", [1, 3, 8])
def test_after_a_missing_answer_of_a_module_in_python_memory_is_known_from_the_next_keyframe_on(
    way: str, missed: int
) -> None:
    frames = tuple(Frame(k * 50 * MS, {"near": 100.0 + k}) for k in range(40))
    whole, right = logs(PULSES, frames), logs(PULSES, frames, missing=(missed,))
    known = [k for k, log in enumerate(right) if not log.memory_unknown]
    assert known == [k for k in range(40) if not missed <= k <= (6 if missed < 6 else 12)], "until it pulses"
    for one, other in zip(whole, right, strict=True):
        if other.keyframe is not None and other.keyframe.memory is not None:
            assert other.keyframe == one.keyframe

    report = audit(PULSES, brought(way, PULSES, right))
    assert (report.agrees, report.resumed) == (True, 1)
    assert report.forgotten <= 8, "less than half a second"
    assert not audit(PULSES, brought(way, PULSES, changed(right, 39, values=(5.0,)))).agrees
    follower = MomentFollower(PULSES)
    moments = [follower.take(log) is not None for log in right]
    assert moments[missed + 15 :] == [True] * (25 - missed)


@pytest.mark.parametrize("command", [(), (1.0, 2.0), (True,)])
def test_an_answer_with_other_fields_is_not_one_of_this_program(command: tuple[float | bool, ...]) -> None:
    (log,) = logs(PULSES, (Frame(0, {"near": 1.0}),))
    wrong = [replace(log, answers={"pulse": Answer(command)})]
    for way in ("mcap", "lines"):
        with pytest.raises(DiagnosticError, match=r"A004.*does not have the fields of its actuator"):
            brought(way, PULSES, wrong)
