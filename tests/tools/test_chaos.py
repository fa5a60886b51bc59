"""The schedule of the soak: reproducible, with faults for every process, and deaths not too close."""

from __future__ import annotations

from itertools import pairwise

from colony.runtime.assembly.processes.restarts import STABLE_NS
from tools.chaos import FIRST_DEATH_S, FREEZE_S, schedule

SERVERS = {"Clock": 0.1, "RServer": 0.1}
CLIENTS = {"drive.a": 0.4, "drive.b": 0.4}


def test_a_seed_gives_one_schedule_whatever_its_length() -> None:
    long = schedule(7, SERVERS, CLIENTS, 600.0)
    assert schedule(7, SERVERS, CLIENTS, 100.0) == [fault for fault in long if fault.at_s < 100.0]
    assert schedule(8, SERVERS, CLIENTS, 600.0) != long


def test_every_server_dies_early_and_freezes_stay_within_their_limits() -> None:
    for seed in range(50):
        faults = schedule(seed, SERVERS, CLIENTS, 120.0)
        early = {f.name for f in faults if f.freeze_s is None and f.at_s <= FIRST_DEATH_S[1]}
        assert early >= set(SERVERS)
        assert all(FREEZE_S[0] <= f.freeze_s <= FREEZE_S[1] for f in faults if f.freeze_s is not None)


def test_nobody_dies_so_often_that_its_supervisor_gives_it_up() -> None:
    faults = schedule(1, SERVERS, CLIENTS, 36_000.0)
    for name in (*SERVERS, *CLIENTS):
        deaths = [f.at_s for f in faults if f.name == name and f.freeze_s is None]
        assert len(deaths) > 100
        assert min(b - a for a, b in pairwise(deaths)) > STABLE_NS / 1e9
