"""An announcer tells the activity of every frame once, and again to who asks; without its memory it asks
for a new epoch."""

from __future__ import annotations

from colony.ir.frame import Answer, Frame
from colony.runtime.clients.client import Announcer
from colony.runtime.frames.assembler import FrameAssembler
from colony.runtime.protocol.messages import Announcement, Fetch, Ready, Restart, SendMessage, Tick
from tests.kit.node_stage import sent

ADDRESS = "DServer/activity/pulse"
KEEP = 4


class Third:
    """Commands in every third step."""

    def __init__(self) -> None:
        self.steps = 0

    def step(self, frame: Frame) -> Answer:
        self.steps += 1
        return Answer((50.0,) if self.steps % 3 == 0 else None)

    def restart(self) -> None:
        self.steps = 0


def announcer() -> Announcer:
    return Announcer(
        "pulse", FrameAssembler((), run="run", frames_kept=KEEP), Third(), run="run", frames_kept=KEEP
    )


def tick(k: int, start: int = 0) -> Tick:
    return Tick(k=k, t_ns=k, start=start, run="run")


def told(k: int, active: bool) -> Announcement:
    return Announcement(k=k, module="pulse", answer=Answer((50.0,) if active else None))


def test_every_frame_is_told_once_also_those_that_it_is_late_for() -> None:
    node = announcer()
    assert list(node.start(0)) == [SendMessage("Clock/ready", Ready(client=ADDRESS, run="run"))]
    assert sent(node, tick(0), tick(0)) == [told(0, False)]
    assert sent(node, tick(2)) == [Fetch(server="Clock", k=1)]
    assert sent(node, tick(1)) == [told(1, False), told(2, True)]


def test_what_it_told_is_told_again_to_who_asks() -> None:
    node = announcer()
    sent(node, *(tick(k) for k in range(6)))
    assert sent(node, Fetch(server=ADDRESS, k=5)) == [told(5, True)]
    assert sent(node, Fetch(server=ADDRESS, k=1)) == []
    assert sent(node, Fetch(server="DServer", k=5)) == []


def test_with_an_epoch_its_object_is_built_anew() -> None:
    node = announcer()
    sent(node, tick(0), tick(1))
    assert sent(node, *(tick(k, start=2) for k in (2, 3, 4))) == [
        told(2, False),
        told(3, False),
        told(4, True),
    ]


def test_one_that_comes_too_late_asks_for_a_new_epoch() -> None:
    node = announcer()
    assert sent(node, tick(KEEP)) == [Restart(client=ADDRESS, start=0)]
    assert sent(node, tick(KEEP + 1)) == [Restart(client=ADDRESS, start=0)]
    young = announcer()
    assert sent(young, tick(KEEP - 1)) == [Fetch(server="Clock", k=k) for k in range(KEEP - 1)]
