"""The behaviors that come with the project: they check, their examples hold, and they drive well."""

from __future__ import annotations

import io
import json
import random
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from colony.analysis.recording import unpacked_program
from colony.cli.main import main
from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import check_file, load_file
from colony.execute.colonyc import decode, encode
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Frame, Reading
from colony.ir.program import Program, Sensor
from colony.ir.types import Array, Bool
from colony.runs.compiled import compiled_with_sources
from colony.runs.described import described_robot
from colony.runtime.library.leader import RunProgram, SourceText
from colony.runtime.protocol.bindings import bind
from colony.runtime.recordings.mcap_reader import McapReader
from colony.shipped import Shipped
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.examples import failures_as_diagnostics, run_examples
from colony.watch.joining import joined_program
from tests.analysis.recorded_runs import as_mcap
from tests.paths import BEHAVIORS, ROOT, THESIS_NAVIGATOR
from tests.sampling import long, sampled

WANDER = ROOT / "behaviors" / "wander.colony"
MAPS = sorted((ROOT / "maps").glob("*.stickrep"))

every_file = pytest.mark.parametrize("file", BEHAVIORS, ids=lambda path: path.stem)
some_files = pytest.mark.parametrize("file", sampled(BEHAVIORS, every=4), ids=lambda path: path.stem)
SMALL = [m for m in MAPS if m.stem in {"loop", "hallway"}]
a_small_map = pytest.mark.parametrize(
    "building", [m if m.stem == "loop" else long(m) for m in SMALL], ids=lambda path: path.stem
)
every_map = pytest.mark.parametrize(
    "building",
    [m if m.stem == "loop" else pytest.param(m, marks=pytest.mark.thorough) for m in MAPS],
    ids=lambda path: path.stem,
)


def test_there_are_behaviors_and_maps() -> None:
    assert {f.stem for f in BEHAVIORS} >= {
        "rome",
        "amr",
        "wander",
        "corridor",
        "goals",
        "hallway",
        "navigator",
        "allen",
        "herbert",
        "teleop",
        "figure_4_14",
        "follow_wall",
        "warehouse",
        "omni",
        "pioneer",
        "shelves",
        "delivery",
        "recharge",
        "bounce",
    }
    assert {m.stem for m in MAPS} >= {"loop", "hallway"}


@every_file
def test_checks_without_a_word(file: Path) -> None:
    checked = check_file(file)
    assert checked.diagnostics == ()
    assert checked.program is not None


@every_file
def test_asks_for_nothing_that_no_server_has(file: Path) -> None:
    robot = load_file(file).robot
    bind(robot, described_robot(robot).servers)


@pytest.mark.parametrize(
    ("file", "robot"),
    [(WANDER, None), *(long(file, None) for file in BEHAVIORS if file != WANDER)]
    + [(WANDER, robot) for robot in Shipped.ROBOT.names()],
    ids=lambda of: of.stem if isinstance(of, Path) else of,
)
def test_a_program_that_travels_takes_the_body_of_its_robot_along(file: Path, robot: str | None) -> None:
    own = load_file(file, robot=robot)
    body = described_robot(own.robot).body
    compiled = decode(encode(compiled_with_sources(own, pytest.fail).compiled), "own.colonyc")
    sources = tuple(SourceText(kind=s.kind, path=s.path, data=s.data) for s in compiled.sources)
    given = RunProgram(run="1", root=compiled.root, sources=sources)
    recorded = as_mcap(own, (), *compiled.sources).content
    run = replace(McapReader(io.BytesIO(recorded), "run.mcap").run, program=compiled.root)
    for name, travelled in (
        ("joined", joined_program(given, "lab")),
        ("recorded", unpacked_program(run.program, run.sources, None, "lab")),
    ):
        with travelled as program:
            described = described_robot(program.robot)
            assert described.body == body, name
            bind(program.robot, described.servers)


@some_files
def test_its_examples_hold(file: Path) -> None:
    results = run_examples(load_file(file))
    assert len(results) >= 3
    assert failures_as_diagnostics(results) == ()


