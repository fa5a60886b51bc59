"""The pages of robots, drivers, recordings and proofs leave nothing out, and their numbers are the code's."""

from __future__ import annotations

import configparser
import math
import re
from pathlib import Path
from typing import Any

import pytest

from colony.analysis.tracks import CONDITIONS
from colony.drivers.dialect import REFUSALS
from colony.drivers.guard import REPEATS_NS
from colony.drivers.line import Measurements
from colony.drivers.serial_base import DEADLINE_FRAMES, DEADLINE_NS
from colony.dsl.check.robot import RESERVED_FIELDS
from colony.dsl.load import check_file
from colony.runtime.recordings.replay import RESERVED
from colony.runtime.recordings.schemas import CONTRACTS, FRAMES, KEYFRAMES, REQUESTS, VERDICTS
from colony.runtime.servers.drivers import Reading
from colony.text.codes import CODES
from tests.body.keys_table import rows
from tests.pages import blocks, files, page_text, page_words, typed, write_files
from tests.paths import ROOT

ROBOTS, DRIVERS, RECORDINGS, SENSOR_LOSS = map(
    page_text, ("robots.md", "drivers.md", "recordings.md", "when-a-sensor-dies.md")
)
EXAMPLES = [path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples/sensor_loss").iterdir())]

LISTED = """
  sensor infrared[24] : bool bearing -180 deg from PServer.infrared
  sensor heading : deg                        from RServer.heading
  sensor goal_direction : deg                 from DServer.GoalDirection
  sensor carrying : bool                      from DServer.Carrying
  sensor arm_busy : bool                      from DServer.ArmBusy
  sensor teleop_velocity : mm/s               from DServer.TeleopVelocity
  sensor teleop_turn : deg/s                  from DServer.TeleopTurn
  actuator drive"""
NEAREST = """
let ahead = ranges[0 deg]
let left  = ranges[90 deg]
let right = ranges[-90 deg]
"""
"""What the page lists of the behaviors that come with colony, and `scout` has not."""


# --- robots.md ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("behavior", ["wander", "follow_wall", "teleop", "herbert"])
def test_a_behavior_checks_on_a_robot_that_has_what_is_listed(behavior: str, tmp_path: Path) -> None:
    write_files("robots.md", tmp_path)
    scout = tmp_path / "robots" / "scout" / "scout.colony"
    listed = scout.read_text().replace("\n  actuator drive", LISTED) + NEAREST
    (tmp_path / "scout.colony").write_text(listed, encoding="utf-8")
    path = ROOT / "behaviors" / f"{behavior}.colony"
    assert check_file(path, robot=str(tmp_path / "scout.colony")).diagnostics == ()
    for name in re.findall(r"sensor (\w+)|let (\w+)", LISTED + NEAREST):
        assert f"`{''.join(name)}`" in ROBOTS


def test_other_behaviors_pass_their_tests_on_the_robot_of_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_files("robots.md", tmp_path)
    assert typed("colony test wander --robot scout", monkeypatch).out.endswith("7 passed, 0 failed\n")
    typed("colony new walk", monkeypatch)
    assert typed("colony test walk/walk.colony --robot scout", monkeypatch).out.endswith(
        "1 passed, 0 failed\n"
    )


def test_the_page_has_every_key_of_a_body() -> None:
    assert "\n".join(rows()) in ROBOTS


# --- drivers.md --------------------------------------------------------------------------------------


def test_the_protocol_of_lines_gives_ranges_and_refuses_damage() -> None:
    module: dict[str, Any] = {}
    exec(files("drivers.md")["scan_drivers.py"], module)
    dialect = module["Scan"]()
    lines = [
        f"{text}*{sum(text[1:].encode()) % 256:02x}\n" for text in ("R,310,-,1200", "R,abc,2,3", "R,5,9,9")
    ]
    assert "`R,310,-,1200*" + lines[0][-3:-1] in DRIVERS
    stream = "R,31\xff\n" + lines[0] + lines[0].replace("3", "4") + "".join(lines[1:])
    good, unreadable, outside = dialect.decoder().feed(stream.encode("latin-1"))
    measured = Measurements(rings={}, bounds=dialect.bounds, max_speed=0.0, max_turn=0.0)
    measured.take(dialect.read(good, 0), 0)
    assert measured.readings(0) == {"range": Reading((310.0, math.inf, 1200.0), 0)}
    with pytest.raises(REFUSALS, match="'abc'"):
        dialect.read(unreadable, 0)
    with pytest.raises(REFUSALS, match="range is 5"):
        measured.take(dialect.read(outside, 0), 0)


def test_the_page_has_the_times_of_the_guard() -> None:
    words = page_words("drivers.md")
    assert f"for {DEADLINE_NS // 1_000_000} ms, or for three frames" in words
    assert DEADLINE_FRAMES == 3
    first, second, third = (t_ns // 1_000_000 for t_ns in REPEATS_NS[1:])
    assert f"after {first}, {second} and {third} ms" in words


def test_the_unit_is_one() -> None:
    unit = configparser.ConfigParser(strict=True)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read_string(files("drivers.md")["rover.service"])
    assert unit["Service"]["ExecStart"].endswith("serve all --robot r1=rover --port /dev/rover")


# --- recordings, reasons, proofs ---------------------------------------------------------------------


def test_every_name_of_recordings_is_told_of() -> None:
    for name in (*RESERVED, *RESERVED_FIELDS):
        assert f"`{name}`" in RECORDINGS or f'"{name}"' in RECORDINGS, name
    for topic in (FRAMES, KEYFRAMES, CONTRACTS, f"{VERDICTS}ACTUATOR", f"{REQUESTS}ACTUATOR"):
        assert f"`{topic}`" in RECORDINGS


def test_every_condition_and_lint_is_told_of() -> None:
    assert all(f"is {word}`" in page_text("explain.md") for word in CONDITIONS)
    assert all(code in page_text("verification.md") for code in CODES if "V020" <= code < "V040")


def test_the_page_shows_parts_of_its_example_and_every_loss() -> None:
    fences = [" ".join(b.text.split()) for b in blocks("when-a-sensor-dies.md") if b.info == "colony"]
    examples = [" ".join(text.split()) for text in EXAMPLES]
    assert [fence for fence in fences if not any(fence in text for text in examples)] == []
    tests = re.findall(r'^test ".*(?:dies|dead|sticks).*$', "\n".join(EXAMPLES), re.MULTILINE)
    assert len(set(tests)) == 11
    assert [test for test in tests if test not in SENSOR_LOSS] == []
