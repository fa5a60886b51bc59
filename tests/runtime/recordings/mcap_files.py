"""A program whose runs are recorded as MCAP, and what is in such files."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator

from mcap.exceptions import McapError
from mcap.records import McapRecord, Message
from mcap.stream_reader import StreamReader

from colony.dsl.load import load_text
from colony.execute.compiled import SourceFile
from colony.ir.frame import Frame
from tests.analysis.recorded_runs import MS

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
    SourceFile(kind="python", path="pkg/mod.py", data=b"x = 1\n"),
    SourceFile(kind="behavior", path="b.colony", data=TEXT.encode()),
)


def trace(frames: int = 6) -> tuple[Frame, ...]:
    return tuple(
        Frame(k * 50 * MS, {"near": 100.0 * k, "rays": (0.1, -0.0, 1e-300), "bumper": k % 3 == 2})
        for k in range(frames)
    )


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
