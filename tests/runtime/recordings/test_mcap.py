"""Recordings as MCAP: the `mcap` package reads what is written, whenever the writer was killed."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import random
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Chunk, McapRecord, Message
from mcap.stream_reader import StreamReader

from colony.dsl.load import load_text
from colony.ir.frame import Frame, Outcome
from colony.runtime.observe.observer import FrameLog
from colony.runtime.protocol.messages import Request
from colony.runtime.recordings.mcap_reader import McapReader
from colony.runtime.recordings.mcap_writer import McapRecording, checksum
from colony.runtime.recordings.recorded import RecordedFrame, SourceFile
from colony.text.diagnostics import Failure
from tests.verify.audit.recorded_runs import MS, Kept, as_mcap, logs, read_mcap, run_info, written

ROOT = Path(__file__).parents[3]
TEXT = """
robot rome {
  sensor near : mm range 0 .. 5000 from PServer.near
  sensor rays[3] : number from PServer.rays
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0)
  actuator lamp { on : bool } to DServer.Lamp idle hold
}
module cruise { when near >= 0 mm do drive(velocity = near / 1 s, turn = 0) }
module back   { when bumper do drive(velocity = -100 mm/s, turn = rays[0] * 1 deg/s) }
module shine  { when bumper do lamp(on = true) }
network { drive = back suppresses cruise  lamp = shine }
contract slow: drive.velocity <= 300 mm/s
"""
PROGRAM = load_text(TEXT)
SOURCES = (
    SourceFile(kind="python", place="pkg/mod.py", data=b"x = 1\n"),
    SourceFile(kind="behavior", place="b.colony", data=TEXT.encode()),
)


def trace(frames: int = 6) -> tuple[Frame, ...]:
    return tuple(
        Frame(k * 50 * MS, {"near": 100.0 * k, "rays": (0.1, -0.0, 1e-300), "bumper": k % 3 == 2})
        for k in range(frames)
    )


def messages(data: bytes) -> dict[str, list[dict[str, Any]]]:
    """What the package's own reader finds, by topic."""
    out: dict[str, list[dict[str, Any]]] = {}
    for _, channel, message in make_reader(io.BytesIO(data)).iter_messages(log_time_order=False):
        out.setdefault(channel.topic, []).append(json.loads(message.data))
    return out


def test_what_other_tools_find() -> None:
    data = as_mcap(PROGRAM, logs(PROGRAM, trace()), *SOURCES).content
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    assert sum(map(len, messages(data).values())) == 6 * 3 + 1 + 1
    topics = {c.topic for c in summary.channels.values()}
    assert topics == {
        "/frames",
        "/keyframes",
        "/contracts",
        *(f"/{x}/{a}" for x in ("verdicts", "requests") for a in ("drive", "lamp")),
    }
    found = {m.name: m.metadata for m in reader.iter_metadata()}
    assert found["colony"] == {
        "format": "colony-recording/2",
        "version": "1.2.3",
        "robot": "rome",
        "program": "b.colony",
        "frame_ns": "50000000",
        "seed": "7",
        "run": "",
        "started": "",
        "checksum": checksum(found["colony"]),
    }
    assert found["colony clients of drive"] == {"back": "2", "cruise": "1", "checksum": "7794a62e"}
    attachments = {a.name: (a.media_type, a.data) for a in reader.iter_attachments()}
    assert attachments == {
        "python/pkg/mod.py": ("text/x-python", b"x = 1\n"),
        "behavior/b.colony": ("text/x-colony", TEXT.encode()),
    }


