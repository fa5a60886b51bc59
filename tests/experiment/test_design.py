"""What varies in an experiment is drawn from the seed of each run alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from colony.experiment.design import Experiment, ProgramChoice, SweptRange, range_of
from colony.nav.maps.world_map import load_world
from colony.runs.spec import RunSpec
from colony.sim.world_spec import WorldSpec
from tests.paths import MAPS

LOOP = load_world(MAPS / "loop.stickrep")
ONE = ProgramChoice("one", "one.colony", None, None)
OTHER = ProgramChoice("other", "other.colony", None, None)
SPEC = RunSpec(file="one.colony", world=WorldSpec(map_path="loop", seed=5), length_ns=1)
PLAIN = Experiment(
    name="e",
    programs=(ONE, OTHER),
    spec=SPEC,
    runs=4,
    varies_start=True,
    movers=SweptRange(0, 5, "", True),
    params=(("clearance", SweptRange(0.6, 1.4, "m", False)),),
    audit=0.5,
    digest="",
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.6..1.4m", SweptRange(0.6, 1.4, "m", False)),
        ("600 mm .. 700 mm", SweptRange(600, 700, "mm", False)),
        ("0..5", SweptRange(0, 5, "", True)),
        ("0.0..5", SweptRange(0, 5, "", False)),
        ("-1e-3..2.5deg/s", SweptRange(-0.001, 2.5, "deg/s", False)),
        ("-30deg..30deg", SweptRange(-30, 30, "deg", False)),
    ],
)
def test_range_text_is_read(text: str, expected: SweptRange) -> None:
    assert range_of(text) == expected


@pytest.mark.parametrize(
    "text", ["", "5", "1..", "..1", "2..1", "1..1", "1 m..2 s", "a..b", "nan..1", "1..1e999", "-1e308..1e308"]
)
def test_range_text_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected"):
        range_of(text)


def test_trials_of_two_programs_have_the_same_inputs() -> None:
    trials = PLAIN.trials(LOOP, 300.0, range(1, 5))
    assert [(t.key.number, t.key.seed, t.key.variant) for t in trials[:3]] == [
        (1, 5, "one"),
        (1, 5, "other"),
        (2, 6, "one"),
    ]
    for first, second in zip(trials[::2], trials[1::2], strict=True):
        assert first.spec == second.spec
        assert first.params == second.params
    assert len({t.spec.world.start for t in trials}) == 4


def test_trial_does_not_depend_on_the_others() -> None:
    assert PLAIN.trials(LOOP, 300.0, [3]) == PLAIN.trials(LOOP, 300.0, range(1, 5))[4:6]


def test_further_input_leaves_the_others() -> None:
    fewer = replace(PLAIN, params=(), movers=None)
    for trial, one in zip(PLAIN.trials(LOOP, 300.0, [1, 2]), fewer.trials(LOOP, 300.0, [1, 2]), strict=True):
        assert trial.spec.world.start == one.spec.world.start


def test_drawn_values_are_in_their_ranges() -> None:
    trials = replace(PLAIN, varies_start=False, runs=200).trials(LOOP, 300.0, range(1, 201))
    values = [dict(t.drawn)["clearance"] for t in trials]
    assert min(values) < 0.65 < 1.35 < max(values)
    assert all(0.6 <= value <= 1.4 for value in values)
    assert {t.spec.world.movers for t in trials} == set(range(6))
    assert all(t.params[0][1] == f"{t.drawn[0][1]:g} m" for t in trials)


@pytest.mark.parametrize(
    "text",
    ["1000.2..1000.4mm", "10001..10004mm", "1234567..1234568.5mm", "-1000.04..-1000.01", "1e-7..2e-7m"],
)
def test_drawn_values_of_a_narrow_range_are_in_it_and_differ(text: str) -> None:
    values, rng = range_of(text), np.random.default_rng(1)
    drawn = [values.draw(rng) for _ in range(20)]
    assert all(values.low <= value <= values.high for value in drawn)
    assert len({values.text(value) for value in drawn}) > 3
    assert all(float(values.text(value).split()[0]) == value for value in drawn)


def test_hazards_have_the_seed_of_the_run() -> None:
    experiment = replace(PLAIN, spec=SPEC.with_world(hazards=0), varies_start=False)
    assert [t.spec.world.hazards for t in experiment.trials(LOOP, 300.0, [1, 2])] == [5, 5, 6, 6]


@pytest.mark.parametrize(
    "change",
    [{"digest": "x"}, {"varies_start": False}, {"movers": None}, {"params": ()}],
)
def test_fingerprint_of_another_experiment_differs(change: dict[str, object]) -> None:
    assert replace(PLAIN, **change).fingerprint() != PLAIN.fingerprint()  # type: ignore[arg-type]


def test_fingerprint_does_not_depend_on_how_many_runs_there_are() -> None:
    assert replace(PLAIN, runs=9).fingerprint() == PLAIN.fingerprint()
