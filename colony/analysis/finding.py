"""Finding a moment of a recording by its time, with an index for which the recording is followed once."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import BinaryIO, NamedTuple

import msgspec

from colony import __version__
from colony.analysis.follower import DamagedSpan
from colony.analysis.moments import FollowerCheckpoint, MomentFollower
from colony.analysis.tracks import Tracks, TrackWriter
from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.ir.program import Program
from colony.ir.version import SEMANTICS
from colony.runtime.frames.run_frame import FilePosition, RunFrame
from colony.runtime.recordings.recorded import RecordingReader
from colony.text.wording import time_text
from colony.verify.explain.moment import Moment

# --- index ---------------------------------------------------------------------------------------------
#
# The index of a recording: marks with checkpoints, from which any moment is soon reached, and tracks.
#
# It is kept in the user's cache. Nothing in a file there is believed that has a wrong checksum or another
# version: the index is then built again.


VERSION = 5
"""Version of the index: increment it if its form, or what the interpreter remembers, changes."""

MAGIC = f"colony-index {VERSION} {SEMANTICS} {__version__}\n".encode()

MAX_BYTES = 256 * 1024 * 1024
"""Byte limit of an index."""

_CHECKSUM_BYTES = 4


class StaleIndexError(ValueError):
    """The bytes are not an index of this version, or are damaged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResumePoint:
    """A frame from which the recording can be followed: the memory before it is known.

    `place` is where a reader goes on; `packed` is the checkpoint, of which there are many.
    """

    t_ns: int
    k: int
    place: FilePosition
    packed: bytes

    @property
    def checkpoint(self) -> FollowerCheckpoint:
        """The memory before the frame."""
        return unpacked(self.packed)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingIndex:
    """An index: what the recording has, and the marks, in order.

    Attributes:
        frames: Number of frames.
        first_ns: Time of the first frame.
        last_ns: Time of the last frame.
        truncation: How the recording breaks off, None if it is whole.
        remarks: What else of it is not read or not known.
        damaged: Spans of damage as texts.
        tracks: What changed, and when.
        marks: The marks.
    """

    frames: int
    first_ns: int
    last_ns: int
    truncation: str | None
    remarks: tuple[str, ...]
    damaged: tuple[str, ...]
    tracks: Tracks
    marks: tuple[ResumePoint, ...]


def packed(checkpoint: FollowerCheckpoint) -> bytes:
    """Return a checkpoint as bytes."""
    return zlib.compress(msgspec.msgpack.encode(checkpoint), 1)


def unpacked(data: bytes) -> FollowerCheckpoint:
    """Return the checkpoint that `packed` made such bytes of."""
    return msgspec.msgpack.decode(zlib.decompress(data), type=FollowerCheckpoint)


def encode(index: RecordingIndex) -> bytes:
    """Return an index as bytes."""
    content = msgspec.msgpack.encode(index)
    return MAGIC + zlib.crc32(content).to_bytes(_CHECKSUM_BYTES, "big") + content


def decode(data: bytes) -> RecordingIndex:
    """Return the index that bytes are of.

    Raises:
        StaleIndexError: they are no index of this version, or are damaged.
    """
    if not data.startswith(MAGIC):
        raise StaleIndexError("this is not an index of this version")
    start = len(MAGIC) + _CHECKSUM_BYTES
    content = memoryview(data)[start:]
    if zlib.crc32(content).to_bytes(_CHECKSUM_BYTES, "big") != data[len(MAGIC) : start]:
        raise StaleIndexError("the index has a wrong checksum")
    try:
        return msgspec.msgpack.decode(content, type=RecordingIndex)
    except msgspec.DecodeError as problem:
        raise StaleIndexError(f"the index is malformed: {problem}") from None


# --- the cache -------------------------------------------------------------------------------------


def cached_index(path: Path | None) -> RecordingIndex | None:
    """Return the index in a file of the cache, None if there is none that can be used."""
    if path is None:
        return None
    try:
        return decode(read_from_cache(path, MAX_BYTES))
    except (OSError, StaleIndexError):
        return None