@every_file
def test_its_examples_show_every_module_at_work(file: Path) -> None:
    text = file.read_text()
    examples = text[text.index('\ntest "') :]
    for module in load_file(file).modules:
        if module.span.source.name != str(file):
            continue
        shown = rf"\bby {module.name}\b" if module.actuator else rf"\b{module.name} is active\b"
        assert re.search(shown, examples), f"no example in which `{module.name}` acts"


@every_file
def test_is_written_like_the_others(file: Path) -> None:
    lines = file.read_text().splitlines()
    assert lines[0].startswith(f"# {file.name} - ")
    for number, line in enumerate(lines, 1):
        assert len(line) <= 115, f"line {number} is too long"
        assert line == line.rstrip(), f"line {number} ends in blanks"
        assert "\t" not in line, f"line {number} has a tab"


# --- any frames at all ---------------------------------------------------------------------------


@pytest.mark.parametrize("file", sampled(BEHAVIORS, every=3, thorough=True), ids=lambda path: path.stem)
def test_contracts_hold_and_the_clients_agree_on_random_frames(file: Path) -> None:
    program = load_file(file)
    clients = compile_program(program).clients
    reference = Interpreter(program)
    compiled = (
        ProgramExecutor(lower(program, clients)),
        ProgramExecutor(lower(program, clients), exclusive=True),
    )
    for frame in random_frames(program, seed=414, count=250):
        outcome = reference.step(frame)
        assert outcome.breaches == (), f"at {frame.t_ns} ns"
        assert all(executor.step(frame) == outcome for executor in compiled)


def random_frames(program: Program, *, seed: int, count: int) -> Iterator[Frame]:
    """Frames of random readings; each stays for half a second on average, and is missing now and then."""
    chance = random.Random(seed)
    readings: dict[str, Reading] = {}
    for k in range(count):
        for sensor in program.robot.sensors:
            if k == 0 or chance.random() < 0.1:
                readings[sensor.name] = None if chance.random() < 0.05 else random_reading(sensor, chance)
        yield Frame(k * program.robot.frame_ns, dict(readings))


def random_reading(sensor: Sensor, chance: random.Random) -> Reading:
    """A reading in the sensor's declared unit."""
    one = (lambda: chance.random() < 0.1) if is_bool(sensor) else (lambda: random_number(sensor, chance))
    return tuple(one() for _ in range(sensor.type.size)) if isinstance(sensor.type, Array) else one()


def is_bool(sensor: Sensor) -> bool:
    return isinstance(sensor.type.element if isinstance(sensor.type, Array) else sensor.type, Bool)


def random_number(sensor: Sensor, chance: random.Random) -> float:
    """Small ones are as likely as large ones, and the ends of the range are hit, too."""
    low = -5000.0 if sensor.low is None else sensor.low
    high = 5000.0 if sensor.high is None else sensor.high
    part = chance.choice((0.0, 1.0, chance.random(), chance.random() ** 3, chance.random() ** 3))
    return (low + part * (high - low)) / sensor.factor


# --- in the building -----------------------------------------------------------------------------

