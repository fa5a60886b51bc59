"""Decoders do what a second reading of their frames does, whatever happened to the bytes."""

from __future__ import annotations

import pytest

from colony.drivers.dialect import Need, SlidingDecoder
from tests.drivers.fuzz import CASES, fuzz, load
from tests.drivers.tiny import decoder, encoded

CODECS = [path.partition(":")[0].rpartition(".")[2] for path in CASES]


@pytest.mark.parametrize("codec", CODECS)
def test_damaged_streams(codec: str) -> None:
    score, trial = fuzz(load(codec), 60_000, seed=1)
    assert score.damages > 100
    assert score.intact > 400
    assert trial.read > 50
    assert trial.refused > 10
    assert trial.sent > 0


def test_a_false_beginning_costs_no_packet() -> None:
    reader = decoder()
    assert reader.feed(b"\xa5\x20" + encoded(b"\x02\x90")) == []  # 32 bytes are due
    assert reader.feed(encoded(b"\x02\x91") * 6) == [b"\x02\x90", *[b"\x02\x91"] * 6]


def test_a_parse_that_raises_means_that_there_is_no_packet() -> None:
    def parse(data: bytearray, at: int) -> tuple[int, int] | Need:
        return (int(data[at + 1 : at + 3]), at + 3) if len(data) >= at + 3 else "more"

    assert SlidingDecoder(parse, b"$").feed(b"$\xff\xff$$12$ab$34") == [12, 34]


def test_nothing_is_kept_of_garbage() -> None:
    reader = decoder()
    reader.feed(bytes(100_000))
    assert len(reader._data) == 0
