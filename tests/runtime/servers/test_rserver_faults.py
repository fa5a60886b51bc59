"""RServer under everything at once: people, programs and bytes that come and go in any order.

Whatever happens, one command a frame goes out, within the range, and none while the emergency stop is on; and
every frame of the run has one verdict.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import lru_cache
from typing import get_args

import msgspec
import pytest

from colony.runtime.library import emergency, robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.messages import Alive, Call, Fate, Malformed, Tick
from tests.kit.base import CLIENTS, RollingBase, Stage, bid, deployed
from tests.kit.node_stage import FRAME_NS

PEOPLE = tuple(f"op/{i}" for i in range(6))


class _Base(RollingBase):
    """Is told nothing while the emergency stop is on."""

    def __init__(self) -> None:
        super().__init__()
        self.stopped: Callable[[], bool] = lambda: False
        self.seen = 0

    def drive(self, velocity: float, turn: float) -> None:
        assert not self.stopped()
        super().drive(velocity, turn)

    def stop(self) -> None:
        self.seen += self.stopped()
        super().stop()


class Crowd:
    """Does something, chosen by chance."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.base = _Base()
        self.stage = Stage(self.base)
        self.base.stopped = lambda: self.stage.node._actuators.stopped is not None
        self.open: set[str] = set()

    def act(self) -> None:
        chance, stage = self.chance, self.stage
        who = chance.choice(PEOPLE)
        match chance.randrange(12):
            case 0 if who not in self.open:
                stage.open(who, priority=chance.choice((-1, 0, 1, 2, 4, 5, 9)))
                self.open.add(who)
            case 1 if who in self.open:
                self.open.remove(who)
                chance.choice((stage.close, stage.die))(who)
            case 2:
                stage.handle(self.nonsense(who))
            case 3:
                run = chance.choice(("r1", "r2"))
                stage.send(who, robot.deploy(deployed(run)))
            case 4:
                stage.handle(Malformed(topic="RServer/requests", connection=None, reason="bits"))
                stage.handle(Malformed(topic="RServer/call", connection=who, reason="bits"))
            case 5:
                stage.handle(Alive(connection=who))
            case 6:
                stage.base.front, stage.base.rear, stage.base.mute = (chance.random() < 0.1 for _ in range(3))
            case 7 if chance.random() < 0.05:
                stage.send(who, emergency.stop())
            case 8:
                stage.release()
            case _:
                stage.send(who, self.ask())

    def ask(self) -> CallRequest[object]:
        chance = self.chance
        number = chance.choice((0.0, 1.0, -50.0, 200.0, 1e9, float("nan"), float("inf")))
        return chance.choice(
            (
                robot.drive(number, chance.uniform(-60.0, 60.0), chance.choice((0.0, 0.1, 3.0))),
                robot.go(number),
                robot.jog(chance.uniform(-70.0, 70.0)),
                robot.move(number, chance.choice((-1.0, 0.0, 100.0, 900.0)), wait=chance.random() < 0.5),
                robot.turn(number),
                robot.continuous_turn(number, chance.choice((0.0, 300.0))),
                robot.stop(chance.randrange(2)),
                robot.lock(wait=chance.random() < 0.5, wait_s=chance.choice((0.1, 5.0))),
                robot.unlock(),
                robot.position(),
                robot.set_position(number, 0.0, 0.0),
                robot.adjust_position(1.0, number, 90.0),
                robot.set_bumper(chance.randrange(2)),
                robot.arbitration(),
            )
        )

    def nonsense(self, who: str) -> Call:
        chance = self.chance
        return Call(
            connection=who,
            number=chance.choice((-1, 0, 1, 2**60)),
            method=chance.choice(("open", "drive", "deploy", "lock", "", "emergency_stop?")),
            arguments=msgspec.Raw(chance.randbytes(chance.randrange(12))),
            priority=chance.choice((-(2**62), 2**62)),
            right=chance.choice(("read", "command", "stop")),
        )

    def frame(self) -> None:
        stage, chance = self.stage, self.chance
        if chance.random() < 0.9:
            stage.run = stage.node._actuators._state.run or ""  # the Clock goes with the leader, mostly
        stage.tick(lost=[f"drive/{c}" for c, _ in CLIENTS if chance.random() < 0.05])
        requests = [
            msgspec.structs.replace(request, k=stage.k + chance.choice((0, 0, 0, 0, 1, -1)))
            for client, _ in CLIENTS
            for request in (
                bid(client, bid=chance.choice(("inactive", "silent", "inhibited", "suppressed", "command"))),
                bid(client, chance.choice((100.0, -200.0, 1e6)), chance.uniform(-60.0, 60.0)),
            )
            if chance.random() < 0.6
        ]
        chance.shuffle(requests)
        for request in requests:
            stage.handle(request)
            if chance.random() < 0.3:
                self.act()
        stage.pass_time(chance.randrange(FRAME_NS))
        if chance.random() < 0.1:
            stage.handle(Tick(k=stage.k - chance.randrange(2), t_ns=0, run=stage.run))
        self.act()
        stage.until(stage.k * FRAME_NS + FRAME_NS - 1)


@lru_cache
def run(seed: int) -> Crowd:
    crowd = Crowd(seed)
    for _ in range(500):
        crowd.frame()
    return crowd


@pytest.mark.parametrize("seed", range(8))
def test_whatever_happens(seed: int) -> None:
    crowd = run(seed)
    by_frame: dict[int, int] = {}
    for t_ns, velocity, turn in crowd.stage.base.told:
        assert -600.0 <= velocity <= 600.0
        assert -90.0 <= turn <= 90.0
        by_frame[t_ns // FRAME_NS] = by_frame.get(t_ns // FRAME_NS, 0) + 1
    assert set(by_frame.values()) <= {1}
    assert crowd.base.seen > 0
    frames = [v.k for v in crowd.stage.verdicts]
    assert len(frames) == len(set(frames)) > 300


def test_all_of_it_happened() -> None:
    verdicts = [v for seed in range(8) for v in run(seed).stage.verdicts]
    assert {v.hold for v in verdicts} == {None, "stopped", "locked"}
    assert {v.outside for v in verdicts} == {None, *PEOPLE}
    assert {v.by for v in verdicts} == {None, *(client for client, _ in CLIENTS)}
    assert {fate for v in verdicts for _, fate in v.fates} == set(get_args(Fate))
