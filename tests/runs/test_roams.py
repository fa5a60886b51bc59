"""Robots roam without contact, or get away from what they touch; `python -m tools.roams` runs more."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.sampling import sampled
from tools.roam_watch import Case, Roam
from tools.roams import FLOORS, ROBOTS, is_good, run

CASES = [
    Case(robot, behavior, floor, seed)
    for seed in (1, 2, 3)
    for floor in FLOORS
    for robot, behavior in ROBOTS.items()
]


@pytest.mark.parametrize(
    "case", sampled(CASES, every=len(CASES), thorough=True), ids=lambda case: "-".join(map(str, case))
)
def test_roams(case: Case) -> None:
    roam = run(case)
    assert is_good(roam), roam
    assert roam.way_mm > 3_000.0


@pytest.mark.long
@pytest.mark.parametrize(("robot", "behavior"), [("pioneer", "wander"), ("create2", "bounce")])
def test_roams_a_while(robot: str, behavior: str) -> None:
    roam = run(Case(robot, behavior, FLOORS[0], 1), duration_s=30.0)
    assert is_good(roam), roam
    assert roam.way_mm > 3_000.0


@pytest.mark.parametrize("seed", [2, 44])
def test_omni_sees_thin_posts_beside_its_way(seed: int) -> None:
    assert is_good(run(Case("omni", "wander", "office.yaml", seed), duration_s=5.0))


@pytest.mark.parametrize(("robot", "floor"), [("pioneer", "narrow.stickrep"), ("omni", "office.yaml")])
def test_wander_finds_its_way_out_of_a_circle(robot: str, floor: str) -> None:
    roam = run(Case(robot, "wander", floor, {"pioneer": 1, "omni": 38}[robot]))
    assert is_good(roam), roam


def test_rome_is_slow_toward_a_post_that_it_only_sees() -> None:
    assert is_good(run(Case("rome", "wander", "office.yaml", 20)))


def test_what_is_not_good() -> None:
    wander, bounce = (Roam(case=Case("rome", name, FLOORS[0], 1)) for name in ("wander", "bounce"))
    assert is_good(wander)
    assert is_good(replace(bounce, contacts=3))
    assert not is_good(replace(wander, contacts=1))
    assert not is_good(replace(wander, still_s=50.0))
    bad = ({"pushed_s": 0.5}, {"still_s": 50.0}, {"rams": 1}, {"fell": True})
    assert not any(is_good(replace(bounce, **one)) for one in bad)  # type: ignore[arg-type]
