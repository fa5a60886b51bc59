"""The index of a recording: marks with checkpoints, from which any moment is soon reached, and tracks.

It is kept in the user's cache. Nothing in a file there is believed that has a wrong checksum or another
version: the index is then built again.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import BinaryIO

import msgspec

from colony import __version__
from colony.analysis.moments import Checkpoint
from colony.analysis.tracks import Tracks
from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.ir.program import Program
from colony.ir.version import SEMANTICS
from colony.runtime.frames.run_frame import Place

VERSION = 5
"""Version of the index: increment it if its form, or what the interpreter remembers, changes."""

MAGIC = f"colony-index {VERSION} {SEMANTICS} {__version__}\n".encode()

MAX_BYTES = 256 * 1024 * 1024
"""Byte limit of an index."""

_CHECKSUM_BYTES = 4


class StaleIndexError(ValueError):
    """The bytes are not an index of this version, or are damaged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A frame from which the recording can be followed: the memory before it is known.

    `place` is where a reader goes on; `packed` is the checkpoint, of which there are many.
    """

    t_ns: int
    k: int
    place: Place
    packed: bytes

    @property
    def checkpoint(self) -> Checkpoint:
        """The memory before the frame."""
        return unpacked(self.packed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Index:
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
    marks: tuple[Mark, ...]


def packed(checkpoint: Checkpoint) -> bytes:
    """Return a checkpoint as bytes."""
    return zlib.compress(msgspec.msgpack.encode(checkpoint), 1)


def unpacked(data: bytes) -> Checkpoint:
    """Return the checkpoint that `packed` made such bytes of."""
    return msgspec.msgpack.decode(zlib.decompress(data), type=Checkpoint)


def encode(index: Index) -> bytes:
    """Return an index as bytes."""
    content = msgspec.msgpack.encode(index)
    return MAGIC + zlib.crc32(content).to_bytes(_CHECKSUM_BYTES, "big") + content


def decode(data: bytes) -> Index:
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
        return msgspec.msgpack.decode(content, type=Index)
    except msgspec.DecodeError as problem:
        raise StaleIndexError(f"the index is malformed: {problem}") from None


# --- the cache -------------------------------------------------------------------------------------


def cached_index(path: Path | None) -> Index | None:
    """Return the index in a file of the cache, None if there is none that can be used."""
    if path is None:
        return None
    try:
        return decode(read_from_cache(path, MAX_BYTES))
    except (OSError, StaleIndexError):
        return None


def keep_index(path: Path | None, index: Index) -> str | None:
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
