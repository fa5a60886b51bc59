"""Opening dialogues: pauses, questions, answers, silence."""

from __future__ import annotations

import pytest

from colony.drivers.dialect import Ask, Opening, OpeningError, OpeningRun, Send

MS = 1_000_000


def dialogue() -> Opening[int]:
    yield Send(b"reset", pause_s=0.1)
    for _ in range(2):
        if (answer := (yield Ask(b"who?", lambda packet: 100 // packet < 10, timeout_s=0.5))) is not None:
            yield Send(bytes([answer]))
            return
    raise OpeningError("no answer")


def test_a_dialogue() -> None:
    sent: list[bytes] = []
    run = OpeningRun(dialogue(), sent.append, 0)
    run.on_packet(11, 50 * MS)  # within the pause
    assert sent == [b"reset"]
    run.on_time(100 * MS)
    run.on_packet(9, 101 * MS)  # no answer
    run.on_packet(0, 102 * MS)  # one that cannot be read
    run.on_time(599 * MS)
    assert sent == [b"reset", b"who?"]
    run.on_time(600 * MS)
    run.on_packet(12, 700 * MS)
    assert sent == [b"reset", b"who?", b"who?", bytes([12])]
    assert not run.is_done
    run.on_time(700 * MS)
    assert run.is_done
    run.on_time(900 * MS)
    run.on_packet(13, 900 * MS)


def test_silence() -> None:
    run = OpeningRun(dialogue(), lambda data: None, 0)
    run.on_time(100 * MS)
    run.on_time(600 * MS)
    with pytest.raises(OpeningError):
        run.on_time(1100 * MS)
