"""Recordings as MCAP whose writer is killed, or whose disk is full."""

from __future__ import annotations

import errno
import io
import os
import random
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from colony.analysis.recording import recorded_program
from colony.dsl.load import load_text
from colony.execute.compiled import SourceFile
from colony.ir.frame import Frame
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.recordings.mcap_reader import McapReader
from colony.runtime.recordings.mcap_records import Damage, read_records
from colony.runtime.recordings.reader import MAGIC
from colony.text.diagnostics import DiagnosticError
from tests.analysis.recorded_runs import MS, Kept, as_mcap, logs, mcap_to, read_mcap, run_info, written
from tests.paths import ROOT
from tests.runtime.recordings.mcap_files import (
    PROGRAM,
    SOURCES,
    TEXT,
    lenient,
    trace,
)
from tests.sampling import sampled


class Full(Kept):
    """A disk with room for so many bytes."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self.room = room

    def write(self, data: Any, /) -> int:
        took = min(self.room, len(data), 100)
        if not took:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.room -= took
        return super().write(bytes(data)[:took])


def test_a_full_disk() -> None:
    right = logs(PROGRAM, trace(20))
    whole = as_mcap(PROGRAM, right).writes
    file = Full(sum(map(len, whole[:2])) + 150)
    recording = mcap_to(file, PROGRAM)
    for log in right[:15]:
        recording.take(log)
    with pytest.raises(OSError, match="No space left"):
        recording.take(right[15])
    recording.close()
    assert file.closed
    found, reader = read_mcap(PROGRAM, file.content)
    assert (len(found), reader.truncation) == (8, "it breaks off in the middle of a frame")


def test_a_disk_that_is_full_at_once() -> None:
    file = Full(10)
    with pytest.raises(OSError, match="No space left"):
        mcap_to(file, PROGRAM)
    assert file.closed


def test_a_disk_that_is_full_in_the_end() -> None:
    right = logs(PROGRAM, trace())
    file = Full(len(as_mcap(PROGRAM, right).content) - 1)
    with pytest.raises(OSError, match="No space left"):
        written(mcap_to(file, PROGRAM), right)
    assert file.closed
    assert len(read_mcap(PROGRAM, file.content)[0]) == 6


WRITER = """
import os, sys
from dataclasses import replace
from itertools import count
import msgspec
from colony.files import open_exclusive
from colony.runtime.recordings.mcap_writer import McapRecording
from tests.runtime.recordings.mcap_files import PROGRAM, SOURCES, trace
from tests.analysis.recorded_runs import logs, mcap_to

recording = mcap_to(open_exclusive(sys.argv[1]), PROGRAM, *SOURCES)
[log] = logs(PROGRAM, trace(1))
for k in count():
    verdicts = {name: msgspec.structs.replace(v, k=k) for name, v in log.verdicts.items()}
    tick = msgspec.structs.replace(log.tick, k=k, t_ns=k * 50_000_000)
    recording.take(replace(log, tick=tick, verdicts=verdicts))
    os.write(1, b".")
