"""What is said of results: to people, and to other tools."""

from __future__ import annotations

from dataclasses import replace

from colony.dsl.load import load_text
from colony.verify.contracts.prove import in_order, prove_contracts
from colony.verify.contracts.report import finding, lines, row, verdict
from colony.verify.contracts.results import Proved, ProvedInTime
from colony.verify.contracts.table import folded, reading_cell, table
from colony.verify.snapshot import Snapshot
from tests.verify.contracts.behaviors import MEAN, ROBOT, program, proved, refuted, result, unknown


def test_what_holds_of_floats_is_proved_without_more() -> None:
    text = "contract c: drive by back implies back is active"
    found = proved(text)
    assert lines(program(text), found) == ("proved   c  (operators too)",)
    assert lines(program(text), replace(found, operators=False)) == (
        "proved   c  (without operators: --why c)",
    )
    assert finding(found, "f.colony") is None
    assert row(program(text), found)["over_reals"] == []


def test_a_contract_that_a_late_client_breaks_is_a_note_with_the_run() -> None:
    text = "contract c: back is active and not (cruise is active) implies drive by back"
    found = result(text)
    assert isinstance(found, ProvedInTime)
    assert lines(program(text), found)[:5] == (
        "proved in time  c",
        "  it is proved while every client is in time; "
        "the run below breaks it, in which the client of `drive` is late:",
        "  time  bump  drive",
        "  0 s   true  late, idle: velocity = 0 m/s, turn = 0 deg/s",
        "  missing, where some readings would change this: far",
    )
    said = finding(found, "f.colony")
    assert (said.code, said.severity) == ("V012", "note")
    start = (
        "contract `c` is proved only while every client is in time; it is false at 0 s of a run of 1 frame"
    )
    assert said.message.startswith(f"{start} in which the client of `drive` is late; found: ")
    assert said.hint is not None
    assert "`drive is idle or ...`" in said.hint
    rows = row(program(text), found)
    assert (rows["verdict"], rows["operators"]) == ("proved_in_time", False)
    trace = rows["trace"]
    assert trace[0]["late"] == ["drive"]
    assert rows["hint"] == said.hint


def test_a_contract_of_which_lateness_is_open_says_why() -> None:
    text = "contract c: drive by back implies back is active"
    found = ProvedInTime(
        contract=program(text).contracts[-1], in_time=proved(text), because=("z3 gave up",), hint="ask less"
    )
    assert lines(program(text), found) == (
        "proved in time  c",
        "  it is proved while every client is in time; where clients are late or lost, it is neither "
        "proved nor refuted:",
        "  z3 gave up",
    )
    said = finding(found, "f.colony")
    assert (said.code, said.hint) == ("V012", "ask less")
    assert said.message.endswith("clients are late or lost, it is neither proved nor refuted: z3 gave up")
    assert row(program(text), found)["trace"] is None


def test_memory_that_an_earlier_late_frame_changed_is_what_the_hint_is_about() -> None:
    """In the last frame nobody is late, and nobody is lost in any."""
    text = "contract c: previous(back is active, false) implies previous(drive is commanded, false)"
    found = result(text)
    assert isinstance(found, ProvedInTime)
    assert [list(s.given) for s in found.trace.snapshots] == [["drive"], []]
    said = finding(found, "f.colony")
    assert said.hint is not None
    assert "(`drive is idle or previous(drive is idle, true) or ...`)" in said.hint
    assert "lost" not in said.hint
    assert "in which the client of `drive` is late; found" in said.message
    assert row(program(text), found)["hint"] == said.hint


def test_the_advice_on_an_earlier_late_frame_leads_to_a_proof() -> None:
    always = "module going { when true do drive(velocity = 0.5 m/s, turn = 0) }  "
    text = ROBOT.replace("network { drive = ", f"{always}network {{ drive = going suppresses ")
    steady = "not changed(drive.velocity > 0 m/s)"
    advised = f"drive is idle or previous(drive is idle, true) or {steady}"
    made = load_text(f"{text}contract steady: {steady}  contract advised: {advised}")
    assert [type(r) for r in prove_contracts(made)] == [ProvedInTime, Proved]


