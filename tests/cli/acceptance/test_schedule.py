"""The schedule of an acceptance test: reproducible, fair, and within the limits of supervisors and leases."""

from __future__ import annotations

from itertools import islice

from colony.cli.robot.acceptance.trial import (
    FREEZE_S,
    LEASE_FREEZE_S,
    MOST_FROZEN,
    SPARED_FREEZE_S,
    FaultStep,
    steps,
)
from colony.runtime.frames.clock import LEADER_LEASE_NS
from colony.runtime.transport.live.configuration import LINK_LEASE_MS

MORTAL = ("Clock", "DServer", "RServer", "clients")
LEADERS = ("Leader",)


def first(number: int, seed: int = 7) -> list[FaultStep]:
    return list(islice(steps(seed, MORTAL, LEADERS), number))


def test_a_seed_gives_one_schedule_whatever_the_order_of_the_processes() -> None:
    assert first(100) == list(islice(steps(7, MORTAL[::-1], LEADERS), 100))
    assert first(100) != first(100, seed=8)


def test_stops_deaths_and_freezes_take_turns_and_each_process_dies_once_in_a_round() -> None:
    found = first(3 * len(MORTAL))
    stops, kills, freezes = found[::3], found[1::3], found[2::3]
    assert all(step.hold_s is not None for step in stops)
    assert sorted(s.fault.processes[0] for s in kills if s.fault and s.fault.freeze_s is None) == [*MORTAL]
    assert all(step.fault and step.fault.freeze_s is not None for step in freezes)


def test_the_leader_is_never_killed_and_frozen_for_less_than_its_lease() -> None:
    faults = [step.fault for step in first(3000) if step.fault is not None]
    assert not any("Leader" in fault.processes for fault in faults if fault.freeze_s is None)
    frozen = [(fault.processes, fault.freeze_s) for fault in faults if fault.freeze_s is not None]
    longest = {
        spared: max(s for names, s in frozen if ("Leader" in names) is spared) for spared in (True, False)
    }
    assert longest[True] <= SPARED_FREEZE_S[1] < LEADER_LEASE_NS / 1e9
    assert FREEZE_S[1] < LINK_LEASE_MS / 1000 < longest[False] <= LEASE_FREEZE_S[1]
    assert {len(names) for names, _ in frozen} == {*range(1, MOST_FROZEN + 1)}


def test_a_robot_of_one_process_is_tested_as_well() -> None:
    found = list(islice(steps(1, ("Clock",)), 30))
    assert {name for step in found if step.fault for name in step.fault.processes} == {"Clock"}
