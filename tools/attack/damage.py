"""Recordings with a bit that flipped, and recordings that unpack to far more than they should."""

from __future__ import annotations

import io
import os
import random
import signal
import struct
import subprocess
import sys
import time
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from colony.analysis.audit import audit_recording
from colony.dsl.load import load_file
from colony.ir.program import Program
from colony.runtime.recordings.opening import read_recording
from colony.text.diagnostics import DiagnosticError
from tests.paths import ROOT

BEHAVIOR = ROOT / "behaviors" / "wander.colony"
COMMAND = (sys.executable, "-m", "colony.cli.main")
KILLED_BYTES = 40_000
HALF_SECOND = 10
"""Frames that one flipped bit may cost: those of half a second."""


def record(path: Path, *, seconds: float, killed: bool) -> bytes:
    """Record a simulated run, to its end or until it is killed."""
    duration = 3600.0 if killed else seconds
    command = (*COMMAND, "run", str(BEHAVIOR), "--map", str(ROOT / "maps" / "loop.stickrep"), "--no-picture")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        (*command, "--duration", f"{duration:g}", "--record", str(path)),
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:
        while process.poll() is None:
            if killed and path.exists() and path.stat().st_size > KILLED_BYTES:
                process.send_signal(signal.SIGKILL)
            time.sleep(0.01)
    return path.read_bytes()


class Audited(NamedTuple):
    """What an audit says: frames that were read, compared decisions, frames that are not known after damage,
    whether something differs, how many parts are damaged, the time of the last frame; or the code of what it
    refuses."""

    frames: int = 0
    compared: int = 0
    forgotten: int = 0
    differs: bool = False
    damaged: int = 0
    refused: str | None = None
    last_ns: int = 0


