"""Runs of robots with bodies of their own in a building, led by their lidars."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from shutil import rmtree

import click
import pytest

from colony.cli.run.running import load_for_run
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file
from colony.execute.colonyc import encode
from colony.execute.compiled import Compiled
from colony.runs.compiled import compiled_with_sources
from colony.runs.described import described_robot
from colony.runs.scenario import Scenario, setting
from colony.runs.spec import MisuseError, RunReport, RunSpec
from colony.sim.world_spec import WorldSpec
from tests.pages import typed
from tests.paths import MAPS, ROOT
from tests.runs.test_building_run import Watcher, driven_by

SPEC = RunSpec(
    file="wander.colony",
    world=WorldSpec(map_path=str(MAPS / "loop.stickrep"), seed=1),
    length_ns=20_000_000_000,
)


def compiled_for(behavior: str, robot: str) -> Compiled:
    path = ROOT / "behaviors" / f"{behavior}.colony"
    return compile_program(load_file(path, robot=robot)).compiled


def drive(compiled: Compiled, spec: RunSpec = SPEC) -> RunReport:
    return driven_by(compiled, spec, Watcher(10**9))


@pytest.fixture
def tender(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The robot that `colony robot new` writes."""
    monkeypatch.chdir(tmp_path)
    typed("colony robot new tender", monkeypatch)
    return tmp_path / "robots" / "tender"


def test_a_compiled_program_knows_the_body_of_its_robot_where_there_is_no_description(
    tender: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = load_file(ROOT / "behaviors" / "wander.colony", robot=str(tender))
    body = described_robot(own.robot).body
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "wander.colonyc").write_bytes(encode(compiled_with_sources(own, pytest.fail).compiled))
    monkeypatch.chdir(elsewhere)
    rmtree(tender)
    with click.Context(click.Command("run")):
        _, described = load_for_run("wander.colonyc", unproved=False)
        assert (described.body, described.path and described.path.is_file()) == (body, True)
    assert not described.path.exists(), "it lasts as long as the command"


def test_a_new_robot_drives_by_its_lidar_and_bumps_into_nothing(tender: Path) -> None:
    summary = drive(compiled_for("wander", str(tender)), replace(SPEC, length_ns=60_000_000_000)).summary
    assert summary.frames == 1200
    assert summary.bumps == 0
    assert summary.distance_mm is not None
    assert summary.distance_mm > 20_000.0


def test_the_same_seed_gives_the_same_run_and_another_one_another(tender: Path) -> None:
    compiled = compiled_for("wander", str(tender))
    first, again = drive(compiled), drive(compiled)
    assert first.paths == again.paths
    assert first.paths != drive(compiled, SPEC.with_world(seed=2)).paths


def test_a_robot_with_a_lift_drives_and_commands_it() -> None:
    summary = drive(compiled_for("warehouse", "amr")).summary
    assert summary.bumps == 0
    assert summary.distance_mm is not None
    assert summary.distance_mm > 5_000.0
    assert {actuator.actuator for actuator in summary.actuators} == {"drive", "lift", "report"}
    assert summary.troubles == ()


@pytest.mark.long
def test_a_scenario_presses_a_button() -> None:
    compiled = compiled_for("warehouse", "amr")
    pressed = setting(compiled.robot, "estop = true")._replace(t_ns=5_000_000_000)
    stopped = drive(compiled, replace(SPEC, scenario=Scenario([pressed]))).summary.distance_mm
    free = drive(compiled).summary.distance_mm
    assert stopped is not None
    assert free is not None
    assert 0.0 < stopped < free / 2.0


def test_a_robot_that_does_not_fit_is_refused(tender: Path) -> None:
    body = tender / "tender.toml"
    text = body.read_text(encoding="utf-8")
    assert 'radius = "200 mm"' in text
    body.write_text(text.replace('radius = "200 mm"', 'radius = "2 m"'), encoding="utf-8")
    expected = r"loop\.stickrep: error: the robot cannot start there: .* expected at least 2000 mm"
    with pytest.raises(MisuseError, match=expected):
        drive(compiled_for("wander", str(tender)))


