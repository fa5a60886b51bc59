"""The trustworthy records of an MCAP recording.

Chunks and attachments have checksums, and so does the metadata of `mcap_writer`. Other records are accepted
only if their length agrees with their content. From a damaged record on, everything is left out up to the
next chunk. The reader finds that by its head, which contains its length twice: a recording that was killed
has no index. Nothing is larger than its limit, in the file or unpacked.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, MessageIndex, Metadata, Schema

from colony.runtime.recordings.mcap_writer import CHECKSUM, METADATA, checksum
from colony.runtime.recordings.reader import MAGIC

LARGEST_RECORD = 32 * 1024 * 1024
"""Byte limit of a record in a file."""

LARGEST_CHUNK = 8 * 1024 * 1024
"""Byte limit of an unpacked chunk. Ours have some ten thousand, those of other tools some million."""

LARGEST_MESSAGE = 4 * 1024 * 1024
"""Byte limit of a message, which is that of the largest frame."""

UNPACKED_FREE = 64 * 1024 * 1024
UNPACKED_RATIO = 64
"""Limit of the unpacked bytes of all chunks: a free amount, and a multiple of the size of the file."""

MESSAGES_FREE = 10_000
MESSAGE_BYTES = 2
"""Limit of the number of messages: a free amount, and one for each `MESSAGE_BYTES` of the file."""


@dataclass(frozen=True, slots=True)
class Damage:
    """A gap in the records; `reason` is what was found there."""

    reason: str


class ChunkMessage(NamedTuple):
    """A message of a chunk whose checksum is right."""

    channel_id: int
    log_time: int
    data: bytes


Record = Metadata | Attachment | Channel | ChunkMessage | Damage


class TruncatedError(Exception):
    """The file ends before the end of its data."""


class RecordTooLargeError(Exception):
    """The file unpacks to more than recordings do."""


def read_records(file: BinaryIO) -> Iterator[Record]:
    """Yield the records of a file that begins with `MAGIC`, to the end of its data.

    Raises:
        TruncatedError: after the last record, if the file lacks an end.
        RecordTooLargeError: the file unpacks to more than recordings do.
        OSError: the file cannot be read.
    """
    size = file.seek(0, 2)
    allowance, messages = UNPACKED_FREE + UNPACKED_RATIO * size, MESSAGES_FREE + size // MESSAGE_BYTES
    at, chunks = len(MAGIC), False
    while True:
        file.seek(at)
        head = file.read(_LONGEST_HEAD)
        if len(head) < _RECORD.size:
            raise TruncatedError
        opcode, length = _RECORD.unpack_from(head)
        end = at + _RECORD.size + length
        shape = _shape(head) if opcode == Opcode.CHUNK else None
        if shape is not None and end <= size:
            chunks = True
            allowance -= shape.unpacked if shape.unpacked <= LARGEST_CHUNK else 0
            if allowance < 0:
                raise RecordTooLargeError
            file.seek(end - shape.packed)
            for record in _chunk(shape, file.read(shape.packed)):
                messages -= isinstance(record, ChunkMessage)
                if messages < 0:
                    raise RecordTooLargeError
                yield record
            at = end
            continue
        if opcode == Opcode.DATA_END and length == _DATA_END_BYTES and end <= size:
            return
        if shape is not None or _cut_off(opcode, length, len(head)):
            raise TruncatedError
        found: Metadata | Attachment | Damage | None = Damage("a record that does not end in the file")
        if end <= size and length <= LARGEST_RECORD:
            file.seek(at + _RECORD.size)
            found = _other(opcode, file.read(length), first=not chunks)
        if isinstance(found, Damage):
            following = _next_chunk(file, at + 1, size)
            if following is None and end > size and not chunks:
                raise TruncatedError
            yield found
            if following is None:
                return
            end = following
        elif found is not None:
            yield found
        at = end


# --- chunks ----------------------------------------------------------------------------------------

_RECORD = struct.Struct("<BQ")
"""Layout of a record's head: opcode, and length of the rest."""

_CHUNK = struct.Struct("<QQQII")
"""Layout of a chunk's head: first and last time, unpacked size, checksum, length of the compression's name.
"""

_COMPRESSIONS = (b"", b"lz4", b"zstd")
_LONGEST_HEAD = _RECORD.size + _CHUNK.size + 4 + 8
_LIKE_A_CHUNK = re.compile(rb"\x06[\s\S]{4}\x00{4}")
"""Pattern of the first bytes of a chunk of less than 4 GiB."""

_MESSAGE = struct.Struct("<HIQQ")
"""Layout of a message's head: channel, sequence, time of recording and of publishing."""


class _Shape(NamedTuple):
    compression: bytes
    unpacked: int
    checksum: int
    packed: int


def _cut_off(opcode: int, length: int, there: int) -> bool:
    """Return True if the first `there` bytes of a record could be those of a valid one that was cut off."""
    if opcode == Opcode.CHUNK:
        return there < _LONGEST_HEAD
    return opcode == Opcode.DATA_END and length == _DATA_END_BYTES


