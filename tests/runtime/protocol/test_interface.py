"""The interface of a robot: what makes two differ, and which programs a robot takes."""

from __future__ import annotations

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.colonyc import decode, encode
from colony.ir.program import Robot
from colony.runtime.protocol.interface import MAX_DIGESTS, Interface, interface_of, interface_problem

TEXT = """language 1
enum gait { walk = 0, run = 1 }
robot r {
  frame 50 ms
  sensor near : mm range 0 .. 5000 default 10 from PServer.near within 300 ms
  sensor rays[3] : m from PServer.rays
  sensor ring[4] : mm bearing 0 deg from PServer.ring
  sensor pace : gait from DServer.pace
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s default 0 }
           to RServer.drive idle drive(velocity = 0, turn = 0)
}
"""


def robot(change: tuple[str, str] = ("", ""), more: str = "") -> Robot:
    assert change[0] in TEXT
    return load_text(TEXT.replace(*change, 1) + more).robot


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        (("50 ms", "40 ms"), "`frame period` differs (length)"),
        (("0 .. 5000", "0 .. 4000"), "`near` differs (range)"),
        (("default 10", "default 11"), "`near` differs (default)"),
        (("300 ms", "200 ms"), "`near` differs (within)"),
        (("PServer.near within 300 ms", "PServer.far"), "`near` differs (from and within)"),
        (("near : mm range 0 .. 5000", "near : cm range 0 .. 500"), "`near` differs (type and default)"),
        (("rays[3]", "rays[4]"), "`rays` differs (type)"),
        (("rays[3] : m", "rays[3] : m bearing 10 deg step 20 deg"), "`rays` differs (bearings)"),
        (("bearing 0 deg", "bearing 180 deg"), "`ring` differs (bearings)"),
        (("bearing 0 deg", "bearing 0 deg step -90 deg"), "`ring` differs (bearings)"),
        (("bearing 0 deg", "bearing [0 deg, 90 deg, 180 deg, -90 deg]"), "`ring` differs (bearings)"),
        (("run = 1", "run = 2"), "`pace` differs (type)"),
        (("-600 .. 600", "-600 .. 500"), "`drive` differs (field `velocity`)"),
        (("deg/s default 0", "deg/s default 1"), "`drive` differs (field `turn`)"),
        (("deg/s default 0", "deg/s"), "`drive` differs (field `turn`)"),
        (("RServer.drive", "RServer.base"), "`drive` differs (to)"),
        (("velocity = 0, turn = 0", "velocity = 0, turn = 1 deg/s"), "`drive` differs (idle)"),
        (("turn = 0)", "turn = 0) on_loss degrade"), "`drive` differs (on_loss)"),
    ],
)
def test_each_part_counts(change: tuple[str, str], difference: str) -> None:
    problem = interface_problem(interface_of(robot(change)), interface_of(robot()))
    assert problem == (
        f"the program was checked against another interface (`r`) than the robot's (`r`): {difference}"
    )


def test_names_and_what_the_program_adds_do_not_count() -> None:
    more = "let far = near > 1 m\nlimit drive.velocity <= 10 mm/s\nlet slow = last.drive.velocity"
    assert interface_of(robot(more=more)) == interface_of(robot())
    renamed = robot(("robot r", "robot other"))
    assert interface_problem(interface_of(renamed), interface_of(robot())) is None


def test_a_robot_may_have_more_but_not_less() -> None:
    less = robot(("  sensor rays[3] : m from PServer.rays\n", ""))
    assert interface_problem(interface_of(less), interface_of(robot())) is None
    problem = interface_problem(interface_of(robot()), interface_of(less))
    assert problem.endswith(": `rays` is not there")


def test_a_robot_without_a_description_takes_any_program() -> None:
    assert interface_problem(interface_of(robot()), Interface()) is None
    assert interface_problem(Interface(), interface_of(robot())) is None


def test_a_compiled_program_has_the_interface_of_its_source() -> None:
    program = load_text(TEXT + "let slow = last.drive.velocity")
    compiled = decode(encode(compile_program(program).compiled), "r.colonyc")
    assert interface_of(compiled.robot) == interface_of(program.robot)


def test_a_long_list_of_differences_is_cut() -> None:
    def many(unit: str, count: int) -> Interface:
        sensors = "".join(f"sensor s{i} : {unit} from DServer.s{i} " for i in range(count))
        return interface_of(load_text(f"robot r {{ {sensors} }}").robot)

    problem = interface_problem(many("mm", 9), many("m", 9))
    assert problem.endswith("`s3` differs (type), `s4` differs (type) and 4 more")
    large = many("mm", MAX_DIGESTS // 5)
    assert large.size == 1
    assert interface_problem(large, large) is None
