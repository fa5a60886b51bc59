"""A moment found by the index is the moment that following the whole recording finds."""

from __future__ import annotations

import io
import zlib
from dataclasses import replace

import pytest

from colony.analysis.finding import (
    VERSION,
    RecordingIndex,
    StaleIndexError,
    build_index,
    decode,
    encode,
    index_path,
    moment_at,
    packed,
    unpacked,
)
from colony.analysis.moments import MomentFollower
from colony.dsl.load import load_file
from colony.ir.program import Program
from colony.runtime.recordings.mcap_reader import McapReader
from colony.runtime.recordings.reader import LinesReader
from colony.runtime.recordings.recorded import RecordingReader
from colony.verify.explain.answer import Why, WhyNot, explain
from colony.verify.explain.text import lines
from tests.analysis.recorded_runs import MS, as_lines
from tests.cli.explained import WANDER, recorded


@pytest.fixture(scope="module")
def program() -> Program:
    return load_file(str(WANDER))


@pytest.fixture(scope="module", params=["mcap", "lines"])
def recording(request: pytest.FixtureRequest) -> tuple[str, bytes]:
    """A recording in either format."""
    return request.param, recorded() if request.param == "mcap" else recorded(as_lines)


def reader(recording: tuple[str, bytes]) -> RecordingReader:
    kind, data = recording
    return McapReader(io.BytesIO(data), "run") if kind == "mcap" else LinesReader(io.BytesIO(data), "run")


def indexed(program: Program, recording: tuple[str, bytes]) -> RecordingIndex:
    return build_index(program, reader(recording), interval_ns=800 * MS)


def test_every_moment_is_found(program: Program, recording: tuple[str, bytes]) -> None:
    index = decode(encode(indexed(program, recording)))
    assert len(index.marks) >= 4
    follower = MomentFollower(program)
    for frame in reader(recording).frames(program):
        moment = follower.take(frame)
        assert moment is not None
        if frame.tick.k % 13:
            continue
        found = moment_at(program, reader(recording), index, frame.frame.t_ns)
        assert found.moment is not None
        for question in (Why("drive"), WhyNot("avoid"), WhyNot("cruise"), Why("sonar")):
            expected = lines(explain(moment, question))
            assert lines(explain(found.moment, question)) == expected


def test_a_checkpoint_is_restored_as_it_was(program: Program, recording: tuple[str, bytes]) -> None:
    follower = MomentFollower(program)
    for frame in reader(recording).frames(program):
        follower.take(frame)
        assert unpacked(packed(follower.checkpoint)) == follower.checkpoint


def test_an_index_that_is_not_whole_is_refused(program: Program, recording: tuple[str, bytes]) -> None:
    data = encode(indexed(program, recording))
    later = data.replace(b" %d " % VERSION, b" %d " % (VERSION + 1), 1)
    malformed = data[: data.index(b"\n") + 1] + zlib.crc32(b"\x90").to_bytes(4, "big") + b"\x90"
    for bad in (b"", b"nothing", data[:40], data[:-60] + b"!" + data[-59:], later, malformed):
        with pytest.raises(StaleIndexError):
            decode(bad)


def test_the_place_in_the_cache_is_by_content(program: Program) -> None:
    environment = {"HOME": "/home/user"}
    first = index_path(io.BytesIO(b"a"), program, environment)
    assert first is not None
    assert str(first).startswith("/home/user/.cache/colony/moments/")
    assert index_path(io.BytesIO(b"a"), program, environment) == first
    assert index_path(io.BytesIO(b"b"), program, environment) != first
    assert index_path(io.BytesIO(b"a"), replace(program, files=()), environment) != first
    assert index_path(io.BytesIO(b"a"), program, {"XDG_CACHE_HOME": "/c"}) != first
    assert index_path(io.BytesIO(b"a"), program, {}) is None
