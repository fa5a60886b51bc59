"""A run in a building as a library: whoever starts it hears of it, and may end it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file, load_text
from colony.execute.compiled import Compiled
from colony.nav.maps.building import Building
from colony.runs import building_run
from colony.runs.building_run import run_in_building
from colony.runs.described import described_robot
from colony.runs.spec import MisuseError, RunReport, RunSpec, UserInterface
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.kit.script import Script
from colony.sim.world_spec import WorldSpec
from colony.text.diagnostics import DiagnosticError
from tests.paths import MAPS, ROOT

WANDER = ROOT / "behaviors" / "wander.colony"


class Watcher:
    """Ends a run after `most` frames. Mutable: the frames, and the length that was told."""

    def __init__(self, most: int) -> None:
        self.most, self.frames = most, 0
        self.length_ns: int | None = None

    def take(self, log: RunFrame) -> None:
        self.frames += 1

    def close(self) -> None:
        """It holds nothing."""

    def follow(self, length_ns: int | None) -> Watcher:
        self.length_ns = length_ns
        return self

    @contextmanager
    def interruptible(self) -> Iterator[Callable[[], bool]]:
        yield lambda: self.frames >= self.most

    @property
    def ui(self) -> UserInterface:
        return UserInterface(
            report=print, interruptible=self.interruptible, progress=self.follow, operator=_nobody
        )


def _nobody(building: Building) -> Script:
    raise AssertionError("the loop has no elevators")


@cache
def wander() -> Compiled:
    return compile_program(load_file(WANDER)).compiled


def spec(record: Path | None = None) -> RunSpec:
    return RunSpec(
        file=str(WANDER),
        world=WorldSpec(map_path=str(MAPS / "loop.stickrep"), seed=1),
        length_ns=2_000_000_000,
        record=None if record is None else str(record),
    )


def driven_by(compiled: Compiled, spec: RunSpec, watcher: Watcher) -> RunReport:
    return run_in_building(compiled, described_robot(compiled.robot), spec, watcher.ui)


def test_a_run_tells_what_came_of_it() -> None:
    watcher = Watcher(10_000)
    driven = driven_by(wander(), spec(), watcher)
    assert watcher.length_ns == 2_000_000_000
    assert driven.summary.frames == watcher.frames > 10
    assert not driven.summary.interrupted
    assert driven.mission_result is None
    (floor,) = driven.floors
    places = driven.paths[floor.name]
    assert places[0] == floor.start(400.0)[:2]
    length_mm = sum(map(math.dist, places, places[1:]))
    assert length_mm == pytest.approx(driven.summary.distance_mm, rel=0.02)
    assert length_mm > 100.0


def test_a_run_begins_where_it_is_told_to() -> None:
    for map_name, start in (("loop.stickrep", (1000.0, 3000.0, 90.0)), ("office.yaml", (5000.0, 0.0, 270.0))):
        asked = replace(spec(), length_ns=100_000_000).with_world(map_path=str(MAPS / map_name), start=start)
        driven = driven_by(wander(), asked, Watcher(10_000))
        [path] = driven.paths.values()
        assert path[0] == start[:2]


def test_whoever_attends_a_run_may_end_it() -> None:
    watcher = Watcher(5)
    driven = driven_by(wander(), spec(), watcher)
    assert driven.summary.interrupted
    assert driven.summary.frames == watcher.frames == 5


def test_why_a_robot_stands_is_reported_to_whom_it_interests_alone(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Experiments keep the first report of a run as its remark; a robot that rests is none."""
    module = "module m { when true do drive(velocity = 0, turn = 0) }"
    stand = f"language 1\nimport robot\n{module}\nnetwork {{ drive = m }}"
    compiled, lines = compile_program(load_text(stand, robot="rome")).compiled, list[str]()
    described, ui = described_robot(compiled.robot), Watcher(10_000).ui
    run_in_building(compiled, described, spec(), ui)
    assert capsys.readouterr().out == ""
    run_in_building(compiled, described, spec(), replace(ui, stands=lines.append))
    assert lines == ["nothing moves: `m` commands it to stand, or a limit holds it at 0"]


def test_a_recording_that_cannot_be_written_is_misuse(tmp_path: Path) -> None:
    with pytest.raises(MisuseError, match=r"gone/run\.jsonl: error: cannot write: No such file or directory"):
        driven_by(wander(), spec(tmp_path / "gone" / "run.jsonl"), Watcher(5))


def test_what_the_robot_lacks_is_reported_before_the_simulator_is_compiled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(building_run, "populated_world", lambda *_: pytest.fail("the simulator was compiled"))
    drive = "actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)"
    text = f"robot r {{ sensor scan : m from Lidar.scan {drive} }}\n"
    program = load_text(
        f"{text}module m {{ when scan > 1 m do drive(velocity = 0) }} network {{ drive = m }}"
    )
    with pytest.raises(DiagnosticError, match="there is no server `Lidar`"):
        driven_by(compile_program(program).compiled, spec(), Watcher(1))