"""


@pytest.mark.parametrize("seed", sampled(range(3), every=3))
def test_a_killed_process_leaves_every_frame_that_it_had_written(seed: int, tmp_path: Path) -> None:
    """Killed at a moment of chance: all but the last chunk can be read, by both readers."""
    path = tmp_path / "run.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert process.stdout is not None
    with process:
        wanted = random.Random(seed).randint(1, 2000)
        acknowledged = len(process.stdout.read(wanted))
        process.kill()
        acknowledged += len(process.stdout.read())
    assert acknowledged >= wanted
    with path.open("rb") as file:
        reader = McapReader(file, "run.mcap")
        found = list(reader.frames(PROGRAM))
    assert reader.truncation is not None
    assert reader.run == run_info(PROGRAM, *SOURCES)
    assert acknowledged - 8 < len(found) <= acknowledged + 1
    assert [f.tick.k for f in found] == list(range(len(found)))
    assert all(len(f.verdicts) == 2 for f in found)
    assert len([m for m in lenient(path.read_bytes()) if b'"t_ns"' in m.data]) == len(found)


# --- damaged recordings as mcap ---


DATA_END = 1 + 8 + 4


def refused_or_read(data: bytes) -> tuple[list[RunFrame], McapReader | None]:
    """What is read of damaged bytes; nothing where they are refused as damaged should be."""
    try:
        return read_mcap(PROGRAM, data)
    except DiagnosticError as failure:
        found = failure.diagnostics[0]
        unnamed = found.code == "A004" and "its robot lacks the actuator" in found.message
        if found.code not in ("A002", "A006") and not unnamed:  # the names of metadata have no checksum
            raise
        return [], None


def test_cut_off_anywhere() -> None:
    right = logs(PROGRAM, trace(20))
    file = as_mcap(PROGRAM, right, *SOURCES)
    ends = [sum(map(len, file.writes[: i + 1])) for i in range(len(file.writes))]
    ends[-1] = ends[-2] + DATA_END  # what follows is a summary, which is not read
    for length in (*range(0, ends[0], 61), *range(ends[0], ends[-1], 7), *ends[:-1]):
        data = file.content[:length]
        if length < ends[0]:
            found, reader = refused_or_read(data)
            if reader is None:
                continue
            assert found == []
        else:
            found, reader = read_mcap(PROGRAM, data)
            whole = [0, 8, 16, 20][sum(end <= length for end in ends[1:-1])]
            assert len(found) == whole
            assert not reader.damaged
            assert len([m for m in lenient(data) if b'"t_ns"' in m.data]) == whole
        assert reader.truncation == "it breaks off in the middle of a frame"


@pytest.mark.parametrize(
    ("chunk", "whole"), [(1, range(8, 20)), (2, [*range(8), *range(16, 20)]), (3, range(16))]
)
@pytest.mark.parametrize("at", [0, 1, 8, 9, 17, 25, 33, 37, 41, 45, 70, -1])
def test_a_damaged_chunk_costs_its_frames(chunk: int, whole: Sequence[int], at: int) -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace(20)))
    file.writes[chunk] = flipped(file.writes[chunk], at)
    found, reader = read_mcap(PROGRAM, file.content)
    if at in (9, 17):  # times that nobody reads
        assert len(found) == 20
        return
    assert [f.tick.k for f in found] == [*whole]
    assert [f.tick.k for f in found if f.damaged] == ([] if chunk == 3 else [chunk * 8])
    assert reader.damaged is (chunk == 3)


def flipped(data: bytes, at: int) -> bytes:
    """With one bit that is another."""
    bad = bytearray(data)
    bad[at] ^= 1
    return bytes(bad)


def test_what_precedes_the_frames_must_be_whole() -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace()), *SOURCES)
    chunk = file.writes[0].rindex(b"zstd") - 41
    for at in (
        *map(file.content.index, (b"colony-recording/2", b"cruise", b"checksum")),
        chunk,
    ):
        with pytest.raises(DiagnosticError, match="damaged") as caught:
            read_mcap(PROGRAM, flipped(file.content, at))
        assert caught.value.diagnostics[0].code == "A006"


def test_a_damaged_program_costs_no_frame() -> None:
    data = as_mcap(PROGRAM, logs(PROGRAM, trace()), *SOURCES).content
    length = data.index(b"text/x-python") + len(b"text/x-python")
    for at, bit in ((data.index(b"module back"), 0), (length + 7, 7)):
        found, reader = read_mcap(PROGRAM, data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :])
        assert (len(found), reader.damaged, len(reader.run.sources)) == (6, False, 1)
        assert [text[:29] for text in reader.remarks] == ["the program in it is damaged "]
        damaged = pytest.raises(DiagnosticError, match=r"\[A006\]: its program is damaged \(")
        with damaged, recorded_program(reader, "run.mcap"):
            pass


def test_chunks_by_other_tools_are_read_and_bombs_are_not() -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace(20)))
    chunks = [rechunked(data, "lz4") if 0 < i < 4 else data for i, data in enumerate(file.writes)]
    assert len(read_mcap(PROGRAM, b"".join(chunks))[0]) == 20
    for compression in ("zstd", "lz4"):
        bomb = bombed(compression, 1 << 30)
        found, _ = read_mcap(PROGRAM, b"".join([*chunks[:2], bomb, *chunks[2:]]))
        assert len(found) == 20
        assert found[8].damaged
    many = b"".join([*chunks[:2], *[bombed("zstd", 1 << 23)] * 60, *chunks[2:]])
    with pytest.raises(DiagnosticError, match="unpacks to far more"):
        read_mcap(PROGRAM, many)


def test_readings_that_never_change_are_no_bomb() -> None:
    of = load_text(TEXT.replace("rays[3]", "rays[1000]"))
    frames = tuple(Frame(k * 50 * MS, {"near": 0.0, "rays": [0.0] * 1000}) for k in range(400))
    assert len(read_mcap(of, as_mcap(of, logs(of, frames)).content)[0]) == 400


def test_frames_without_end_are_a_bomb() -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace(8)))
    (chunk,) = [zstandard.decompress(chunk_in(data).data) for data in file.writes[1:2]]
    empty = struct.pack("<BQHIQQ", 5, 22, 999, 0, 0, 0)
    for records, message in (
        (chunk * 2000, "not in the order of time"),
        (empty * 200_000, "unpacks to far more"),
    ):
        many = rechunked(file.writes[1], "zstd", records)
        with pytest.raises(DiagnosticError, match=message):
            read_mcap(PROGRAM, b"".join([file.writes[0], many, *file.writes[2:]]))


def test_a_program_without_end_is_refused() -> None:
    sources = tuple(SourceFile(kind="python", path=f"m{i}.py", data=bytes(5_000_000)) for i in range(8))
    with pytest.raises(DiagnosticError, match="larger than 32 MiB"):
        read_mcap(PROGRAM, as_mcap(PROGRAM, [], *sources).content)


def test_a_chunk_that_another_tool_left_out_is_missed() -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace(20)))
    found, _ = read_mcap(PROGRAM, b"".join([*file.writes[:2], *file.writes[3:]]))
    assert [f.tick.k for f in found if f.damaged] == [16]


def chunk_in(data: bytes) -> Chunk:
    """The first record in these bytes."""
    chunk = next(StreamReader(io.BytesIO(data), skip_magic=True, emit_chunks=True).records)
    assert isinstance(chunk, Chunk)
    return chunk


def rechunked(data: bytes, compression: str, records: bytes | None = None) -> bytes:
    """The first chunk in these bytes, compressed another way, or with other records in it."""
    chunk = chunk_in(data)
    if records is None:
        records = zstandard.decompress(chunk.data)
    packed = lz4.frame.compress(records) if compression == "lz4" else zstandard.compress(records)
    builder = RecordBuilder()
    replace(
        chunk,
        compression=compression,
        data=packed,
        uncompressed_size=len(records),
        uncompressed_crc=zlib.crc32(records),
    ).write(builder)
    out: bytes = builder.end()  # type: ignore[no-untyped-call]
    return out


def bombed(compression: str, size: int) -> bytes:
    """A chunk of zeros."""
    return rechunked(as_mcap(PROGRAM, logs(PROGRAM, trace())).writes[1], compression, bytes(size))


def test_places_that_lead_elsewhere_are_left_out() -> None:
    bad = ("../x.py", "/etc/x", "a/../../x", "", ".", "a\\x", "\0", "a/" * 1000 + "x")
    sources = tuple(SourceFile(kind="python", path=place, data=b"") for place in bad)
    _, reader = read_mcap(PROGRAM, as_mcap(PROGRAM, [], *sources, *SOURCES).content)
    assert reader.run.sources == SOURCES


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def attachment(i: int) -> bytes:
    name = f"python/m{i}.py".encode()
    body = bytes(16) + struct.pack("<I", len(name)) + name + struct.pack("<IQ", 0, 0)
    return record(9, body + struct.pack("<I", zlib.crc32(body)))


def channel(i: int) -> bytes:
    topic = f"/x{i}".encode()
    return record(4, struct.pack("<HHI", i, 0, len(topic)) + topic + struct.pack("<II", 0, 0))


MANY: dict[str, Callable[[int], bytes]] = {
    "schemas": lambda i: record(3, struct.pack("<HIII", i % 9 + 1, 0, 0, 0)),
    "channels": channel,
    "metadata": lambda i: record(12, struct.pack("<I4sI", 4, b"%04d" % (i % 10_000), 0)),
    "attachments": attachment,
    "indexes": lambda i: record(7, struct.pack("<HIQQ", 1, 16, i, i)),
    "unknown records": lambda i: record(200, b"x"),
    "empty chunks": lambda i: record(6, struct.pack("<QQQIIQ", 0, 0, 0, 0, 0, 0)),
    "messages": lambda i: record(5, struct.pack("<HIQQ", 999, 0, 0, 0)),
}
"""Records of which a file may have many."""


def calls(data: bytes) -> int:
    """Return the number of Python functions that reading a recording calls."""
    count = 0

    def profile(frame: object, event: str, argument: object) -> None:
        nonlocal count
        count += event == "call"

    sys.setprofile(profile)
    try:
        refused_or_read(data)
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.parametrize("kind", MANY)
@pytest.mark.parametrize("place", ["before the frames", "after them", "within a chunk"])
def test_reading_many_records_takes_linear_time(kind: str, place: str) -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace(8)), *SOURCES)
    chunk = zstandard.decompress(chunk_in(file.writes[1]).data)
    head = file.content[: file.content.index(b"zstd") - 41]

    def reading(count: int) -> int:
        many = b"".join(MANY[kind](i) for i in range(count))
        match place:
            case "before the frames":
                return calls(head + many + file.content[len(head) :])
            case "after them":
                return calls(b"".join([*file.writes[:2], many, *file.writes[2:]]))
            case _:
                return calls(b"".join([file.writes[0], rechunked(file.writes[1], "zstd", chunk + many)]))

    _, none, few, more = map(reading, (0, 0, 200, 1000))  # the first one imports modules
    assert more - none <= 5.5 * max(few - none, 1) + 100


def test_damage_before_each_chunk_does_not_read_on_far_beyond_it() -> None:
    class Counted(io.BytesIO):
        count = 0

        def read(self, size: int | None = -1) -> bytes:
            data = super().read(size)
            self.count += len(data)
            return data

    damaged = MANY["unknown records"](0) + MANY["empty chunks"](0)
    file = Counted(MAGIC + damaged * 100 + bytes(4 << 20))
    assert sum(isinstance(found, Damage) for found in read_records(file)) > 100
    assert file.count < 20 << 20
