"""Whole runs in the fast loop: reached, failed in each way, audited, and the same wherever they are done."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from colony.experiment.parallel import PoolEngine, SerialEngine
from colony.experiment.results import Results, RunKey
from colony.ir.frame import Decision, Frame, Outcome
from colony.nav.pose.tracker import EVERY_SOURCE, PoseSource
from colony.runs.behavior import behavior_of
from colony.runs.navigation import SIDE_CAMERA
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.library import robot
from colony.sim.hazards.hazards import Hazard, Hazards
from colony.verify.reference.interpreter import Interpreter
from studies import auditing
from studies.auditing import audit, is_audited
from studies.conduct import Experiment, conduct, conduct_audit, results_of
from studies.lists import PUBLISHED_MAP, ListedRun, published_list
from studies.record import RUN_TABLE, LightCount, ModeCount, RunResult
from studies.runs import Run, StudyRun, run, seed_of
from studies.variants import OURS, VARIANTS, MakeScripts


def _spec(number: int = 29, seed: int = 1, hazards: Hazards | None = None) -> StudyRun:
    listed = published_list()[number - 1]
    return StudyRun(
        key=RunKey("thesis", number, seed, "ours"),
        map_path=PUBLISHED_MAP,
        origin=listed.origin,
        goal=listed.goal,
        hazards=Hazards.none() if hazards is None else hazards,
    )


SHORT = (
    ListedRun(number=1, origin="A342L", goal="A340R"),
    ListedRun(number=2, origin="A339L", goal="A338R"),
)


def _short() -> StudyRun:
    run = SHORT[0]
    return replace(_spec(), key=RunKey("short", run.number, 1, "ours"), origin=run.origin, goal=run.goal)


@pytest.fixture(scope="module")
def quiet() -> RunResult:
    """The shortest of the published runs, in a building in which nothing goes wrong."""
    return run(_spec())


def test_a_run_around_a_corner_in_a_quiet_building(quiet: RunResult) -> None:
    assert quiet.reached
    assert quiet.goal_error_mm < 100.0
    assert abs(quiet.overshoot_mm) <= quiet.goal_error_mm
    assert quiet.distance_mm == pytest.approx(15_113.0, abs=1.0)
    assert quiet.mode_counts == (ModeCount(1, 1, 1), ModeCount(1, 1, 1), ModeCount(1, 1, 1))
    assert (quiet.planned_modes, quiet.completed, quiet.failed_mode) == ("lcd", 3, "")
    assert quiet.lights == LightCount(2, 0, 0)
    assert quiet.contacts == (0, 0.0)
    assert quiet.top_mm_s <= 510.0
    assert 100.0 < quiet.mean_mm_s < 500.0
    assert quiet.hazards == ""
    steps = [math.dist(a, b) for a, b in zip(quiet.path, quiet.path[1:], strict=False)]
    assert sum(steps) == pytest.approx(quiet.travelled_mm, rel=0.05)
    assert max(steps) < 520.0


@pytest.mark.thorough
def test_a_run_is_the_same_again_and_another_with_another_seed(quiet: RunResult) -> None:
    assert run(_spec()) == quiet
    assert run(_spec(seed=2)).path != quiet.path
    chances = {
        seed_of(RunKey("thesis", number, seed, "ours")) for number in range(1, 41) for seed in range(1, 26)
    }
    assert len(chances) == 1000
    assert seed_of(RunKey("a", 3, 4, "ours")) == seed_of(RunKey("a", 3, 4, "thesis"))


def test_hazards_on_the_way_are_told() -> None:
    dark = Hazards(light_out=1.0, light_dim=0.0, open_door=1.0).only(Hazard.LIGHTS, Hazard.DOORS)
    told = Run(_spec(hazards=dark)).result().hazards
    assert "lights out: " in told
    assert "doors open: " in told
    assert "people" not in told


def test_overshoots_are_compensated_in_the_later_ones_of_the_published_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told: list[bool] = []

    def scripts(*rest: object, compensate: bool, **more: object) -> Mapping[str, Script]:
        told.append(compensate)
        return {}

    _drive_by(monkeypatch, scripts)
    for number in (26, 27):  # of December 21 and January 5
        Run(_spec(number)).close()
    Run(_short()).close()  # of no date
    assert told == [False, True, True]


# --- failures ---------------------------------------------------------------------------------------------


def _drive_by(monkeypatch: pytest.MonkeyPatch, scripts: MakeScripts) -> None:
    """Let our variant have other scripts."""
    monkeypatch.setitem(VARIANTS, OURS.name, replace(OURS, scripts=scripts))  # type: ignore[arg-type]


def _with_scripts(monkeypatch: pytest.MonkeyPatch, **others: Script) -> None:
    """Let some of the scripts be others."""
    _drive_by(monkeypatch, lambda *args, **more: {**OURS.scripts(*args, **more), **others})


def _idle() -> Script:
    while True:
        yield from sleep(1.0)


@pytest.mark.thorough
def test_a_robot_that_nobody_sends_anywhere_is_stuck(monkeypatch: pytest.MonkeyPatch) -> None:
    _with_scripts(monkeypatch, planner=_idle())
    found = run(_spec())
    assert (found.failure, found.failed_mode, found.completed) == ("stuck", "L", 0)
    assert found.time_s == pytest.approx(60.0, abs=0.1)
    assert found.mode_counts[0] == ModeCount(0, 0, 1)
    assert not found.reached


def test_a_planner_that_ends_too_soon_leaves_the_robot_astray(monkeypatch: pytest.MonkeyPatch) -> None:
    def hasty() -> Script:
        yield from sleep(1.0)

    _with_scripts(monkeypatch, planner=hasty())
    found = run(_spec())
    assert found.failure == "astray"
    assert found.goal_error_mm > 10_000.0


@pytest.mark.thorough
def test_a_robot_whose_position_keeps_being_moved_takes_too_long(monkeypatch: pytest.MonkeyPatch) -> None:
    def backward() -> Script:
        while True:
            yield from sleep(0.05)
            where = yield from do("RServer", robot.position())
            yield from do("RServer", robot.set_position(where.x, 100_000.0, where.heading))

    _with_scripts(monkeypatch, mapper=backward())
    spec = _spec()
    found = run(spec)
    assert not found.reached
    assert found.failure in ("too long", "stuck", "astray")
    assert found.time_s <= 3.0 * Run(spec).expected_s + 0.1


def test_a_script_that_raises_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def bad() -> Script:
        yield from sleep(5.0)
        raise LookupError("no such light")

    _with_scripts(monkeypatch, tracker=bad())
    found = run(_spec())
    assert (found.failure, found.failed_mode) == ("script", "L")
    assert found.remark == "the script `tracker` raised LookupError: no such light"


# --- audits -----------------------------------------------------------------------------------------------


@pytest.mark.thorough
def test_the_interpreter_decides_alike_in_every_frame() -> None:
    found, driven = audit(_short()), run(_short())
    assert found.difference == ""
    assert found.frames == round(driven.time_s / 0.05) > 60


def test_an_audit_finds_the_first_frame_that_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    class Other(Interpreter):
        def step(self, frame: Frame, lost: frozenset[str] = frozenset()) -> Outcome:
            outcome = super().step(frame, lost)
            if frame.t_ns < 1_000_000_000:
                return outcome
            return outcome._replace(decisions=(Decision("drive", None, (0.0, 0.0)), *outcome.decisions[1:]))

    monkeypatch.setattr(auditing, "Interpreter", Other)
    found = audit(_short())
    assert found.frames == 20
    assert found.difference.startswith("run 1, seed 1, frame at 1.00 s: expected ")


def test_a_part_of_the_runs_is_audited_always_the_same() -> None:
    specs = [_spec(number, seed) for number in range(1, 41) for seed in range(1, 26)]
    some = [spec for spec in specs if is_audited(spec, 0.05)]
    assert 20 <= len(some) <= 80
    assert len({spec.key.number for spec in some}) > 15
    assert all(is_audited(spec, 1.0) for spec in specs)
    assert not any(is_audited(spec, 0.0) for spec in specs)


# --- experiments ------------------------------------------------------------------------------------------


def _experiment(seeds: int = 2) -> Experiment:
    return Experiment(
        name="short",
        map_path=PUBLISHED_MAP,
        runs=SHORT,
        seeds=tuple(range(1, seeds + 1)),
        variant="ours",
        hazards=Hazards().without(Hazard.PEOPLE),
    )


@pytest.mark.thorough
def test_results_do_not_depend_on_where_the_work_is_done(tmp_path: Path) -> None:
    asked = _experiment()
    assert asked.label == "ours/no-people"
    found = []
    for engine in (SerialEngine(), PoolEngine(2)):
        with Results(None, RUN_TABLE) as results:
            conduct(asked, run, results, engine)
            found.append(results_of(asked, results))
    assert found[0] == found[1]
    assert [one.key.number for one in found[0]] == [1, 1, 2, 2]


def test_what_is_there_is_not_run_again(tmp_path: Path) -> None:
    path, asked, told = tmp_path / "r.sqlite", _experiment(1), []
    with Results(path, RUN_TABLE) as results:
        conduct(asked, run, results, SerialEngine(), on_progress=lambda *args: told.append(args[:2]))
    more = replace(asked, seeds=(1, 2))
    with Results(path, RUN_TABLE) as results:
        conduct(more, run, results, SerialEngine(), on_progress=lambda *args: told.append(args[:2]))
        assert len(results_of(more, results)) == 4
        assert len(results_of(asked, results)) == 2
    assert told == [(1, 2), (2, 2), (3, 4), (4, 4)]


@pytest.mark.thorough
def test_an_audit_of_an_experiment_is_of_one_run_at_least() -> None:
    [one] = conduct_audit(_experiment(1), SerialEngine(), 0.000001)
    assert (one.key.number, one.difference) == (1, "")


def test_all_hazards_off_has_a_short_name() -> None:
    assert replace(_experiment(), hazards=Hazards.none()).label == "ours/no-hazards"
    assert replace(_experiment(), hazards=Hazards()).label == "ours"
    seeing = replace(
        _experiment(), sources=EVERY_SOURCE - {PoseSource.LIGHTS}, cameras=frozenset({SIDE_CAMERA})
    )
    assert seeing.label == "ours/no-people,no-lights,side-camera"
    assert {spec.key.variant for spec in seeing.specs()} == {seeing.label}
    assert all((spec.sources, spec.cameras) == (seeing.sources, seeing.cameras) for spec in seeing.specs())


def test_a_behavior_is_compiled_once_and_each_executor_begins_anew() -> None:
    behavior = behavior_of(OURS.behavior)
    assert behavior_of(OURS.behavior) is behavior
    one, other = behavior.executor(), behavior.executor()
    frame = Frame(0, {})
    assert one.step(frame) == other.step(frame)
    assert one.program is not other.program