def _shape(head: bytes) -> _Shape | None:
    """Return the head of a chunk, up to its data; None if it is no chunk, or too short."""
    if len(head) < _LONGEST_HEAD:
        return None
    opcode, length = _RECORD.unpack_from(head)
    _, _, unpacked, found, name_length = _CHUNK.unpack_from(head, _RECORD.size)
    at = _RECORD.size + _CHUNK.size
    if opcode != Opcode.CHUNK or name_length > 4:
        return None
    name = head[at : at + name_length]
    (packed,) = struct.unpack_from("<Q", head, at + name_length)
    if name not in _COMPRESSIONS or length != _CHUNK.size + name_length + 8 + packed:
        return None
    return _Shape(name, unpacked, found, packed) if length <= LARGEST_RECORD else None


def _next_chunk(file: BinaryIO, at: int, size: int) -> int | None:
    """Return the position of the first whole chunk from `at` on, None if there is none."""
    block = 1 << 20
    while at < size:
        file.seek(at)
        data = file.read(block + _LONGEST_HEAD)
        for found in _LIKE_A_CHUNK.finditer(data, 0, block + 8):
            shape = _shape(data[found.start() : found.start() + _LONGEST_HEAD])
            start = at + found.start()
            if (
                shape is not None
                and start + _RECORD.size + _RECORD.unpack_from(data, found.start())[1] <= size
            ):
                return start
        at += block
    return None


def _chunk(shape: _Shape, packed: bytes) -> Iterator[Record]:
    """Yield the records in a chunk."""
    records = _unpacked(shape, packed)
    if isinstance(records, Damage):
        yield records
        return
    at = 0
    while at + _RECORD.size <= len(records):
        opcode, length = _RECORD.unpack_from(records, at)
        at, end = at + _RECORD.size, at + _RECORD.size + length
        if opcode == Opcode.MESSAGE and _MESSAGE.size <= length <= min(len(records) - at, LARGEST_MESSAGE):
            channel_id, _, log_time, _ = _MESSAGE.unpack_from(records, at)
            yield ChunkMessage(channel_id, log_time, records[at + _MESSAGE.size : end])
        elif opcode == Opcode.CHANNEL:
            try:
                yield Channel.read(ReadDataStream(BytesIO(records[at:end])))
            except (EndOfFile, ValueError, struct.error):
                yield Damage("a channel that cannot be read")
        elif opcode != Opcode.SCHEMA:
            yield Damage("a chunk of something else")
            return
        at = end


def _unpacked(shape: _Shape, packed: bytes) -> bytes | Damage:
    if shape.unpacked > LARGEST_CHUNK:
        return Damage(f"a chunk that unpacks to {shape.unpacked} bytes")
    if shape.checksum == 0:
        return Damage("a chunk without a checksum")
    try:
        match shape.compression:
            case b"zstd":
                records = _zstd.stream_reader(packed).read(shape.unpacked + 1)
            case b"lz4":
                unpacking = lz4.frame.LZ4FrameDecompressor()
                records = unpacking.decompress(packed, max_length=shape.unpacked + 1)
            case _:
                records = packed
    except (zstandard.ZstdError, RuntimeError, ValueError, EOFError):
        return Damage("a chunk that cannot be unpacked")
    if len(records) != shape.unpacked or zlib.crc32(records) != shape.checksum:
        return Damage("a chunk with a wrong checksum")
    return records


_zstd = zstandard.ZstdDecompressor(max_window_size=2 * LARGEST_CHUNK)


# --- other records ---------------------------------------------------------------------------------

_DATA_END_BYTES = 4
_IN_HEAD: dict[int, type[Header | Schema | Channel]] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
}
"""Records before the first chunk that are not trusted: chunks contain them, too."""


def _other(opcode: int, content: bytes, *, first: bool) -> Metadata | Attachment | Damage | None:
    """Return the trustworthy content of a record that is no chunk; `first`: it stands before all chunks."""
    stream = ReadDataStream(BytesIO(content))
    found: object = None
    try:
        if opcode == Opcode.MESSAGE_INDEX:
            found = MessageIndex.read(stream)
        elif opcode == Opcode.METADATA:
            found = Metadata.read(stream)
        elif opcode == Opcode.ATTACHMENT:
            found = Attachment.read(stream)
        elif first and opcode in _IN_HEAD:
            found = _IN_HEAD[opcode].read(stream)
    except (EndOfFile, ValueError, struct.error):
        return Damage("a record that cannot be read")
    if found is None or stream.count != len(content):
        return Damage("a record that does not belong here")
    match found:
        case Metadata(name=name, metadata=members):
            ours = name.startswith(METADATA)
            wrong = ours and members.get(CHECKSUM, checksum(members)) != checksum(members)
            return Damage("metadata with a wrong checksum") if wrong else found
        case Attachment():
            right = zlib.crc32(content[:-4]) == int.from_bytes(content[-4:], "little")
            return found if right else Damage("an attachment with a wrong checksum")
        case _:
            return None
