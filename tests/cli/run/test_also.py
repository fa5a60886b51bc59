"""`colony run --also` and `--movers`: what is accepted, what is refused, and what a run says of them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from colony.cli.run.also import other_robots
from colony.cli.run.options import OptionError
from tests.cli.conftest import Colony
from tests.paths import ROOT
from tests.ros2 import burger

LOOP = str(ROOT / "maps" / "loop.stickrep")


def test_others_have_names_descriptions_behaviors_starts_and_scenarios(tmp_path: Path) -> None:
    scenario = tmp_path / "a=b@c.scenario"
    scenario.write_text("at 3 s teleop_velocity = 200 mm/s")
    teleop = f"rome:teleop@1m,2000,-90,scenario={scenario}"
    found = other_robots(("rome:wander", teleop, "lift=amr:wander"), "rome")
    assert [other.name for other in found] == ["rome_2", "rome_3", "lift"]
    assert [other.described.body.robot.name for other in found] == ["rome", "rome", "amr"]
    assert [Path(other.file).stem for other in found] == ["wander", "teleop", "wander"]
    assert [other.start for other in found] == [None, (1_000.0, 2_000.0, 270.0), None]
    assert [other.scenario is not None and len(other.scenario.changes) for other in found] == [0, 1, 0]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("rome", r"found `rome`; expected \[NAME=\]DESCRIPTION:BEHAVIOR\[@X,Y,HEADING\]"),
        ("rome=wander", "found `rome=wander`; expected"),
        ("rome:", "found `rome:`; expected"),
        (":wander", "found `:wander`; expected"),
        ("=rome:wander", "found `=rome:wander`; expected"),
        ("rome:wander@", "found `rome:wander@`; expected"),
        ("rome:wander,scenario=", "found `rome:wander,scenario=`; expected"),
        ("rome:wander@1,2", "--also rome:wander: found `1,2`; expected X,Y,HEADING"),
        ("a/b=rome:wander", "`a/b` cannot be the name of a robot"),
        ("amr=rome:wander", "two robots are named `amr`"),
    ],
)
def test_what_is_no_other_robot_is_refused(text: str, problem: str) -> None:
    with pytest.raises(OptionError, match=problem):
        other_robots((text,), "amr")


def test_too_many_are_refused() -> None:
    with pytest.raises(OptionError, match="found 101 robots; expected at most 100"):
        other_robots(("rome:wander",) * 101, "amr")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (
            ("--map", LOOP, "--from", "201", "--to", "203", "--movers", "3"),
            "--to excludes --movers: --hazards has people in the corridors",
        ),
        (
            ("--map", LOOP, "--processes", "--also", "rome:wander"),
            "--processes excludes --also: other robots run in virtual time",
        ),
        (("--map", LOOP, "--movers", "-1"), "-1 is not in the range"),
        (("--map", LOOP, "--also", "rome"), "--also: found `rome`; expected"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    colony: Colony, arguments: tuple[str, ...], problem: str
) -> None:
    assert problem in colony.refusal("run", "wander", "--robot", "rome", *arguments)


def test_a_behavior_that_is_not_for_the_robot_is_refused(colony: Colony) -> None:
    err = colony.refusal(
        "run", "wander", "--robot", "rome", "--map", LOOP, "--also", "rome:warehouse", code=1
    )
    assert "warehouse" in err
    nowhere = colony("run", "wander", "--robot", "rome", "--map", LOOP, "--also", "nobody:wander")
    assert nowhere.code in (1, 2)
    assert "nobody" in nowhere.err


def test_a_run_names_the_others(colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ("run", "wander", "--robot", "rome", "--map", LOOP, "--duration", "0.5", "--movers", "2")
    assert "\n  amr (amr with wander) traveled 0." in colony.output(*arguments, "--also", "amr:wander")
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")
    data = colony(*arguments, "--also", "lift=amr:wander", "--format", "json", "--no-picture")
    [other] = json.loads(data.out)["others"]
    assert other["name"] == "lift"
    assert other["robot"] == "amr"
    assert other["behavior"] == "wander"
    assert other["bumps"] == 0
    assert other["distance_mm"] > 0.0


def test_a_robot_that_is_called_like_no_description_is_said(colony: Colony) -> None:
    command = ("run", "wander", "--map", LOOP, "--duration", "0.1", "--no-picture", "--robot")
    slip = "`omny` is no description, but the name of the robot, a rome; did you mean `omni`?\n"
    assert colony(*command, "omny").err.startswith(slip)
    assert "is no description" not in colony(*command, "lab=omni").err


def test_a_behavior_that_imports_another_robot_than_the_one_named_is_said(
    colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    interface = f'import "{ROOT / "robots" / "rome" / "rome.colony"}"\n'
    text = (ROOT / "behaviors" / "wander.colony").read_text()
    (tmp_path / "own.colony").write_text(text.replace("import robot\n", interface))
    command = ("run", "own.colony", "--map", LOOP, "--duration", "0.1", "--no-picture", "--robot")
    slip = "`amr` is only the name of the robot here: the behavior itself imports rome"
    assert slip in colony(*command, "amr").err
    assert "only the name" not in colony(*command, "lab").err


def test_servers_without_a_simulated_device_are_said(colony: Colony, tmp_path: Path) -> None:
    program = burger.write(tmp_path, Path("python3"))
    named = f"burger={tmp_path / 'robots' / 'burger' / 'burger.colony'}"
    command = ("run", str(program), "--map", LOOP, "--duration", "0.1", "--no-picture", "--robot", named)
    said = "`Lidar`, `Battery` and `Panel` have no device in the simulator (`simulated` in the body)"
    assert said in colony(*command).err
