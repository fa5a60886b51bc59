from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.paths import ROOT
from tests.verify.difference.programs import ROBOT
from tests.verify.small_robot import go

ROAM = (
    go("cruise", "true")
    + go("avoid", "sonar < 1 m", "80 mm/s")
    + "network { drive = avoid suppresses cruise }\n"
)


@pytest.fixture
def a(tmp_path: Path) -> Path:
    path = tmp_path / "a.colony"
    path.write_text(ROBOT + ROAM)
    return path


@pytest.fixture
def b(tmp_path: Path) -> Path:
    path = tmp_path / "b.colony"
    path.write_text(ROBOT + ROAM.replace("avoid", "dodge").replace("1 m ", "1001 mm "))
    return path


def test_modules_of_one_behavior_alone_are_named(colony: Colony, a: Path, b: Path) -> None:
    code, out, _ = colony("diff", a, b)
    assert code == 1
    _, verdict, *_, rest, one, other = out.splitlines()
    assert verdict == "DIFFERENT: shown by a run of one frame"
    assert rest == "  all other sensors: missing (their readings make no difference)"
    assert [one, other] == ["only in A: `avoid`", "only in B: `dodge`"]


def test_json(colony: Colony, a: Path, b: Path) -> None:
    code, out, _ = colony("diff", "--format", "json", a, b)
    made = json.loads(out)
    assert code == 1
    assert (made["a"], made["b"], made["verdict"]) == (str(a), str(b), "different")
    assert made["frames"] == [
        {
            "frame": {"t": 0.0, "sonar": 1000.0},
            "answers": {},
            "a": {"drive": {"by": "cruise", "velocity": 300.0, "turn": 0.0}, "lamp": {"by": None}},
            "b": {"drive": {"by": "dodge", "velocity": 80.0, "turn": 0.0}, "lamp": {"by": None}},
        }
    ]
    assert made["modules"] == {
        "same": [{"a": "cruise", "b": "cruise"}],
        "changed": [],
        "only_a": ["avoid"],
        "only_b": ["dodge"],
    }


def test_what_is_ignored_makes_no_difference(colony: Colony, a: Path, b: Path) -> None:
    assert colony("diff", "--ignore", "drive.velocity", a, b).code == 0
    assert colony("diff", "--ignore", "avoid", "--ignore", "dodge", a, b).code == 0
    err = colony.refusal("diff", "--ignore", "dodgy", a, b)
    assert "error[V040]: neither behavior has the actuator, field or module `dodgy`" in err
    assert "did you mean `dodge`?" in err


def test_actuators_of_other_names(colony: Colony) -> None:
    figure = ROOT / "behaviors" / "figure_4_14.colony"
    assert colony("diff", "--actuator", "left=right", figure, figure).code == 0
    assert "`left` is not a pair of actuators" in colony.refusal("diff", "--actuator", "left", figure, figure)
    assert colony("diff", "--actuator", "left=rihgt", figure, figure).code == 2


def test_what_cannot_be_decided_has_an_exit_code_of_its_own(colony: Colony, a: Path, b: Path) -> None:
    python = 'module p from python "nowhere:Nothing" { param gain = %s reads sonar commands drive }\n'
    for path, gain in ((a, "1"), (b, "2")):
        path.write_text(ROBOT + python % gain + "network { drive = p }\n")
    code, out, _ = colony("diff", a, b)
    assert code == 3
    assert out.splitlines()[1] == "undecided"
    assert "modules in Python" in out


def test_a_timeout_that_is_no_time_is_refused(colony: Colony, a: Path) -> None:
    assert "is not in the range 0<x<=1000000.0" in colony.refusal("diff", "--timeout", "nan", a, a)


def test_bad_files_and_other_robots_are_misuse(colony: Colony, a: Path, b: Path) -> None:
    assert colony("diff", a, a.parent / "none.colony").code == 2
    b.write_text(b.read_text().replace("range 0 .. 10000", "range 0 .. 100"))
    err = colony.refusal("diff", a, b)
    assert "error[V041]: sensor `sonar` has the range 0 mm .. 100 mm, expected 0 mm .. 10000 mm" in err
    b.write_text("robot")
    assert colony("diff", a, b).code == 2
