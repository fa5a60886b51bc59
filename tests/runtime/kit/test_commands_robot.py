"""A program that drives a lift of its own server: a whole robot in virtual time."""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from colony.runtime.library import clock as clock_library
from colony.runtime.library import emergency
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Message
from colony.runtime.transport.faults import FaultRates, Faults
from tests.kit.calling import opening
from tests.kit.lift import DOWN, IDLE, UP, Robot
from tests.kit.node_stage import FRAME_NS
from tests.sampling import sampled


def test_a_program_drives_a_lift() -> None:
    robot = Robot()
    robot.run(12)
    assert [robot.told[k] for k in range(1, 10)] == [*[UP] * 5, DOWN, UP, DOWN, UP]
    assert [frame.verdicts["lift"].values for frame in robot.log.frames[1:10]] == [
        robot.told[k] for k in range(1, 10)
    ]
    assert not any(frame.disagreements for frame in robot.log.frames)
    assert robot.reports == []


def test_a_lift_whose_client_dies_is_idle() -> None:
    robot = Robot()
    [clients] = set(robot.robot.processes) - {"Clock", "DServer", "Lift"}
    robot.at(3, lambda: robot.robot.kill(clients))
    robot.run(12)
    assert [robot.told[k] for k in range(1, 4)] == [UP] * 3
    assert [robot.told[k] for k in range(4, 12)] == [IDLE] * 8
    assert not any(frame.disagreements for frame in robot.log.frames)


@pytest.mark.parametrize("server", ["Lift", "Clock"])
def test_a_stop_at_any_server_holds_for_the_lift_until_the_clock_releases_it(server: str) -> None:
    robot = Robot()
    robot.at(3, lambda: robot.call(server, emergency.stop()))
    robot.at(8, lambda: robot.call("Clock", opening("eve"), "eve/2"))
    robot.at(9, lambda: robot.call("Clock", clock_library.release(), "eve/2", 2))
    robot.run(14)
    assert [robot.told[k] for k in range(4, 10)] == [IDLE] * 6
    assert robot.told[11] == UP
    holds = [frame.verdicts["lift"].hold for frame in robot.log.frames[1:]]
    assert holds[4:9] == ["stopped"] * 5
    assert holds[10] is None
    assert not any(frame.disagreements for frame in robot.log.frames)


def test_a_stop_survives_the_death_of_the_lift_and_of_the_clock() -> None:
    for killed in ("Lift", "Clock"):
        robot = Robot()
        robot.at(3, lambda robot=robot: robot.call("Lift", emergency.stop()))  # type: ignore[misc]
        robot.at(6, lambda robot=robot, killed=killed: robot.robot.restart(killed))  # type: ignore[misc]
        robot.at(7, robot.deploy)
        robot.run(20)
        assert {robot.told.get(k, IDLE) for k in range(4, 20)} == {IDLE}


def test_a_lift_that_comes_back_is_driven_again_once_the_program_is_deployed() -> None:
    robot = Robot()
    robot.at(3, lambda: robot.robot.restart("Lift"))
    robot.at(6, robot.deploy)
    robot.run(30)
    assert [k for k in range(4, 7) if k in robot.told] == []
    assert {robot.told[k] for k in range(8, 12)} <= {UP, DOWN, IDLE}
    assert {robot.told[k] for k in range(20, 30)} <= {UP, DOWN}
    assert not any(frame.disagreements for frame in robot.log.frames)


def test_a_clock_that_dies_leaves_the_lift_idle() -> None:
    robot = Robot()
    robot.at(3, lambda: robot.robot.kill("Clock"))
    robot.run(12)
    assert max(robot.told) == 5
    assert robot.told[5] == IDLE


# --- a lift of our own under faults from a seed ---


FAULTY, QUIET, RIGHT = 40, 80, 20
"""Frames with faults; frames after them, more than the 2 s for which frames are asked for again; and the last
of these, in which all must be right."""


class Faulty(Robot):
    """A robot that has faults until frame `FAULTY`. Mutable: what happened."""

    def __init__(self, seed: int) -> None:
        self._faults = Faults(seed, FaultRates(), exempt=self._is_exempt)
        super().__init__(self._faults, seed=seed)
        self.happened: Counter[str] = Counter()
        random = Random(seed)
        processes = [name for name in self.robot.processes if name != "DServer"]
        for _ in range(random.randrange(4)):
            k, process = random.randrange(1, FAULTY - 10), random.choice(processes)
            what = random.choice(("kill", "freeze"))
            self.happened[f"{what} {'client' if process not in ('Clock', 'Lift') else process}"] += 1
            self.at(k, lambda what=what, process=process: getattr(self.robot, what)(process))  # type: ignore[misc]
            back = k + random.randrange(1, 9)
            self.at(back, lambda process=process: self.robot.revive(process))  # type: ignore[misc]
        for k in range(3, FAULTY + 10, 3):  # the leader sees to it
            self.at(k, self.deploy)

    def _is_exempt(self, sender: str, receiver: str, message: Message) -> bool:
        return receiver == topics.OBSERVER or self.clock() >= FAULTY * FRAME_NS


def _check(seed: int) -> Counter[str]:
    robot = Faulty(seed)
    robot.run(FAULTY + QUIET)
    decided = {log.frame.t_ns: log.verdicts.get("lift") for log in robot.log.frames}
    assert not [log.disagreements for log in robot.log.frames if log.disagreements]
    moved: set[int] = set()
    for t_ns, values in robot.all_told:
        if values == IDLE:
            continue
        frame_ns = max(begun for begun in decided if begun <= t_ns)
        verdict = decided[frame_ns]
        if verdict is None:  # a server that was killed says nothing any more
            assert robot.happened["kill Lift"], f"no verdict at {t_ns}"
        else:
            assert verdict.values == values, f"told {values} at {t_ns}, but {verdict} was decided"
        assert frame_ns not in moved, f"told twice in the frame of {frame_ns}"
        moved.add(frame_ns)
    end = [values for t_ns, values in robot.all_told if t_ns >= (FAULTY + QUIET - RIGHT) * FRAME_NS]
    assert len(end) >= RIGHT - 1
    assert IDLE not in end, "all is well again"
    assert robot.reports == []
    return robot.happened


@pytest.mark.parametrize("seed", sampled(tuple(range(200)), every=8, thorough=True))
def test_a_lift_is_told_what_was_decided_or_is_idle(seed: int) -> None:
    _check(seed)
