"""The index of a recording as bytes: a header, and a section for each checkpoint.

    magic | length and checksum of the header | header (JSON) | checkpoints, each compressed JSON

The header has the place and checksum of each section. Nothing in an index is believed that has a wrong
checksum, another version or another shape: it is then built again.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import dataclass
from typing import Any

from colony import __version__
from colony.analysis.follower import Checkpoint
from colony.analysis.saved import restored, saved
from colony.analysis.tracks import Change, Tracks
from colony.ir.version import SEMANTICS
from colony.runtime.frames.run_frame import Place

VERSION = 4
"""Version of the index: increment it if its form, or what the interpreter remembers, changes."""

MAGIC = b"colony-index\n"

MAX_BYTES = 256 * 1024 * 1024
"""Byte limit of an index, and of what one of its sections unpacks to."""

_HEAD = struct.Struct("<QI")
"""Length and checksum of the header."""


class StaleIndexError(ValueError):
    """The bytes are not an index of this version, or are damaged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A frame from which the recording can be followed: the memory before it is known.

    `place` is where a reader goes on; `section` and `checksum` are those of its checkpoint.
    """

    t_ns: int
    k: int
    place: Place
    section: tuple[int, int]
    checksum: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Index:
    """An index: what the recording has, and the marks with their checkpoints, in order.

    Attributes:
        frames: Number of frames.
        first_ns: Time of the first frame.
        last_ns: Time of the last frame.
        truncation: How the recording breaks off, None if it is whole.
        remarks: What else of it is not read or not known.
        damaged: Spans of damage as texts.
        tracks: What changed, and when.
        marks: The marks.
        sections: The checkpoints as bytes, one after another.
    """

    frames: int
    first_ns: int
    last_ns: int
    truncation: str | None
    remarks: tuple[str, ...]
    damaged: tuple[str, ...]
    tracks: Tracks
    marks: tuple[Mark, ...]
    sections: bytes

    def checkpoint(self, mark: Mark) -> Checkpoint:
        """Return the memory before the frame of a mark.

        Raises:
            StaleIndexError: it is damaged.
        """
        offset, length = mark.section
        data = self.sections[offset : offset + length]
        if len(data) != length or zlib.crc32(data) != mark.checksum:
            raise StaleIndexError("a checkpoint has a wrong checksum")
        try:
            unpacked = zlib.decompressobj().decompress(data, MAX_BYTES)
            return restored(json.loads(unpacked))
        except (ValueError, zlib.error, RecursionError) as problem:
            raise StaleIndexError(str(problem)) from None


class Sections:
    """The checkpoints of an index that is being built. Stateful."""

    def __init__(self) -> None:
        self._data = bytearray()

    def add(self, checkpoint: Checkpoint) -> tuple[tuple[int, int], int]:
        """Add a checkpoint; return its section and its checksum."""
        packed = zlib.compress(json.dumps(saved(checkpoint)).encode(), 1)
        section = len(self._data), len(packed)
        self._data += packed
        return section, zlib.crc32(packed)

    def __bytes__(self) -> bytes:
        """Return all sections."""
        return bytes(self._data)


def encode(index: Index) -> bytes:
    """Return an index as bytes."""
    header = {
        "version": [VERSION, SEMANTICS, __version__],
        "frames": index.frames,
        "first_ns": index.first_ns,
        "last_ns": index.last_ns,
        "truncation": index.truncation,
        "remarks": list(index.remarks),
        "damaged": list(index.damaged),
        "tracks": index.tracks,
        "topics": list(index.marks[-1].place.topics) if index.marks else [],
        "marks": [[m.t_ns, m.k, m.place.offset, m.place.start, *m.section, m.checksum] for m in index.marks],
    }
    text = json.dumps(header).encode()
    return MAGIC + _HEAD.pack(len(text), zlib.crc32(text)) + text + index.sections


def decode(data: bytes) -> Index:
    """Return the index that bytes are of.

    Raises:
        StaleIndexError: they are no index of this version, or are damaged.
    """
    start = len(MAGIC) + _HEAD.size
    if not data.startswith(MAGIC) or len(data) < start:
        raise StaleIndexError("this is not an index")
    length, checksum = _HEAD.unpack_from(data, len(MAGIC))
    text = data[start : start + length]
    if len(text) != length or zlib.crc32(text) != checksum:
        raise StaleIndexError("the header has a wrong checksum")
    try:
        return _index(json.loads(text), data[start + length :])
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as problem:
        raise StaleIndexError(f"the header is malformed: {problem}") from None


def _index(header: dict[str, Any], sections: bytes) -> Index:
    if header["version"] != [VERSION, SEMANTICS, __version__]:
        raise StaleIndexError("the index is of another version")
    topics = tuple((int(number), str(topic)) for number, topic in header["topics"])
    marks = tuple(
        Mark(
            t_ns=int(t_ns),
            k=int(k),
            place=Place(int(offset), int(first), topics),
            section=(int(section), int(length)),
            checksum=int(checksum),
        )
        for t_ns, k, offset, first, section, length, checksum in header["marks"]
    )
    tracks = {
        str(name): [Change(int(t_ns), int(k), str(value)) for t_ns, k, value in changes]
        for name, changes in header["tracks"].items()
    }
    truncation = header["truncation"]
    return Index(
        frames=int(header["frames"]),
        first_ns=int(header["first_ns"]),
        last_ns=int(header["last_ns"]),
        truncation=None if truncation is None else str(truncation),
        remarks=tuple(str(text) for text in header["remarks"]),
        damaged=tuple(str(text) for text in header["damaged"]),
        tracks=tracks,
        marks=marks,
        sections=sections,
    )