def audited(data: bytes, name: str, program: Program) -> Audited:
    """Audit a recording."""
    try:
        report = audit_recording(program, read_recording(io.BytesIO(data), name))
    except DiagnosticError as failure:
        return Audited(refused=failure.diagnostics[0].code)
    return Audited(
        frames=report.frames,
        compared=report.compared,
        forgotten=report.forgotten,
        differs=not report.agrees,
        damaged=len(report.damaged),
        last_ns=report.last_ns,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Flips:
    """What came of flipped bits: how often the damage was told, nothing could be read, or nothing that is
    read was touched; and `wrong`, which has to be empty."""

    told: int
    refused: int
    untouched: int
    wrong: tuple[str, ...]


def flips(data: bytes, name: str, *, trials: int, seed: int) -> Flips:
    """Flip one bit at a time, anywhere."""
    program, chance, counts = load_file(BEHAVIOR), random.Random(seed), Counter[str]()
    whole, wrong = audited(data, name, program), []
    for _ in range(trials):
        at, bit = chance.randrange(len(data)), chance.randrange(8)
        bad = bytearray(data)
        bad[at] ^= 1 << bit
        found = audited(bytes(bad), name, program)
        kind = "refused" if found.refused else "told" if found.damaged else "untouched"
        counts[kind] += 1
        lost = whole.frames - found.frames + found.forgotten
        allowed = {"refused": whole.frames, "told": 2 * HALF_SECOND, "untouched": 0}[kind]
        if kind != "refused" and (found.differs or not 0 <= lost <= allowed):
            wrong.append(f"byte {at} bit {bit}: {found}, of {whole}")
    return Flips(
        told=counts["told"], refused=counts["refused"], untouched=counts["untouched"], wrong=tuple(wrong)
    )


# --- bombs -----------------------------------------------------------------------------------------


def bombs(recording: bytes) -> Iterator[tuple[str, str, bytes]]:
    """Yield recordings that are small and unpack to much, up to 4 GiB: what they are, a name, and what
    they hold."""
    first = recording.index(b"zstd", recording.index(b"zstd") + 1) - 41  # the first chunk with frames
    for compression in ("zstd", "lz4"):
        yield (
            f"4 GiB in one chunk, {compression}",
            "bomb.mcap",
            recording[:first] + _chunk(compression, 1 << 32),
        )
        many = _chunk(compression, 1 << 23) * 256
        yield f"256 chunks of 8 MiB, {compression}", "bomb.mcap", recording[:first] + many + recording[first:]
    frames = next(StreamReader(io.BytesIO(recording[first:]), skip_magic=True, emit_chunks=True).records)
    assert isinstance(frames, Chunk)
    records = zstandard.decompress(frames.data)
    again = _record(records * ((1 << 23) // len(records)))
    yield "the same frames without end", "bomb.mcap", recording[:first] + again + recording[first:]
    objects = b'{"k": 0, "t_ns": 0, "sensors": {"x": [' + b'{"":0},' * 550_000 + b"0]}}"
    message = struct.pack("<BQHIQQ", 5, 22 + len(objects), 1, 0, 0, 0) + objects
    yield (
        "a message of objects",
        "bomb.mcap",
        recording[:first] + _record(records + message) + recording[first:],
    )
    yield "a line without end", "bomb.jsonl", b'{"t": 0, "x": "' + bytes(1 << 26)
    yield "nested brackets", "bomb.jsonl", b'{"t": 0, "x": ' + b"[" * 500_000 + b"\n"


def _chunk(compression: str, size: int) -> bytes:
    """The record of a chunk of zeros, which are never in memory together."""
    block, crc, blocks = bytes(1 << 20), 0, range(size >> 20)
    for _ in blocks:
        crc = zlib.crc32(block, crc)
    if compression == "lz4":
        packing = lz4.frame.LZ4FrameCompressor()
        packed = b"".join([packing.begin(), *(packing.compress(block) for _ in blocks), packing.flush()])
    else:
        zstd = zstandard.ZstdCompressor().compressobj()
        packed = b"".join([*(zstd.compress(block) for _ in blocks), zstd.flush()])
    return _written(compression, packed, size, crc)


def _record(records: bytes) -> bytes:
    """The record of a chunk of these records."""
    return _written("zstd", zstandard.compress(records), len(records), zlib.crc32(records))


def _written(compression: str, packed: bytes, size: int, crc: int) -> bytes:
    builder = RecordBuilder()
    Chunk(
        compression=compression,
        data=packed,
        message_start_time=0,
        message_end_time=0,
        uncompressed_crc=crc,
        uncompressed_size=size,
    ).write(builder)
    out: bytes = builder.end()  # type: ignore[no-untyped-call]
    return out


class Cost(NamedTuple):
    """What a command took, and how it ended."""

    seconds: float
    megabytes: float
    code: int
    said: str


_LAUNCH = """
import resource, subprocess, sys, time
begin = time.monotonic()
null = subprocess.DEVNULL
done = subprocess.run(sys.argv[1:], stdin=null, stdout=null, stderr=subprocess.PIPE)
took, used = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
said = done.stderr.decode(errors="replace")[-1000:]
print(took, used.ru_maxrss / 1024, done.returncode, said)
"""
"""A process counts the memory of the one that started it as its own: so a small one does."""


def cost(*arguments: str, patience_s: float = 120.0) -> Cost:
    """Run a command to its end."""
    done = subprocess.run(
        (sys.executable, "-c", _LAUNCH, *COMMAND, *arguments),
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        timeout=patience_s,
        check=True,
    )
    seconds, megabytes, code, said = done.stdout.decode().split(" ", 3)
    return Cost(float(seconds), float(megabytes), int(code), said.strip())


def costs(folder: Path, recording: bytes) -> Iterator[tuple[str, str, int, Cost]]:
    """Yield of each bomb and command that reads it: what it is, the command, its bytes, and what it took."""
    for what, name, data in bombs(recording):
        path = folder / name
        path.write_bytes(data)
        yield what, "audit", len(data), cost("audit", str(path), str(BEHAVIOR))
        yield what, "trace", len(data), cost("trace", str(BEHAVIOR), "--input", str(path))
        path.unlink()