Run = Callable[..., dict[str, Any]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a behavior in a building for some seconds, as `colony run` does; gives its report."""

    def colony_run(file: Path, building: Path, seconds: int, *arguments: str) -> dict[str, Any]:
        command = ["colony", "run", str(file), "--map", str(building), "--duration", str(seconds)]
        command += ["--seed", "1", "--no-picture", "--format", "json", *arguments]
        monkeypatch.setattr(sys, "argv", command)
        with pytest.raises(SystemExit) as stopped:
            main()
        report: dict[str, Any] = json.loads(capsys.readouterr().out)
        assert stopped.value.code == 0
        assert report["breaches"] == report["troubles"] == report["disagreements"] == []
        assert report["bumps"] == 0
        return report

    return colony_run


def seconds_by(report: dict[str, Any], module: str | None) -> float:
    """For how long a module commanded the first actuator."""
    shares = report["actuators"][0]["shares"]
    return float(next(share["seconds"] for share in shares if share["module"] == module))


@every_map
@some_files
def test_runs_in_every_building(file: Path, building: Path, run: Run) -> None:
    report = run(file, building, 6)
    if file.stem in {"wander", "hallway", "allen", "herbert", "teleop", "follow_wall", "warehouse"}:
        assert report["distance_mm"] > 500.0


@a_small_map
def test_wander_goes_a_long_way(building: Path, run: Run) -> None:
    report = run(ROOT / "behaviors" / "wander.colony", building, 60)
    assert report["distance_mm"] > 30_000.0  # at 600 mm/s it would be 36 m without any corner
    assert seconds_by(report, "avoid") > 1.0  # there was one


@a_small_map
def test_shelves_goes_sideways_along_a_wall(building: Path, run: Run) -> None:
    report = run(ROOT / "behaviors" / "shelves.colony", building, 60)
    least_mm, least_s = (14_000.0, 50.0) if building.stem == "loop" else (11_000.0, 40.0)  # ends in a hallway
    assert report["distance_mm"] > least_mm  # at 300 mm/s it would be 18 m without a turn
    assert seconds_by(report, "survey") > least_s
    assert report["bumps"] == 0


@a_small_map
def test_follow_wall_goes_along_the_wall_at_its_distance(building: Path, run: Run) -> None:
    report = run(ROOT / "behaviors" / "follow_wall.colony", building, 60)
    assert report["distance_mm"] > 20_000.0  # at 400 mm/s it would be 24 m without any corner
    assert seconds_by(report, "follow") > 50.0


@a_small_map
def test_hallway_comes_to_the_end_and_waits_there(building: Path, run: Run) -> None:
    report = run(ROOT / "behaviors" / "hallway.colony", building, 60)
    assert 21_000.0 < report["distance_mm"] < 24_000.0
    assert seconds_by(report, None) < 20.0
    assert seconds_by(report, "check_goal") == 0.0  # it never lost its way


def test_the_warehouse_robot_goes_to_its_goal_and_lifts_there(run: Run) -> None:
    goal = ("GoalX=12000", "GoalY=1270", "GoalLift=2", "GoalNumber=1")
    arguments = [argument for setting in goal for argument in ("--set", setting)]
    behavior = ROOT / "behaviors" / "warehouse.colony"
    report = run(behavior, ROOT / "maps" / "loop.stickrep", 20, *arguments)
    assert 5_200.0 < report["distance_mm"] < 5_400.0  # the robot begins at 6604 mm
    assert seconds_by(report, "to_goal") < 10.0
    shares = {a["actuator"]: {s["module"]: s["seconds"] for s in a["shares"]} for a in report["actuators"]}
    assert shares["lift"]["serve"] > 5.0
    assert shares["report"]["tell"] > 1.0


SHIFT = """
at 5 s    cliff = [true, false, false, false]
at 6 s    cliff = [false, false, false, false]
at 10 s   battery = 15 percent
at 25 s   estop = true
at 27 s   estop = false
"""


def test_the_warehouse_robot_leaves_an_edge_and_goes_to_its_charger(run: Run, tmp_path: Path) -> None:
    (tmp_path / "shift.scenario").write_text(SHIFT)
    behavior, building = ROOT / "behaviors" / "warehouse.colony", ROOT / "maps" / "loop.stickrep"
    report = run(behavior, building, 40, "--scenario", str(tmp_path / "shift.scenario"))
    assert seconds_by(report, "leave_edge") == pytest.approx(2.0, abs=0.1)
    assert 4.0 < seconds_by(report, "to_charger") < 20.0
    assert seconds_by(report, None) > 15.0  # at the charger


def test_the_warehouse_robot_stands_after_a_stop_until_it_is_started(run: Run, tmp_path: Path) -> None:
    pressed = "at 2 s estop = true, resume = true\nat 3 s estop = false\nat 4 s resume = false\n"
    (tmp_path / "stop.scenario").write_text(f"{pressed}at 5 s resume = true\n")
    behavior, building = ROOT / "behaviors" / "warehouse.colony", ROOT / "maps" / "loop.stickrep"
    report = run(behavior, building, 7, "--scenario", str(tmp_path / "stop.scenario"))
    assert seconds_by(report, None) == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize(
    "start",
    [
        "4m,0,90",
        *(pytest.param(at, marks=pytest.mark.thorough) for at in ("2m,600mm,200", "11.5m,-12.5m,130")),
    ],
)
def test_recharge_stands_at_a_dock_until_it_is_nearly_full(start: str, run: Run, tmp_path: Path) -> None:
    (tmp_path / "charge.scenario").write_text("at 0 s battery = 15 percent\nat 40 s battery = 90 percent\n")
    arguments = ("--start", start, "--scenario", str(tmp_path / "charge.scenario"))
    report = run(ROOT / "behaviors" / "recharge.colony", ROOT / "maps" / "office.yaml", 45, *arguments)
    assert 5.0 < seconds_by(report, "to_dock") < 20.0  # and once: where nothing charges it, it tries again
    assert seconds_by(report, None) > 20.0
    assert seconds_by(report, "wander.keep_middle") + seconds_by(report, "wander.avoid") > 4.0


def test_hallway_turns_to_the_goal_and_stops_at_its_distance(run: Run) -> None:
    arguments = ("--set", "GoalDirection=90", "--set", "GoalDistance=3000")
    report = run(ROOT / "behaviors" / "hallway.colony", ROOT / "maps" / "loop.stickrep", 20, *arguments)
    assert seconds_by(report, "check_goal") > 3.0  # half a turn, at 60 degrees a second
    assert 2_970.0 < report["distance_mm"] < 3_030.0


GOAL = ("--set", f"GoalType={ord('D')}", "--set", "GoalDirection=90", "--set", "GoalDistance=4000")


@pytest.mark.parametrize(
    ("behavior", "beyond_mm"),
    [(ROOT / "behaviors" / "navigator.colony", 30.0), (THESIS_NAVIGATOR, 300.0)],
    ids=lambda of: of.stem if isinstance(of, Path) else "",
)
def test_the_navigator_stands_until_it_has_a_goal_and_stops_there(
    behavior: Path, beyond_mm: float, run: Run
) -> None:
    building = ROOT / "maps" / "loop.stickrep"
    assert run(behavior, building, 3)["distance_mm"] == 0.0
    report = run(behavior, building, 30, *GOAL)
    assert 3_970.0 < report["distance_mm"] < 4_000.0 + beyond_mm
    [told] = [a for a in report["actuators"] if a["actuator"] == "report"]
    assert next(share["seconds"] for share in told["shares"] if share["module"] == "tell") > 1.0


def test_the_operator_drives_while_the_stick_is_held(run: Run) -> None:
    arguments = ("--set", "TeleopVelocity=150")
    report = run(ROOT / "behaviors" / "teleop.colony", ROOT / "maps" / "loop.stickrep", 8, *arguments)
    assert seconds_by(report, "operator") == pytest.approx(8.0)
    assert report["distance_mm"] == pytest.approx(150.0 * 8, rel=0.05)


# --- Figure 4.14 ---------------------------------------------------------------------------------


def test_both_networks_of_figure_4_14_have_the_same_priorities() -> None:
    program = load_file(ROOT / "behaviors" / "figure_4_14.colony")
    lists = compile_program(program).clients.actuators
    priorities = [{c.module.rstrip("2"): c.priority for c in one.clients} for one in lists]
    assert [one.actuator for one in lists] == ["left", "right"]
    assert priorities == [{"A": 4, "B": 3, "C": 2, "D": 1}] * 2


def test_the_order_of_visit_of_figure_4_14_is_d_c_b_a() -> None:
    program = load_file(ROOT / "behaviors" / "figure_4_14.colony")
    left = compile_program(program).clients.actuators[0]
    assert [c.module for c in sorted(left.clients, key=lambda c: c.priority)] == ["D", "C", "B", "A"]