def test_only_rome_is_led_from_room_to_room(tender: Path) -> None:
    compiled = compiled_for("wander", str(tender))
    with pytest.raises(MisuseError, match=r"--from and --to: error: `tender` has another body"):
        drive(compiled, replace(SPEC, origin="201", goal="203"))


@pytest.mark.long
def test_a_robot_stops_at_a_hole_that_is_on_its_map(tmp_path: Path) -> None:
    """The robot starts in the south corridor, 50 inches from its south wall, looking east."""
    loop = (MAPS / "loop.stickrep").read_text(encoding="utf-8")
    path = tmp_path / "holed.stickrep"
    path.write_text(loop.replace("start ", "hole 400 0 480 100\nstart ", 1), encoding="utf-8")
    report = drive(compiled_for("warehouse", "amr"), SPEC.with_world(map_path=str(path)))
    (places,) = report.paths.values()
    assert max(x for x, _ in places) < 400 * 25.4 + 300.0
    assert report.summary.bumps == 0


@pytest.mark.long
def test_mujoco_moves_a_robot_as_ours_does() -> None:
    pytest.importorskip("mujoco", reason="extra mujoco not installed")
    compiled = compiled_for("wander", "amr")
    ours, theirs = (drive(compiled, replace(SPEC, physics=name)) for name in ("kinematic", "mujoco"))
    assert theirs.summary.bumps == 0
    assert theirs.summary.distance_mm == pytest.approx(ours.summary.distance_mm, rel=0.02)
    assert theirs.paths != ours.paths
    assert theirs.paths == drive(compiled, replace(SPEC, physics="mujoco")).paths


def test_mujoco_refuses_what_it_does_not_simulate(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="extra mujoco not installed")
    spec = replace(SPEC, physics="mujoco")
    with pytest.raises(MisuseError, match=r"`rome` cannot be simulated: MuJoCo simulates no sonars"):
        drive(compiled_for("wander", "rome"), spec)
    floor = tmp_path / "loop.stickrep"
    text = (MAPS / "loop.stickrep").read_text(encoding="utf-8")
    floor.write_text(text.replace("start    260 50 270", "start    260 90 270"), encoding="utf-8")
    with pytest.raises(MisuseError, match="the robot cannot start there: robot 0"):
        drive(compiled_for("wander", "amr"), spec.with_world(map_path=str(floor)))


BLIND = """language 1
import robot

module go    { when true               do drive(velocity = 100 mm/s, turn = 0) }
module blind { when not fresh(ranges)  do drive(velocity = 0, turn = 0) }
network { drive = blind suppresses go }
"""


@pytest.mark.thorough
def test_within_sees_the_faults_of_a_device(tender: Path) -> None:
    """Readings that are frozen for 2 s are missing for 1.7 s where they are read within 300 ms."""

    body, interface = tender / "tender.toml", tender / "tender.colony"
    described, declared = body.read_text(encoding="utf-8"), interface.read_text(encoding="utf-8")
    behavior = tender.parent / "blind.colony"
    behavior.write_text(BLIND, encoding="utf-8")
    assert "\n[server.Lidar]\n" in described
    assert "within 300 ms" in declared

    def blind_part(faults: str, within: str) -> float:
        table = f"\n[server.Lidar]\nfaults = {faults}\n"
        body.write_text(described.replace("\n[server.Lidar]\n", table), encoding="utf-8")
        interface.write_text(declared.replace("within 300 ms", within), encoding="utf-8")
        compiled = compile_program(load_file(behavior, robot=str(tender))).compiled
        summary = drive(compiled, replace(SPEC, length_ns=120_000_000_000)).summary
        (actuator,) = summary.actuators
        return sum(share.percent for share in actuator.shares if share.module == "blind") / 100.0

    frozen = '{ frozen = "40 percent", lasting = "2 s" }'
    missing = frozen.replace("frozen", "missing")
    assert blind_part("{}", "within 300 ms") < 0.01
    assert 0.15 < blind_part(frozen, "within 300 ms") < 0.55
    assert blind_part(frozen, "") < 0.01
    assert 0.2 < blind_part(missing, "") < 0.6