def test_messages() -> None:
    right = logs(PROGRAM, trace())
    requests = (
        Request(k=1, actuator="drive", client="back", bid="silent"),
        Request(k=1, actuator="drive", client="cruise", bid="command", values=(100.0, 0.0)),
        Request(k=1, actuator="drive", client="cruise", bid="silent"),
        Request(k=1, actuator="lamp", client="shine", bid="command", fault="not finite"),
    )
    right[1] = replace(right[1], requests=requests)
    right[2] = replace(right[2], restart=True)
    right[3] = replace(right[3], expected=Outcome(()))
    found = messages(as_mcap(PROGRAM, right).content)
    assert found["/frames"][1] == {
        "k": 1,
        "t": 0.05,
        "t_ns": 50 * MS,
        "start": 0,
        "sensors": {"near": 100.0, "rays": [0.1, -0.0, 1e-300], "bumper": False},
    }
    assert found["/frames"][2]["restart"] is True
    assert [f.get("skipped") for f in found["/frames"]] == [None] * 3 + [0] + [None] * 2
    values = {"velocity": 100.0, "turn": 0.0}
    assert found["/verdicts/drive"][1] == {
        "k": 1,
        "by": "cruise",
        "values": values,
        "fates": {"cruise": "won", "back": "silent"},
    }
    assert found["/verdicts/lamp"][1] == {"k": 1, "fates": {"shine": "silent"}}
    assert found["/requests/drive"] == [
        {"k": 1, "clients": {"back": {"bid": "silent"}, "cruise": {"bid": "command", "values": values}}}
    ]
    assert found["/requests/lamp"] == [
        {"k": 1, "clients": {"shine": {"bid": "command", "fault": "not finite"}}}
    ]
    assert found["/contracts"] == [{"k": 4, "broken": ["slow"]}]


SIMPLE = {"boolean": (bool,), "string": (str,), "number": (int, float), "integer": (int,)}


def conforms(value: object, schema: dict[str, Any]) -> None:
    """What tools that draw recordings can read: every schema has one type, and values are of it."""
    kind = schema["type"]
    assert "description" in schema or kind in SIMPLE
    if kind == "object":
        assert isinstance(value, dict)
        assert set(schema.get("required", ())) <= set(value)
        assert set(value) <= set(schema["properties"]) or schema.get("additionalProperties")
        for name, of in schema["properties"].items():
            conforms(value[name], of) if name in value else well_formed(of)
    elif kind == "array":
        assert isinstance(value, list)
        for element in value:
            conforms(element, schema["items"])
    else:
        assert isinstance(value, SIMPLE[kind])
        assert isinstance(value, bool) is (kind == "boolean")


def well_formed(schema: dict[str, Any]) -> None:
    assert isinstance(schema["type"], str)
    for of in schema.get("properties", {}).values():
        well_formed(of)
    assert (schema["type"] == "object") == ("properties" in schema)
    if schema["type"] == "array":
        well_formed(schema["items"])


def test_messages_are_as_their_schemas_say() -> None:
    right = logs(PROGRAM, trace(), restarts=[3])
    bid = Request(k=0, actuator="drive", client="cruise", bid="command", values=(100.0, 0.0))
    right[0] = replace(right[0], requests=(bid,), disagreements=("x",))
    checked = 0
    for schema, channel, message in make_reader(io.BytesIO(as_mcap(PROGRAM, right).content)).iter_messages():
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        well_formed(json.loads(schema.data))
        conforms(json.loads(message.data), json.loads(schema.data))
        checked += 1
    assert checked == 6 * 3 + 1 + 1 + 2


def same(found: FrameLog | Any, right: FrameLog) -> None:
    assert (found.tick, found.restart, found.breaches) == (right.tick, right.restart, right.breaches)
    assert found.frame.t_ns == right.frame.t_ns
    assert dict(found.verdicts) == dict(right.verdicts)


def test_what_is_read_back() -> None:
    right = logs(PROGRAM, trace(), restarts=[3])
    found, reader = read_mcap(PROGRAM, as_mcap(PROGRAM, right, *SOURCES).content)
    assert reader.cut is None
    assert reader.run == run_info(PROGRAM, *SOURCES)
    assert len(found) == len(right)
    for one, log in zip(found, right, strict=True):
        same(one, log)
        assert list(one.frame.readings["rays"]) == list(log.frame.readings["rays"])  # type: ignore[arg-type]
        assert math.copysign(1, one.frame.readings["rays"][1]) == -1  # type: ignore[index]