def keep_index(path: Path | None, index: RecordingIndex) -> str | None:
    """Write an index into the cache; return why it could not be written."""
    if path is None:
        return "there is no folder for the cache: neither XDG_CACHE_HOME nor HOME is set"
    try:
        keep_in_cache(path, encode(index))
    except OSError as problem:
        return problem.strerror or str(problem)
    return None


def index_path(recording: BinaryIO, program: Program, environment: Mapping[str, str]) -> Path | None:
    """Return where the index of a recording is in the user's cache, by the content of both."""
    folder = user_cache(environment, "moments")
    return None if folder is None else folder / f"{_content(recording)}-{_meaning(program)}.index"


def _content(file: BinaryIO) -> str:
    """Return a hash of the whole file; its position stays where it is."""
    position, hashed = file.tell(), blake2b(digest_size=16)
    file.seek(0, os.SEEK_SET)
    while block := file.read(1 << 20):
        hashed.update(block)
    file.seek(position)
    return hashed.hexdigest()


def _meaning(program: Program) -> str:
    """Return a hash of the texts of a program, and of the params that a site set."""
    site = None if program.site is None else program.site.values
    about = [[name, source.text] for name, source in program.files]
    return blake2b(json.dumps([about, site]).encode(), digest_size=16).hexdigest()


# --- finding -------------------------------------------------------------------------------------------


INTERVAL_NS = 5_000_000_000
"""Least time between two marks, in the time of the run."""


def build_index(
    program: Program,
    reader: RecordingReader,
    progress: Callable[[], None] = lambda: None,
    *,
    interval_ns: int = INTERVAL_NS,
) -> RecordingIndex:
    """Follow a whole recording, and return its index; `progress` is called after each frame.

    Marks are at least `interval_ns` apart.

    Raises:
        DiagnosticError: the recording is of another program, or cannot be read.
    """
    follower, tracks = MomentFollower(program), TrackWriter()
    marks: list[ResumePoint] = []
    frames, first_ns, last_ns = 0, 0, 0
    for recorded in reader.frames(program):
        t_ns = recorded.frame.t_ns
        is_due = not marks or t_ns - marks[-1].t_ns >= interval_ns
        if recorded.place is not None and is_due and frames and not recorded.damaged:
            before = packed(follower.checkpoint)
            marks.append(ResumePoint(t_ns=t_ns, k=recorded.tick.k, place=recorded.place, packed=before))
        tracks.take(recorded, follower.take(recorded))
        first_ns, last_ns, frames = (first_ns if frames else t_ns), t_ns, frames + 1
        progress()
    follower.end(damaged=reader.damaged)
    return RecordingIndex(
        frames=frames,
        first_ns=first_ns,
        last_ns=last_ns,
        truncation=reader.truncation,
        remarks=tuple(reader.remarks),
        damaged=tuple(_text(span, first_ns) for span in follower.damaged),
        tracks=tracks.tracks,
        marks=tuple(marks),
    )


def _text(span: DamagedSpan, first_ns: int) -> str:
    start = "its beginning" if span.after_ns is None else time_text(span.after_ns - first_ns)
    end = "its end" if span.before_ns is None else time_text(span.before_ns - first_ns)
    return f"from {start} to {end}"


class Found(NamedTuple):
    """The last frame at or before a time: its number, its time, and the moment; None if it is not known.

    `frame` is the frame as it was recorded.
    """

    k: int
    t_ns: int
    moment: Moment | None
    frame: RunFrame


def moment_at(program: Program, reader: RecordingReader, index: RecordingIndex, t_ns: int) -> Found:
    """Return the last frame at or before a time, which must not be before the first frame.

    Raises:
        DiagnosticError: the recording cannot be read.
    """
    mark = _mark_before(index, t_ns)
    follower = MomentFollower(program, None if mark is None else mark.checkpoint)
    if mark is not None:
        reader.go_to(mark.place)
    found: Found | None = None
    for recorded in reader.frames(program):
        if recorded.frame.t_ns > t_ns:
            break
        moment = follower.take(recorded)
        found = Found(recorded.tick.k, recorded.frame.t_ns, moment, recorded)
    assert found is not None, "no frame at or before the time"
    return found


def _mark_before(index: RecordingIndex, t_ns: int) -> ResumePoint | None:
    return next((mark for mark in reversed(index.marks) if mark.t_ns <= t_ns), None)