def test_a_contract_that_a_lost_client_breaks_says_lost_and_not_late() -> None:
    degrading = ROBOT.replace("turn = 0)\n}", "turn = 0) on_loss degrade\n}", 1)
    made = load_text(f"{degrading}contract c: back is active or not fresh(bump) or not bump")
    [found] = prove_contracts(made)
    assert isinstance(found, ProvedInTime)
    assert lines(made, found)[1] == (
        "  it is proved while every client is in time; the run below breaks it, in which a client is lost:"
    )
    said = finding(found, "f.colony")
    assert "in which a client is lost; found" in said.message
    assert said.hint == (
        "with `on_loss degrade`, a lesser client acts in place of one that is lost: say what must hold then, "
        "or use `on_loss stop`; or write `contract c in time: ...` if that is what you mean"
    )


def test_an_actuator_without_an_earlier_command_shows_what_stands_in() -> None:
    text = "contract c: now > 0.1 s implies last.drive.velocity == 0.5 m/s"
    found = refuted(text)
    assert any("none (0 m/s stands in)" in line for line in table(program(text), found.contract, found.trace))


def test_a_frame_that_is_not_given_what_was_sent_has_what_the_program_sent() -> None:
    text = "contract c: last.drive.velocity <= 2 m/s"
    [sent] = [s for s in program(text).robot.sensors if s.sent is not None]
    assert reading_cell(sent, Snapshot(0)) == "as sent"
    assert reading_cell(sent, Snapshot(0, {sent.name: None})) == "none (0 m/s stands in)"
    assert reading_cell(sent, Snapshot(0, {sent.name: 500.0})) == "0.5 m/s"


def test_what_a_module_did_before_is_given_where_it_matters() -> None:
    text = "contract c: last.drive by cruise implies last.back is active"
    found = refuted(text)
    heading = table(program(text), found.contract, found.trace)[0]
    assert "last.drive by cruise" in heading
    assert all(None not in snapshot.readings.values() for snapshot in found.trace.snapshots)


def test_what_holds_of_reals_names_the_lines() -> None:
    text = MEAN + "contract c: mean < 10"
    [line] = lines(program(text), result(text))
    assert line.startswith("over reals  c  (floats may round at <text>:")
    said = finding(result(text), "b.colony")
    assert (said.code, said.severity) == ("V014", "note")
    assert "proved only over real numbers: floats may round at <text>:" in said.message


def test_a_refuted_contract_is_an_error_at_its_place() -> None:
    text = "contract c: drive by cruise implies not (fresh(bump) and bump)  "
    text += "contract d: fresh(bump) implies not falling(bump)"
    found = refuted(text)
    said = finding(found, "a b.colony")
    assert (said.code, said.severity, said.span.text) == ("V010", "error", "d")
    assert "`d` is false at 0.05 s of a run of 2 frames; found: bump is fresh; bump = false" in said.message
    assert said.hint == "`colony verify --write-test 'a b.colony'` adds the run to it as a test"
    assert finding(found, None) == replace(said, hint=None)


def test_a_contract_that_cannot_be_told_says_what_is_missing() -> None:
    said = finding(refuted("contract c: far <= 10 m and x == x"), "f.colony")
    assert said is not None
    found = "`far` is missing; `x` is missing"
    assert (
        said.message == f"contract `c` is neither true nor false at 0 s of a run of 1 frame; found: {found}"
    )
    assert said.hint is not None
    assert "`fresh(X) implies ...`" in said.hint
    assert "`value_or(X, ...)`" in said.hint


def test_an_infinite_reading_wants_a_range() -> None:
    said = finding(refuted("contract c: fresh(x) implies x - x == 0"), "f.colony")
    assert said.hint == "`x` is infinite there: give it a `range`, which bounds its readings"


def test_an_unknown_contract_is_a_warning_that_says_why() -> None:
    found = unknown("contract c: fresh(slope) implies sin(slope) < 2 * cos(slope) or abs(slope) > 10 deg")
    said = finding(found, "f.colony")
    assert (said.code, said.severity) == ("V011", "warning")
    assert "`sin`" in said.message
    assert ":;" not in said.message
    assert "which is not enough: " in said.message
    assert said.hint == found.hint