def test_odd_readings_and_times() -> None:
    frames = (
        Frame(-5, {"near": math.inf, "bumper": 3}),
        Frame(1 << 62, {"near": 10**400, "rays": (math.nan,) * 3}),
    )
    found, _ = read_mcap(PROGRAM, as_mcap(PROGRAM, logs(PROGRAM, frames)).content)
    assert [f.frame.t_ns for f in found] == [-5, 1 << 62]
    assert found[0].frame.readings == {"near": math.inf, "bumper": 3}
    assert found[1].frame.readings == {"near": math.inf, "rays": ["nan"] * 3}


def test_a_chunk_of_less_than_half_a_second_leaves_in_one_write() -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace(20)), *SOURCES)
    assert [frames_in(data) for data in file.writes] == [0, 8, 8, 4, 0]
    assert file.closed


def frames_in(data: bytes) -> int:
    """How many frames a write has, after those that precede it."""
    records = StreamReader(io.BytesIO(data), skip_magic=True).records
    return (
        0
        if data.startswith(b"\x89MCAP") or data.endswith(b"MCAP0\r\n")
        else sum(isinstance(r, Message) and b'"t_ns"' in r.data for r in until_the_end(records))
    )


def lenient(data: bytes) -> Iterator[Message]:
    """The messages up to where the package's own reader gives up."""
    records = until_the_end(StreamReader(io.BytesIO(data), validate_crcs=True).records)
    return (record for record in records if isinstance(record, Message))


def until_the_end(records: Iterator[McapRecord]) -> Iterator[McapRecord]:
    """Records up to where bytes are missing."""
    while True:
        try:
            yield next(records)
        except (StopIteration, McapError, struct.error):
            return


DATA_END = 1 + 8 + 4


def refused_or_read(data: bytes) -> tuple[list[RecordedFrame], McapReader | None]:
    """What is read of damaged bytes; nothing where they are refused as damaged should be."""
    try:
        return read_mcap(PROGRAM, data)
    except Failure as failure:
        if failure.diagnostics[0].code not in ("A002", "A006"):
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
        assert reader.cut == "it breaks off in the middle of a frame"


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
        *map(file.content.index, (b"colony-recording/2", b"cruise", b"module back", b"checksum")),
        chunk,
    ):
        with pytest.raises(Failure, match="damaged") as caught:
            read_mcap(PROGRAM, flipped(file.content, at))
        assert caught.value.diagnostics[0].code == "A006"


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
    with pytest.raises(Failure, match="unpacks to far more"):
        read_mcap(PROGRAM, many)


def test_readings_that_never_change_are_no_bomb() -> None:
    of = load_text(TEXT.replace("rays[3]", "rays[1000]"))
    frames = tuple(Frame(k * 50 * MS, {"near": 0.0, "rays": [0.0] * 1000}) for k in range(400))
    assert len(read_mcap(of, as_mcap(of, logs(of, frames)).content)[0]) == 400


def test_frames_without_end_are_a_bomb() -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace(8)))
    (chunk,) = [zstandard.decompress(chunk_in(data).data) for data in file.writes[1:2]]
    empty = struct.pack("<BQHIQQ", 5, 22, 999, 0, 0, 0)
    for records, message in ((chunk * 2000, "time must rise"), (empty * 200_000, "unpacks to far more")):
        many = rechunked(file.writes[1], "zstd", records)
        with pytest.raises(Failure, match=message):
            read_mcap(PROGRAM, b"".join([file.writes[0], many, *file.writes[2:]]))


def test_a_program_without_end_is_refused() -> None:
    sources = tuple(SourceFile(kind="python", place=f"m{i}.py", data=bytes(5_000_000)) for i in range(8))
    with pytest.raises(Failure, match="more than 32 MiB"):
        read_mcap(PROGRAM, as_mcap(PROGRAM, [], *sources).content)


def test_a_chunk_that_another_tool_left_out_is_missed() -> None:
    file = as_mcap(PROGRAM, logs(PROGRAM, trace(20)))
    found, _ = read_mcap(PROGRAM, b"".join([*file.writes[:2], *file.writes[3:]]))
    assert [f.tick.k for f in found if f.damaged] == [16]


