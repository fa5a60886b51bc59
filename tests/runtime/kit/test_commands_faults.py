"""A lift of our own under faults from a seed: whatever dies, freezes or gets lost, the lift is told once what
the program decided in a frame, or the idle command; and all comes right again."""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest

from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Message
from colony.runtime.transport.faults import FaultRates, Faults
from tests.kit.lift import IDLE, Robot
from tests.kit.node_stage import FRAME_NS
from tests.sampling import sampled

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
