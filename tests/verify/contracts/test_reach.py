"""Some run gets to what a `reach` declares, or it is proved that none does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file, load_text
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.verify.contracts.example_block import example_block
from colony.verify.contracts.prove import in_order, prove_contracts
from colony.verify.contracts.report import counted_as, finding, lines, row
from colony.verify.contracts.results import ProofOptions, Refuted, Result, with_reaches
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.examples import run_examples
from tests.verify.contracts.behaviors import MEAN, ROBOT, program


def result(text: str, options: ProofOptions | None = None) -> tuple[Program, Result]:
    made = program(text)
    return made, prove_contracts(with_reaches(made), options)[-1]


@pytest.mark.parametrize(
    ("condition", "frames"),
    [
        ("drive by cruise", 1),
        ("drive by cruise and previous(drive by back, false)", 2),
        ("not drive by cruise and far > 9 m and not (drive by back)", 2),
        ("bump", 1),
        ("now > 60 min and drive by back and not bump", 3),
        ("count < 2 and drive by back and not bump", 2),
    ],
)
def test_a_run_gets_there(condition: str, frames: int) -> None:
    """The last frame makes the condition true, and no client is late in any."""
    counting = "state count = 0  next count = if bump then count + 1 else count\n"
    made, found = result(f"{counting}reach r: {condition}")
    assert isinstance(found, Refuted)
    assert len(found.trace.snapshots) == frames
    assert not any(s.given or s.lost for s in found.trace.snapshots)
    assert not found.trace.unknown
    head, *table = lines(made, found)
    assert head == f"reached  r  (in {frames} frame{'s' * (frames > 1)})"
    assert table[0].startswith("  time")
    assert finding(found, "f.colony") is None
    assert counted_as(found) == "reached"
    told = row(made, found)
    assert (told["reach"], told["verdict"]) == ("r", "reached")
    assert "contract" not in told
    trace = told["trace"]
    assert isinstance(trace, list)
    assert [frame["broken"] for frame in trace] == [[]] * frames


@pytest.mark.parametrize(
    "condition",
    [
        "drive by cruise and drive by back",
        "drive.velocity > 0.5 m/s",
        "fresh(small) and small > 1",
        "x > 1 and not fresh(x)",
        "drive by cruise and bump",
    ],
)
def test_no_run_gets_there(condition: str) -> None:
    """What is unknown is not reached, and proved contracts help."""
    made, found = result(f"reach r: {condition}")
    assert lines(made, found) == ("NEVER REACHED  r",)
    said = finding(found, "f.colony")
    assert (said.code, said.severity) == ("V015", "error")
    assert said.message == "no run reaches `r`, whatever sensors read while every client is in time"
    assert counted_as(found) == row(made, found)["verdict"] == "never_reached"


def test_over_reals_and_unknown_are_said_of_reaches_as_of_contracts() -> None:
    made, found = result(f"{MEAN}reach r: mean >= 10")
    assert lines(made, found)[0].startswith("over reals  r  (floats may round at ")
    said = finding(found, None)
    assert said.code == "V014"
    assert said.message.startswith("reach `r` is proved never to be reached only over real numbers: floats")
    counting = "state n = 0  next n = if bump then n + 0.5 else n - 0.5\n"
    made, found = result(
        f"{counting}reach r: n == 0.25", ProofOptions(depth=1, max_frames=2, resources=400_000)
    )
    assert counted_as(found) == "unknown"
    said = finding(found, None)
    assert said.code == "V011"
    assert said.message.startswith("reach `r` is neither reached nor proved never to be: ")
    assert said.message.endswith("reaches it")


def test_contracts_that_are_proved_help_and_stand_before() -> None:
    made = program(
        "reach r: n == 0.5\nstate n = 0  next n = n + 1\ncontract whole: n == floor(n)\nreach s: n == 2\n"
    )
    found = prove_contracts(with_reaches(made))
    assert [x.contract.name for x in in_order(made, reversed(found))] == ["whole", "r", "s"]
    assert [counted_as(x) for x in found] == ["proved", "never_reached", "reached"]


def test_runs_know_nothing_of_reaches() -> None:
    text = "contract c: true\nreach r: previous(bump, true)\ncontract d: not recently(bump, 1 s)\n"
    made = program(text)
    assert [c.name for c in made.contracts] == ["c", "d"]
    assert [c.name for c in made.reaches] == ["r"]
    assert Interpreter(made).step(Frame(0, {"bump": True})).breaches == ("d",)
    compiled = compile_program(made).compiled.code
    assert compiled == compile_program(replace(made, reaches=())).compiled.code


@pytest.mark.parametrize(
    ("condition", "expects"),
    [
        ("drive by cruise and far > 9.25 m", "drive by cruise and far > 9.25 m"),
        ("now > 1 s and drive by back and not bump", "now > 1 s and drive by back and not bump"),
        ("previous(bump, false) and not bump", None),
    ],
)
def test_the_written_test_expects_what_was_reached(condition: str, expects: str | None) -> None:
    made, found = result(f"reach r: {condition}")
    assert isinstance(found, Refuted)
    block = example_block(made, found.contract, found.trace)
    if expects is None:
        assert block is None
        return
    assert block.startswith('test "reach: r" {\n')
    assert block.endswith(f" expect {expects}\n}}\n")
    [run] = run_examples(program(f"{block}"))
    assert run.failures == ()
    [run] = run_examples(program(block.replace(" expect ", " expect not ", 1).replace("not not ", "")))
    assert run.failures != ()


def test_a_reach_of_an_imported_file_has_its_prefix_and_no_test(tmp_path: Path) -> None:
    (tmp_path / "inner.colony").write_text(f"language 1\n{ROBOT}reach there: drive by cruise\n")
    (tmp_path / "outer.colony").write_text(
        'language 1\nimport "inner.colony" as inner\nnetwork { drive = inner.drive }\n'
    )
    made = load_file(str(tmp_path / "outer.colony"))
    [found] = prove_contracts(with_reaches(made))
    assert found.contract.name == "inner.there"
    assert isinstance(found, Refuted)
    assert example_block(made, found.contract, found.trace) is None


def test_a_sensor_that_only_a_reach_reads_is_read() -> None:
    from colony.verify.lints import lint

    robot = "robot r { sensor a : bool from P.a  actuator d { v : bool } to P.d idle d(v = false) }\n"
    rest = "module m { when true do d(v = true) }  network { d = m }\n"
    for more, codes in (("", ["V028"]), ("reach x: a\n", [])):
        found = [f.diagnostic.code for f in lint(load_text(robot + rest + more))]
        assert [c for c in found if c == "V028"] == codes
