"""Tunable params of a run: ticks have their values, for all nodes alike, as long as the run lasts."""

from __future__ import annotations

import pytest

from colony.ir.frame import Frame
from colony.runtime.frames.assembler import FrameAssembler
from colony.runtime.library import clock as library
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.bindings import SensorBinding
from colony.runtime.protocol.deployment import Tunable
from colony.runtime.protocol.messages import Progress, Ready, Tick
from tests.kit.clock import CLIENTS, Leader, Stage, deployed
from tests.kit.node_stage import MS, S, result_of

SPEED = Tunable(name="speed", unit="m/s", initial=0.3, low=0.1, high=0.6)
NEAR = Tunable(name="avoid.near", unit="mm", initial=500.0, low=400.0, high=900.0)


@pytest.fixture
def stage() -> Stage:
    return Stage()


@pytest.fixture
def leader(stage: Stage) -> Leader:
    leader = Leader(stage, "user/1")
    assert leader.deploy(deployed(tunables=(SPEED, NEAR))) is None
    stage.ready()
    return leader


def values(leader: Leader) -> dict[str, float]:
    call: CallRequest[tuple[library.TunedParam, ...]] = library.tunables()
    return {param.tunable.name: param.value for param in result_of(call, leader.ask(call))}


def tune(leader: Leader, **given: float | None) -> int:
    call = library.tune({name.replace("_", "."): value for name, value in given.items()})
    return result_of(call, leader.ask(call))


def test_a_change_is_in_the_next_tick_and_in_all_after_it(stage: Stage, leader: Leader) -> None:
    before = stage.ticks[-1]
    assert before.tuned == {}
    k = tune(leader, speed=0.2, avoid_near=900.0)
    assert k == before.k + 1
    stage.until(stage.now_ns + 200 * MS, alive=(leader,))
    assert all(t.tuned == {"speed": 0.2, "avoid.near": 900.0} for t in stage.ticks if t.k >= k)
    assert values(leader) == {"speed": 0.2, "avoid.near": 900.0}
    tune(leader, speed=None)
    assert stage.ticks[-1].tuned == {"avoid.near": 900.0}
    assert values(leader) == {"speed": 0.3, "avoid.near": 900.0}


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"speed": 0.7}, "`speed` cannot be 0.7: expected 0.1 .. 0.6 m/s"),
        ({"speed": float("nan")}, "`speed` cannot be nan: expected 0.1 .. 0.6 m/s"),
        ({"speed": 0.2, "sped": 1.0}, "no tunable param `sped`; its tunable params are speed, avoid.near"),
    ],
)
def test_a_refused_change_changes_nothing(leader: Leader, given: dict[str, float], reason: str) -> None:
    refused = leader.ask(library.tune(given)).problem
    assert refused is not None
    assert refused.code == "arguments"
    assert reason in refused.message
    assert values(leader) == {"speed": 0.3, "avoid.near": 500.0}


def test_without_a_program_there_is_none(stage: Stage) -> None:
    user = Leader(stage, "user/2")
    refused = user.ask(library.tune({"speed": 0.2})).problem
    assert refused is not None
    assert "the program has no tunable param `speed`; it has none" in refused.message
    assert values(user) == {}


def test_a_new_run_begins_with_its_own_values(stage: Stage, leader: Leader) -> None:
    tune(leader, speed=0.2)
    assert leader.deploy(deployed("run", tunables=(SPEED, NEAR))) is None  # the same once more
    assert values(leader)["speed"] == 0.2
    leader.close()
    again = Leader(stage, "user/3")
    assert again.deploy(deployed("second", tunables=(SPEED,))) is None
    assert values(again) == {"speed": 0.3}


def test_a_clock_that_is_started_again_goes_on_with_the_values() -> None:
    stage = Stage(now_ns=10 * S)
    leader = Leader(stage, "user/1")
    assert leader.deploy(deployed(tunables=(SPEED,))) is None
    last = Tick(k=50_000, t_ns=9 * S, start=49_000, run="run", tuned={"speed": 0.25})
    progress = Progress(start=49_000, stepped=50_000, ticks=(last,))
    stage.handle(*(Ready(client=c, run="run", progress=progress) for c in CLIENTS))
    stage.pass_time(100 * MS)
    assert (stage.ticks[-1].start, stage.ticks[-1].tuned) == (49_000, {"speed": 0.25})
    assert values(leader) == {"speed": 0.25}


def test_a_change_before_a_run_goes_on_is_not_undone_by_the_values_before() -> None:
    stage = Stage(now_ns=10 * S)
    leader = Leader(stage, "user/1")
    assert leader.deploy(deployed(tunables=(SPEED, NEAR))) is None
    leader.begin(library.tune({"speed": None, "avoid.near": 700.0}))
    last = Tick(k=50_000, t_ns=9 * S, start=49_000, run="run", tuned={"speed": 0.25, "avoid.near": 450.0})
    progress = Progress(start=49_000, stepped=50_000, ticks=(last,))
    stage.handle(*(Ready(client=c, run="run", progress=progress) for c in CLIENTS))
    stage.pass_time(100 * MS)
    assert stage.ticks[-1].start == 49_000
    assert values(leader) == {"speed": 0.3, "avoid.near": 700.0}


@pytest.mark.parametrize(("declared", "value"), [(True, 0.2), (False, 200.0)])
def test_nodes_read_the_values_from_ticks(declared: bool, value: float) -> None:
    binding = SensorBinding(
        sensor="speed", server="Clock", field="speed", max_age_ns=None, factor=1000.0, declared=True
    )
    assembler = FrameAssembler((binding,), frames_kept=4, declared_units=declared)
    frames: list[Frame] = []
    for k, tuned in enumerate(({}, {"speed": 0.2}, {"other": 1.0})):
        assembler.take(Tick(k=k, t_ns=k * 50 * MS, tuned=tuned))
        frames += [a.frame for a in assembler.pop_complete()]
    assert [frame.readings for frame in frames] == [{}, {"speed": value}, {}]
