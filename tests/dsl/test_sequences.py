"""Sequences across files: their names, params of a site, and their text written out."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from colony.dsl.check.program import without_sequences, write_out
from colony.dsl.load import check_file, load_text
from colony.dsl.site_reading import params_from_values
from colony.ir.program import Machine, Module, PythonModule, State
from colony.verify.testing.agreement import ALL_EXECUTORS, disagreement
from colony.verify.testing.frames import Choices, draw_trace
from tests.dsl.test_imports import Files
from tests.sampling import sampled
from tools.drawn_programs import sequences
from tools.written_out import written_out_disagreement

PARTS = """
import "rome"
let ahead = min(sonar[0..2])
enum course { out = 1, home = -1 }
let half(x : mm/s) = x / 2
module go {
  input way : course
  param speed = 200 mm/s
  let   near = sustained(ahead < 1 m, 100 ms)
  when  count(near for k in 0 .. 1) < 2 or recently(bumper, 200 ms)
  do    drive(velocity = if way == course.out then half(speed) else -speed, turn = 0)
}
module slow = go(speed = 50 mm/s)
module shine { when true do lamp(on = true, level = 1) }
sequence tour when bumper {
  out  = slow(way = course.out)  until ahead < 1 m  within 1 s else lost
  home = go(way = course.home)   until ahead > 2 m  within 1 s else out
}
module lost { when tour == tour.lost do lamp(on = true, level = 0.5) }
"""

MAIN = """
import "parts" as p
sequence chore when docked_at > 0 restart {
  t0 = p.slow(way = p.course.home, speed = 70 mm/s)  until p.ahead < 2 m  within 200 ms else t0
  t1 = p.shine                                    until bumper         within 300 ms else stuck
}
machine watch { start no  no -> yes when p.tour == p.tour.lost and chore == chore.stuck }
network {
  drive = p.tour.drive suppresses chore.drive
  lamp  = p.lost suppresses chore.lamp
}
contract tour:  drive by p.tour.out implies p.tour == p.tour.out
contract chore: chore.t1 is active implies chore == chore.t1
contract params: p.tour.out.speed == 50 mm/s and chore.t0.speed >= 70 mm/s and fresh(chore.t0.way)
contract last:  last.p.tour.out is active or last.lamp by chore.t1 or true
"""


@pytest.fixture
def files(tmp_path: Path) -> Files:
    made = Files(tmp_path)
    made.write(parts=PARTS, main=MAIN)
    return made


def test_a_sequence_is_a_machine_modules_and_wires_with_names_of_their_own(files: Files) -> None:
    program = files.program("main")
    machines = {d.name: d.tasks for d in program.derived if isinstance(d, Machine)}
    assert machines == {"p.tour": ("out", "home"), "chore": ("t0", "t1"), "watch": ()}
    assert {m.name for m in program.modules} >= {"p.tour.out", "p.tour.home", "chore.t0", "chore.t1"}
    assert {w.name for w in program.wires} == {"p.tour.drive", "chore.drive", "chore.lamp", "drive", "lamp"}
    assert [d.name for d in program.derived if isinstance(d, State)] == ["p.tour.frames", "chore.frames"]
    trace = draw_trace(Choices(Random(3)), program, 30)
    assert disagreement(program, trace, ALL_EXECUTORS) is None


def test_a_plain_import_brings_in_a_sequence_and_its_parts(files: Files) -> None:
    files.write(
        plain='import "parts"\nnetwork { drive = tour.drive lamp = lost }\n'
        "contract c: tour == tour.waiting or tour.home.speed > 0 or last.drive by tour.home\n"
        "sequence _own { a = shine until bumper within 1 s else done }\n"
        "let over = _own == _own.done and last._own.a is active"
    )
    assert files.findings("plain") == []
    files.write(above='import "plain"\nlet x = _own == _own.done\nnetwork { lamp = _own.lamp }')
    places = ("2:9", "2:17", "3:18")
    assert files.findings("above") == [f"above.colony:{place} E110" for place in places]


def test_a_name_is_declared_once_as_a_sequence_a_value_or_a_part(files: Files) -> None:
    files.write(
        main='import "parts"\nlet job = 1\nmodule work { when true }\n'
        "sequence job { shine until bumper within 1 s else done }\n"
        "sequence work { shine until bumper within 1 s else done }\n"
        "sequence drive { shine until bumper within 1 s else done }\n"
        "sequence bumper { shine until true }\n"
        "sequence tour { shine until true }"
    )
    places = ("1:1", "4:10", "5:10", "6:10", "7:10")
    assert files.findings("main") == [f"main.colony:{place} E102" for place in places]


def test_a_site_sets_params_of_tasks(files: Files) -> None:
    params = params_from_values({"chore.t0.speed": "90 mm/s", "p.tour.out.speed": "80 mm/s"}, "site.toml")
    checked = check_file(files.folder / "main.colony", params=params)
    assert checked.program is not None
    modules = {m.name: m for m in checked.program.modules}
    speeds = {name: dict(m.params).get("speed") for name, m in modules.items() if isinstance(m, Module)}
    assert (speeds["chore.t0"], speeds["p.tour.out"], speeds["p.tour.home"]) == (90.0, 80.0, 200.0)


@pytest.mark.parametrize("root", ["main", "parts"])
def test_written_out_a_sequence_decides_as_before(files: Files, root: str) -> None:
    """With bases of other files, their values, enums and functions, inputs, params and memory."""
    if root == "parts":
        files.write(parts=PARTS + "network { drive = tour.drive  lamp = lost }\n")
    path = files.folder / f"{root}.colony"
    checked = check_file(path)
    assert checked.program is not None
    text = without_sequences(checked.tree)
    assert "sequence" not in text
    assert write_out(checked.tree) in text
    other = load_text(text, "written", files.folder)
    for seed in range(20):
        trace = draw_trace(Choices(Random(seed)), checked.program, 40)
        assert written_out_disagreement(checked.program, other, trace) is None


def test_time_limits_are_whole_frames_rounded_up() -> None:
    robot = (
        "robot r {{ frame {} sensor b : bool from S.b"
        " actuator a {{ on : bool }} to DServer.A idle hold }} module go {{ when true do a(on = true) }} "
        "network {{ a = job.a }} sequence job {{ go until b within {} else done }}"
    )
    for frame, limit, frames in (("100 ms", "1.1 s", 11), ("30 ms", "100 ms", 4), ("50 ms", "1 ms", 1)):
        program = load_text(robot.format(frame, limit))
        (state,) = (d for d in program.derived if isinstance(d, State))
        assert f"value={float(frames)})" in repr(state.next)


def test_a_module_in_python_that_reads_a_sequence_reads_its_failures(files: Files) -> None:
    files.write(
        main='import "parts"\nsequence job { shine until bumper within 1 s else failed }\n'
        'module watch from python "watch:Watch" { reads job commands lamp }\n'
        "network { lamp = lost suppresses watch suppresses job.lamp  drive = tour.drive }"
    )
    assert any(isinstance(m, PythonModule) for m in files.program("main").modules)


@pytest.mark.parametrize("seed", sampled(range(40), every=8, thorough=True))
def test_drawn_sequences_agree_in_all_executors_and_written_out(seed: int) -> None:
    """A sample of `make agreement`."""
    _, findings = sequences(seed)
    assert not findings
