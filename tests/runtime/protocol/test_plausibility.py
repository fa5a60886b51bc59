"""What cannot be true now is malformed."""

from __future__ import annotations

import msgspec
import pytest

from colony.ir.frame import Answer
from colony.runtime.protocol.codec import (
    FRAME_NUMBER_NS,
    MAX_CLOCK_LEAD_NS,
    MAX_NAMES,
    MessageFormatError,
    check_plausible,
)
from colony.runtime.protocol.messages import (
    Announcement,
    Bounds,
    Checkpoint,
    Fetch,
    Ready,
    Request,
    Restart,
    SentMessage,
    ServerFrame,
    Stopped,
    Tick,
    Verdict,
)

NOW_NS = 60_000_000_000
HIGHEST = (NOW_NS + MAX_CLOCK_LEAD_NS) // FRAME_NUMBER_NS
STOP = Stopped(by="ann/1", t_ns=NOW_NS)

MESSAGES: list[SentMessage] = [
    Tick(k=5, t_ns=0, start=5, run="r", stopped=STOP, released_ns=NOW_NS),
    ServerFrame(server="RServer", k=5, fields={}, since=4, stopped=STOP),
    Fetch(server="RServer", k=5),
    Request(k=5, actuator="drive", client="cruise", bid="silent"),
    Bounds(k=5, actuator="drive", low=(0.0,), high=(1.0,)),
    Announcement(k=5, module="m", answer=Answer((300.0, 5.0))),
    Verdict(k=5, t_ns=0, actuator="drive", by=None, values=None, fates=()),
    Ready(client="drive/cruise", k=-1),
    Checkpoint(client="drive/cruise", k=-1, start=-1, memory=b""),
    Restart(client="drive/cruise", start=5),
]


@pytest.mark.parametrize("message", MESSAGES, ids=[type(m).__name__ for m in MESSAGES])
def test_what_can_be_true_passes(message: SentMessage) -> None:
    check_plausible(message, NOW_NS)


@pytest.mark.parametrize("k", [HIGHEST + 1, 1 << 62, -2, (1 << 64) - 1])
@pytest.mark.parametrize("message", MESSAGES[:-1], ids=[type(m).__name__ for m in MESSAGES[:-1]])
def test_frames_that_cannot_be_yet(message: SentMessage, k: int) -> None:
    with pytest.raises(MessageFormatError, match="is not possible yet"):
        check_plausible(msgspec.structs.replace(message, k=k), NOW_NS)


def test_the_highest_number_passes() -> None:
    check_plausible(Tick(k=HIGHEST, t_ns=0), NOW_NS)


@pytest.mark.parametrize(
    ("message", "says"),
    [
        (Tick(k=5, t_ns=0, start=6), "an epoch that began at 6"),
        (Tick(k=5, t_ns=0, start=-1), "an epoch that began at -1"),
        (Tick(k=5, t_ns=0, down=("x",) * (MAX_NAMES + 1)), "servers or clients in a tick"),
        (Tick(k=5, t_ns=0, released_ns=NOW_NS + MAX_CLOCK_LEAD_NS + 1), "a release at"),
        (Tick(k=5, t_ns=0, stopped=Stopped(by="x", t_ns=1 << 62)), "an emergency stop at"),
        (
            ServerFrame(server="R", k=5, fields={}, stopped=Stopped(by="x", t_ns=1 << 62)),
            "an emergency stop at",
        ),
        (ServerFrame(server="R" * 601, k=5, fields={}), "601 characters"),
        (Restart(client="c", start=1 << 62), "is not possible yet"),
    ],
)
def test_other_things_that_cannot_be(message: SentMessage, says: str) -> None:
    with pytest.raises(MessageFormatError, match=says):
        check_plausible(message, NOW_NS)
