"""The observer hands every frame on once, with its verdicts, and says where memory began anew or was lost."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from colony.ir.frame import Answer, Decision, Frame, Outcome
from colony.ir.memory import ProgramMemory
from colony.runtime.frames.assembler import FRAME_RETENTION_NS, FrameAssembler
from colony.runtime.observe.observer import Monitor, Observer
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import SensorBinding
from colony.runtime.protocol.messages import (
    Effect,
    Fate,
    Message,
    Request,
    Restart,
    Sample,
    SendMessage,
    ServerFrame,
    Tick,
    Verdict,
)
from tests.runtime.scripted import Log

KEEP = 4
NOTHING_READ: Mapping[tuple[str, str], frozenset[str]] = {}


class Counting:
    """Decides for the number of frames since its memory began."""

    def __init__(self) -> None:
        self.frames = 0

    @property
    def memory(self) -> ProgramMemory:
        return ProgramMemory(first_ns=0, cells={"state n": self.frames})

    def step(self, frame: Frame, answers: Mapping[str, Answer]) -> Outcome:
        self.frames += 1
        return Outcome((Decision("drive", "go", (float(self.frames),)),))

    def restart(self) -> None:
        self.frames = 0


SONAR = SensorBinding(sensor="sonar", server="P", field="sonar", max_age_ns=None, factor=1.0)


class Stage:
    def __init__(
        self,
        request_servers: tuple[str, ...] = (),
        sensors: tuple[SensorBinding, ...] = (),
        servers_read: Mapping[tuple[str, str], frozenset[str]] = NOTHING_READ,
    ) -> None:
        self.log = Log()
        self.sent: list[Effect] = []
        assembler = FrameAssembler(sensors, run="run", frames_kept=KEEP)
        self.observer = Observer(
            assembler,
            ("drive",),
            Monitor(Counting()),
            (self.log,),
            request_servers,
            servers_read=servers_read,
        )

    def take(self, *messages: Message, now_ns: int = 0) -> None:
        for message in messages:
            self.sent += self.observer.handle(message, now_ns)

    def frame(self, k: int, n: float, start: int = 0) -> None:
        """A frame, and a verdict for one that is the n-th since memory began."""
        self.take(tick(k, start), verdict(k, n))


@pytest.fixture
def stage() -> Stage:
    return Stage()


def tick(k: int, start: int = 0, run: str = "run") -> Tick:
    return Tick(k=k, t_ns=k, start=start, run=run)


def verdict(k: int, n: float) -> Verdict:
    return Verdict(k=k, t_ns=k, actuator="drive", by="go", values=(n,), fates=(("go", "won"),))


def test_frames_wait_for_their_verdicts_in_order(stage: Stage) -> None:
    stage.take(verdict(1, 2.0), tick(0), tick(1))
    assert stage.log.frames == []
    stage.take(verdict(0, 1.0))
    assert [(f.tick.k, f.disagreements, f.restart) for f in stage.log.frames] == [
        (0, (), False),
        (1, (), False),
    ]


def test_a_frame_without_verdict_is_handed_on_in_the_end(stage: Stage) -> None:
    stage.take(tick(0), now_ns=5)
    stage.take(tick(1), now_ns=5 + FRAME_RETENTION_NS)
    assert stage.log.frames == []
    stage.take(verdict(1, 2.0), now_ns=6 + FRAME_RETENTION_NS)
    assert [(f.tick.k, len(f.verdicts)) for f in stage.log.frames] == [(0, 0), (1, 1)]


def test_with_an_epoch_the_monitor_begins_anew(stage: Stage) -> None:
    for k, n, start in ((0, 1.0, 0), (1, 2.0, 0), (2, 1.0, 2), (3, 2.0, 2)):
        stage.frame(k, n, start)
    assert [f.restart for f in stage.log.frames] == [False, False, True, False]
    assert not any(f.disagreements for f in stage.log.frames)


def test_what_was_missed_for_good_is_said_and_nothing_is_expected_until_the_next_epoch(stage: Stage) -> None:
    stage.frame(0, 1.0)
    stage.frame(9, 99.0)
    stage.frame(10, 99.0)
    stage.frame(11, 1.0, start=11)
    assert [(f.tick.k, f.skipped, f.restart, len(f.expected.decisions)) for f in stage.log.frames] == [
        (0, 0, False, 1),
        (9, 8, False, 0),
        (10, 0, False, 0),
        (11, 0, True, 1),
    ]
    assert not any(f.disagreements for f in stage.log.frames)


def test_one_that_comes_in_the_middle_expects_nothing(stage: Stage) -> None:
    stage.frame(9, 99.0)
    assert [(f.skipped, f.restart, f.expected.decisions) for f in stage.log.frames] == [(9, False, ())]


def test_requests_come_with_their_frame() -> None:
    stage = Stage(("RServer",))
    request = Request(k=0, actuator="drive", client="go", bid="command", values=(1.0,))
    stage.take(tick(0), verdict(0, 1.0))
    assert stage.log.frames == []
    stage.take(request, request)
    assert stage.log.frames[0].requests == (request,)
    stage.take(tick(1), verdict(1, 2.0), tick(2))
    assert stage.log.frames[1].requests == ()
    assert "RServer/requests" in stage.observer.listens


def test_what_is_of_other_runs_is_no_frame_and_does_not_pile_up(stage: Stage) -> None:
    for k in range(50_000):
        stage.take(verdict(k, 1.0))
    stage.take(tick(50_000, start=50_000, run="another"))
    assert stage.log.frames == []
    assert len(stage.observer._verdicts) <= 20_000
    stage.frame(50_001, 1.0, start=50_001)
    assert [f.tick.k for f in stage.log.frames] == [50_001]
    assert stage.observer._verdicts == {}


def test_who_stepped_over_a_frame_that_nobody_else_got_asks_for_a_new_epoch() -> None:
    """The server died between two readers: the Clock never heard its frame 1, and says so in tick 2."""
    stage = Stage(sensors=(SONAR,))
    for k in range(2):
        sonar = ServerFrame(server="P", k=k, fields={"sonar": Sample(1.0, k)})
        stage.take(tick(k), sonar, verdict(k, k + 1.0))
    assert stage.sent == []
    void = Tick(k=2, t_ns=2, run="run", down=("P",), void=(("P", 1),))
    restart = SendMessage(topics.RESTARTS, Restart(client="Observer", start=0))
    stage.take(void, verdict(2, 3.0))
    stage.take(Tick(k=3, t_ns=3, run="run", down=("P",)), verdict(3, 4.0))
    assert [effect for effect in stage.sent if effect == restart] == [restart, restart]
    stage.take(Tick(k=4, t_ns=4, start=4, run="run", down=("P",)), verdict(4, 1.0))
    assert [effect for effect in stage.sent if effect == restart] == [restart, restart]
    assert [(f.tick.k, f.memory_unknown) for f in stage.log.frames] == [
        (0, False),
        (1, False),
        (2, True),
        (3, True),
        (4, False),
    ]


def test_who_missed_frames_does_not_make_everybody_begin_anew(stage: Stage) -> None:
    stage.frame(0, 1.0)
    stage.frame(9, 99.0)
    stage.frame(10, 99.0)
    assert not any(isinstance(e, SendMessage) and isinstance(e.message, Restart) for e in stage.sent)


BUMPER = SensorBinding(sensor="bumper", server="R", field="bumper", max_age_ns=None, factor=1.0)
VOID = Tick(k=2, t_ns=2, run="run", down=("P", "R"), void=(("P", 1), ("R", 1)))


@pytest.mark.parametrize(
    ("arrived", "fate", "disputed"),
    [
        (("P",), "won", True),
        (("P",), "late", True),
        ((), "won", True),
        ((), "late", False),
    ],
)
def test_a_frame_is_disputed_if_it_became_void_but_was_read(
    arrived: tuple[str, ...], fate: Fate, disputed: bool
) -> None:
    """The Clock never heard frame 1 of P, and the observer waits for that of R; did `go` read it?"""
    stage = Stage(sensors=(SONAR, BUMPER), servers_read={("drive", "go"): frozenset({"P"})})
    stage.take(tick(0), *(ServerFrame(server=s, k=0, fields={}) for s in "PR"), verdict(0, 1.0))
    stage.take(tick(1), *(ServerFrame(server=s, k=1, fields={}) for s in arrived))
    values = (2.0,) if fate == "late" else (99.0,)
    by = None if fate == "late" else "go"
    stage.take(Verdict(k=1, t_ns=1, actuator="drive", by=by, values=values, fates=(("go", fate),)))
    stage.take(VOID, verdict(2, 3.0))
    restart = SendMessage(topics.RESTARTS, Restart(client="Observer", start=0))
    assert (restart in stage.sent) is disputed
    found = [(f.tick.k, f.memory_unknown, f.disagreements) for f in stage.log.frames]
    assert found == [(0, False, ()), (1, disputed, ()), (2, disputed, ())]
    stage.take(Tick(k=3, t_ns=3, start=3, run="run", down=("P", "R")), verdict(3, 1.0))
    assert not stage.log.frames[-1].memory_unknown


def test_who_does_not_read_a_void_frame_disputes_nothing() -> None:
    stage = Stage(sensors=(SONAR, BUMPER), servers_read={("drive", "go"): frozenset({"P"})})
    stage.take(tick(0), ServerFrame(server="P", k=0, fields={}), verdict(0, 1.0))
    stage.take(Tick(k=1, t_ns=1, run="run", down=("R",), void=(("R", 0),)), verdict(1, 2.0))
    stage.take(ServerFrame(server="P", k=1, fields={}))
    assert [(f.tick.k, f.memory_unknown, f.disagreements) for f in stage.log.frames] == [
        (0, False, ()),
        (1, False, ()),
    ]
