"""Figures of many runs."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from studies.figures import percentile, targets, wing_of
from studies.record import Contacts
from tests.studies.stage import REACHED, STUCK, result


def test_percentiles_lie_between_neighbors_in_proportion() -> None:
    assert percentile([3.0, 1.0, 2.0], 0.5) == 2.0
    assert percentile([0.0, 10.0], 0.95) == pytest.approx(9.5)
    assert percentile([4.0], 0.95) == 4.0
    assert math.isnan(percentile([], 0.5))


def test_targets_of_the_published_runs() -> None:
    slow = replace(result(30, 1), distance_mm=100_000.0, time_s=600.0)
    results = [*(result(1, seed) for seed in range(1, 20)), result(1, 20, STUCK), slow]
    found = {target.what: target for target in targets(results, published=True)}
    reached = found["runs that reached the goal"]
    assert reached.found.startswith("20 of 21, 95.2 %")
    assert not reached.met
    assert found["the worst of the runs"].found == "run 1: 19 of 20, 95.0 %"
    assert found["the worst of the runs"].met
    assert found["distance to the goal along the corridor, 95th percentile"].found == "0.020 m"
    assert found["distance to the goal as the crow flies, 95th percentile"].found == "0.025 m"
    assert found["mean speed, old wing"].met
    assert found["mean speed, old wing"].found.startswith("29.3 m/min")
    assert not found["mean speed, new wing"].met
    assert found["mean speed, new wing"].found.startswith("10.0 m/min")
    assert found["top speed of a run"].found == "0.50 to 0.50 m/s"
    assert found["top speed of a run"].met
    contacts = found["runs with a contact above 50 mm/s"]
    assert contacts.found == "1 (contacts in all: 3, the fastest at 220 mm/s)"
    assert not contacts.met


def test_soft_contacts_do_no_harm_and_lists_of_ones_own_have_no_wings() -> None:
    soft = replace(REACHED, contacts=Contacts(2, 50.0))
    found = targets([soft] * 19 + [STUCK], published=False)
    assert [target.met for target in found] == [True, True, True, True, False]
    assert [target.met for target in targets([soft], published=False)] == [True] * 5
    assert targets([], published=True) == ()


def test_where_no_run_reached_its_goal_nothing_is_met() -> None:
    found = {target.what: target for target in targets([result(1, 1, STUCK)], published=True)}
    assert found["mean speed, old wing"].found == "no run reached its goal"
    assert not found["mean speed, old wing"].met
    assert "mean speed, new wing" not in found
    assert not found["distance to the goal as the crow flies, 95th percentile"].met


def test_the_first_27_runs_are_of_the_old_wing() -> None:
    assert [wing_of(result(number, 1)) for number in (1, 27, 28, 40)] == ["old", "old", "new", "new"]