def test_the_table_has_a_line_a_frame_and_tells_what_must_be_missing() -> None:
    text = "contract c: fresh(bump) and falling(bump) implies fresh(far)"
    found = refuted(text)
    assert table(program(text), found.contract, found.trace) == (
        "time    bump   drive",
        "0 s     true   by back: velocity = -0.5 m/s, turn = 0 deg/s",
        "0.05 s  false  by back: velocity = -0.5 m/s, turn = 0 deg/s",
        "missing, which matters: far",
        "all other sensors: missing (their readings make no difference)",
        "in the last frame: bump is fresh; bump = false; far is not fresh",
        "because: bump has a reading; `bump` is false; `previous(bump)` remembers true; "
        "far is missing: PServer gave no value; it has had none so far",
    )


def test_enumerators_arrays_and_idle_commands_are_shown() -> None:
    text = "contract c: fresh(want) and fresh(rays) "
    text += "implies want != goal.light or rays[2] < 7 m or drive is commanded"
    found = refuted(text)
    shown = "\n".join(table(program(text), found.contract, found.trace))
    assert "goal.light" in shown
    assert "idle: velocity = 0 m/s, turn = 0 deg/s" in shown
    assert "all 10 m" in shown


def test_results_come_in_the_order_written() -> None:
    text = "contract a: bump  contract b: fresh(bump) implies not bump or bump  "
    text += "contract c: value_or(far, 0 m) <= 10 m"
    made = program(text)
    found = list(prove_contracts(made))
    assert [r.contract.name for r in found] == ["a", "b", "c"]
    assert in_order(made, reversed(found)) == found
    assert [verdict(r) for r in found] == ["REFUTED", "proved", "proved"]


def test_a_row_has_the_frames_as_trace_takes_them() -> None:
    text = "contract c: fresh(far) and fresh(bump) implies not (far > 2 m and bump)"
    made = row(program(text), refuted(text))
    assert made["verdict"] == "refuted"
    steps = made["trace"]
    [step] = steps
    assert step["frame"] == {"t": 0.0, "far": 10.0, "bump": True}
    assert step["sent"] == {"drive": {"by": "back", "velocity": -0.5, "turn": 0.0}}
    assert step["broken"] == ["c"]


def test_a_proof_that_is_told_has_its_depth_and_invariants() -> None:
    text = "state n = 0  next n = if bump then (if n == 4 then 0 else n + 1) else n\ncontract c: n <= 4"
    found = proved(text)
    made = row(program(text), replace(found, invariants=("n <= 4",)))
    assert (made["k"], made["invariants"]) == (found.k, ["n <= 4"])


def test_elements_with_bearings_are_named_by_angle() -> None:
    text = ROBOT.replace("rays[6] : m", "rays[6] : m bearing -50 deg step 20 deg")
    rays = next(s for s in load_text(text).robot.sensors if s.name == "rays")
    frame = Snapshot(0, {"rays": (5000.0, 5000.0, 5000.0, 400.0, 5000.0, 5000.0)})
    assert reading_cell(rays, frame) == "all 5 m, [10 deg] 0.4 m"


def test_missing_sensors_of_which_readings_would_end_the_breach_are_named() -> None:
    text = "contract c: drive is commanded"
    found = refuted(text)
    rows = table(program(text), found.contract, found.trace)
    assert rows[2:4] == (
        "missing, where some readings would change this: far, bump",
        "all other sensors: missing (their readings make no difference)",
    )


def test_a_value_that_is_cut_to_its_range_says_so() -> None:
    made = load_text("""
robot r {
  sensor speed : mm/s range 0 .. 900 from RServer.speed
  actuator drive { velocity : mm/s range -600 .. 600 } to RServer.drive idle drive(velocity = 0)
}
module go { when true do drive(velocity = speed + 200 mm/s) }
network { drive = go }
contract c: fresh(speed) implies drive.velocity == value_or(speed, 0) + 200 mm/s
""")
    [found] = prove_contracts(made)
    assert any("velocity = 600 mm/s (cut to its range)" in line for line in lines(made, found))


def test_a_single_hidden_row_is_shown() -> None:
    rows = [[f"{i} s", "same"] for i in range(4)]
    assert folded(rows[:3]) == rows[:3]
    assert folded(rows) == [rows[0], ["...", ""], rows[3]]