def test_long_frames_are_chunks_of_their_own() -> None:
    slow = load_text(TEXT.replace("robot rome {", "robot rome {\n  frame 300 ms"))
    frames = tuple(Frame(k * 300 * MS, {"near": 1.0}) for k in range(4))
    assert [frames_in(data) for data in as_mcap(slow, logs(slow, frames)).writes] == [0, 1, 1, 1, 1, 0]


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


def test_random_damage_never_raises_more_than_a_failure() -> None:
    data = as_mcap(PROGRAM, logs(PROGRAM, trace()), *SOURCES).content
    for seed in range(300):
        chance = random.Random(seed)
        bad = bytearray(data)
        for _ in range(chance.randint(1, 4)):
            bad[chance.randrange(8, len(bad))] = chance.randrange(256)
        refused_or_read(bytes(bad))


def test_places_that_lead_elsewhere_are_left_out() -> None:
    bad = ("../x.py", "/etc/x", "a/../../x", "", ".", "a\\x", "\0")
    sources = tuple(SourceFile(kind="python", place=place, data=b"") for place in bad)
    _, reader = read_mcap(PROGRAM, as_mcap(PROGRAM, [], *sources, *SOURCES).content)
    assert reader.run.sources == SOURCES


def test_of_another_robot() -> None:
    data = as_mcap(PROGRAM, logs(PROGRAM, trace())).content
    for old, new in (("lamp", "light"), ("velocity", "speed")):
        with pytest.raises(Failure) as caught:
            read_mcap(load_text(TEXT.replace(old, new)), data)
        assert caught.value.diagnostics[0].code == "A004"


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
    recording = McapRecording(PROGRAM, run_info(PROGRAM), file)
    for log in right[:15]:
        recording.take(log)
    with pytest.raises(OSError, match="No space left"):
        recording.take(right[15])
    recording.close()
    assert file.closed
    found, reader = read_mcap(PROGRAM, file.content)
    assert (len(found), reader.cut) == (8, "it breaks off in the middle of a frame")


def test_a_disk_that_is_full_at_once() -> None:
    file = Full(10)
    with pytest.raises(OSError, match="No space left"):
        McapRecording(PROGRAM, run_info(PROGRAM), file)
    assert file.closed


def test_a_disk_that_is_full_in_the_end() -> None:
    right = logs(PROGRAM, trace())
    file = Full(len(as_mcap(PROGRAM, right).content) - 1)
    with pytest.raises(OSError, match="No space left"):
        written(McapRecording(PROGRAM, run_info(PROGRAM), file), right)
    assert file.closed
    assert len(read_mcap(PROGRAM, file.content)[0]) == 6


WRITER = """
import os, sys
from dataclasses import replace
from itertools import count
import msgspec
from colony.files import open_alone
from colony.runtime.recordings.mcap_writer import McapRecording
from tests.runtime.recordings.test_mcap import PROGRAM, SOURCES, trace
from tests.verify.audit.recorded_runs import logs, run_info

recording = McapRecording(PROGRAM, run_info(PROGRAM, *SOURCES), open_alone(sys.argv[1]))
[log] = logs(PROGRAM, trace(1))
for k in count():
    verdicts = {name: msgspec.structs.replace(v, k=k) for name, v in log.verdicts.items()}
    tick = msgspec.structs.replace(log.tick, k=k, t_ns=k * 50_000_000)
    recording.take(replace(log, tick=tick, verdicts=verdicts))
    os.write(1, b".")
"""


@pytest.mark.parametrize("seed", range(3))
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
    assert reader.cut is not None
    assert reader.run == run_info(PROGRAM, *SOURCES)
    assert acknowledged - 8 < len(found) <= acknowledged + 1
    assert [f.tick.k for f in found] == list(range(len(found)))
    assert all(len(f.verdicts) == 2 for f in found)
    assert len([m for m in lenient(path.read_bytes()) if b'"t_ns"' in m.data]) == len(found)
