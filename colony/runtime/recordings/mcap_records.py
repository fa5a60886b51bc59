"""The trustworthy records of an MCAP recording.

Chunks and attachments have checksums, and so does the metadata of `mcap_writer`. Other records are accepted
only if their length agrees with their content. After a damaged record, everything up to the next chunk is
skipped. Because the recording of a killed run has no index, the reader finds that chunk by its head, which
contains the chunk's length twice. Every size is limited, in the file and unpacked, and reading takes time
linear in the size of the file.
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
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from colony.runtime.recordings.mcap_writer import CHECKSUM, METADATA, checksum
from colony.runtime.recordings.reader import MAGIC

MAX_RECORD_BYTES = 32 * 1024 * 1024
"""Byte limit of a record in a file."""

MAX_CHUNK_BYTES = 8 * 1024 * 1024
"""Byte limit of an unpacked chunk. Colony's have tens of kilobytes, those of other tools megabytes."""

MAX_MESSAGE_BYTES = 4 * 1024 * 1024
"""Byte limit of a message: the size of the largest frame."""

UNPACKED_BASE_BYTES = 64 * 1024 * 1024
MAX_UNPACKED_RATIO = 64
"""Limit on the unpacked bytes of all chunks: a constant plus a multiple of the file size."""

MESSAGES_BASE = 10_000
MESSAGE_BYTES = 2
"""Limit on the number of messages: a constant plus one per `MESSAGE_BYTES` of the file size."""


@dataclass(frozen=True, slots=True)
class Damage:
    """A gap in the records; `reason` describes what was found there.

    `is_attachment` is True for an attachment alone: the records around it are whole.
    """

    reason: str
    is_attachment: bool = False


class Leftover(NamedTuple):
    """Bytes after the end of the recording."""

    size: int


class ChunkMessage(NamedTuple):
    """A message of a chunk whose checksum is correct. `chunk` is the offset of the chunk in the file."""

    channel_id: int
    log_time: int
    data: bytes
    chunk: int = 0


Record = Metadata | Attachment | Channel | ChunkMessage | Damage | Leftover


class TruncatedError(Exception):
    """The file breaks off before the end of its data."""


class RecordTooLargeError(Exception):
    """The file unpacks to more data than any recording."""


class UnchunkedError(Exception):
    """The first message is outside a chunk."""


def read_records(file: BinaryIO, start: int | None = None) -> Iterator[Record]:
    """Yield the records of a file that begins with `MAGIC`, to the end of its data.

    With `start`, the offset of a chunk, yield them from there on.

    Raises:
        TruncatedError: after the last record, if the file breaks off.
        RecordTooLargeError: the file unpacks to more data than any recording.
        UnchunkedError: the first message is outside a chunk, so that it has no checksum.
        OSError: the file cannot be read.
    """
    size = file.seek(0, 2)
    bytes_left = UNPACKED_BASE_BYTES + MAX_UNPACKED_RATIO * size
    messages_left = MESSAGES_BASE + size // MESSAGE_BYTES
    offset, seen_chunk = len(MAGIC) if start is None else start, start is not None
    while True:
        file.seek(offset)
        head = file.read(_MAX_HEAD_BYTES)
        if len(head) < _RECORD.size:
            raise TruncatedError
        opcode, length = _RECORD.unpack_from(head)
        end = offset + _RECORD.size + length
        chunk_head = _chunk_head(head) if opcode == Opcode.CHUNK else None
        if chunk_head is not None and end <= size:
            seen_chunk = True
            bytes_left -= chunk_head.unpacked_size if chunk_head.unpacked_size <= MAX_CHUNK_BYTES else 0
            if bytes_left < 0:
                raise RecordTooLargeError
            file.seek(end - chunk_head.packed_size)
            for record in _read_chunk(chunk_head, file.read(chunk_head.packed_size), offset):
                messages_left -= isinstance(record, ChunkMessage)
                if messages_left < 0:
                    raise RecordTooLargeError
                yield record
            offset = end
            continue
        if opcode == Opcode.DATA_END and length == _DATA_END_BYTES and end <= size:
            yield from _leftover(file, end, size)
            return
        if chunk_head is not None or _may_be_cut_off(opcode, length, len(head)):
            raise TruncatedError
        record_or_damage: Metadata | Attachment | Damage | None = Damage(
            "a record that does not end in the file"
        )
        if end <= size and length <= MAX_RECORD_BYTES:
            file.seek(offset + _RECORD.size)
            record_or_damage = _read_other(opcode, file.read(length), before_chunks=not seen_chunk)
        if isinstance(record_or_damage, Damage) and not record_or_damage.is_attachment:
            next_start = _find_chunk(file, offset + 1, size)
            if next_start is None and end > size and not seen_chunk:
                raise TruncatedError
            yield record_or_damage
            if next_start is None:
                return
            end = next_start
        elif record_or_damage is not None:
            yield record_or_damage
        offset = end


# --- chunks ----------------------------------------------------------------------------------------

_RECORD = struct.Struct("<BQ")
"""Layout of a record's head: opcode, and length of the rest."""

_CHUNK = struct.Struct("<QQQII")
"""Layout of a chunk's head: first and last time, unpacked size, checksum, length of the compression's name.
"""

_COMPRESSIONS = (b"", b"lz4", b"zstd")
_MAX_HEAD_BYTES = _RECORD.size + _CHUNK.size + 4 + 8
_CHUNK_START = re.compile(rb"\x06[\s\S]{4}\x00{4}")
"""Pattern of the first bytes of a chunk of less than 4 GiB."""

_MESSAGE = struct.Struct("<HIQQ")
"""Layout of a message's head: channel, sequence, time of recording and of publishing."""


class _ChunkHead(NamedTuple):
    compression: bytes
    unpacked_size: int
    checksum: int
    packed_size: int


def _may_be_cut_off(opcode: int, length: int, available: int) -> bool:
    """Return True if a record of which `available` bytes were read could be valid but cut off."""
    if opcode == Opcode.CHUNK:
        return available < _MAX_HEAD_BYTES
    return opcode == Opcode.DATA_END and length == _DATA_END_BYTES


def _chunk_head(head: bytes) -> _ChunkHead | None:
    """Parse the head of a chunk; return None if it is not one, or is too short."""
    if len(head) < _MAX_HEAD_BYTES:
        return None
    opcode, length = _RECORD.unpack_from(head)
    _, _, unpacked, crc, name_length = _CHUNK.unpack_from(head, _RECORD.size)
    offset = _RECORD.size + _CHUNK.size
    if opcode != Opcode.CHUNK or name_length > 4:
        return None
    name = head[offset : offset + name_length]
    (packed,) = struct.unpack_from("<Q", head, offset + name_length)
    if name not in _COMPRESSIONS or length != _CHUNK.size + name_length + 8 + packed:
        return None
    return _ChunkHead(name, unpacked, crc, packed) if length <= MAX_RECORD_BYTES else None


def _leftover(file: BinaryIO, offset: int, size: int) -> Iterator[Leftover]:
    """Yield what follows the summary at `offset`, which ends with the next `MAGIC`."""
    block = 1 << 20
    while offset < size:
        file.seek(offset)
        at = file.read(block + len(MAGIC) - 1).find(MAGIC)
        end = offset + at + len(MAGIC)
        if at >= 0:
            yield from [Leftover(size - end)] if end < size else []
            return
        offset += block


def _find_chunk(file: BinaryIO, offset: int, size: int) -> int | None:
    """Return the offset of the first whole chunk at or after `at`, None if there is none."""
    block = 1 << 12  # the next chunk mostly follows soon
    while offset < size:
        file.seek(offset)
        data = file.read(block + _MAX_HEAD_BYTES)
        for match in _CHUNK_START.finditer(data, 0, block + 8):
            chunk_head = _chunk_head(data[match.start() : match.start() + _MAX_HEAD_BYTES])
            start = offset + match.start()
            if (
                chunk_head is not None
                and start + _RECORD.size + _RECORD.unpack_from(data, match.start())[1] <= size
            ):
                return start
        offset, block = offset + block, min(2 * block, 1 << 20)
    return None


def _read_chunk(chunk_head: _ChunkHead, packed: bytes, chunk: int) -> Iterator[Record]:
    """Yield the records in the chunk at offset `chunk`."""
    records = _decompress(chunk_head, packed)
    if isinstance(records, Damage):
        yield records
        return
    offset = 0
    while offset + _RECORD.size <= len(records):
        opcode, length = _RECORD.unpack_from(records, offset)
        offset, end = offset + _RECORD.size, offset + _RECORD.size + length
        if opcode == Opcode.MESSAGE and _MESSAGE.size <= length <= min(
            len(records) - offset, MAX_MESSAGE_BYTES
        ):
            channel_id, _, log_time, _ = _MESSAGE.unpack_from(records, offset)
            yield ChunkMessage(channel_id, log_time, records[offset + _MESSAGE.size : end], chunk)
        elif opcode == Opcode.CHANNEL:
            try:
                yield Channel.read(ReadDataStream(BytesIO(records[offset:end])))
            except Exception:  # by the package, for malformed bytes
                yield Damage("a channel that cannot be read")
        elif opcode != Opcode.SCHEMA:
            yield Damage("a chunk with an unexpected record")
            return
        offset = end


def _decompress(chunk_head: _ChunkHead, packed: bytes) -> bytes | Damage:
    if chunk_head.unpacked_size > MAX_CHUNK_BYTES:
        return Damage(f"a chunk that unpacks to {chunk_head.unpacked_size} bytes")
    if chunk_head.checksum == 0:
        return Damage("a chunk without a checksum")
    try:
        match chunk_head.compression:
            case b"zstd":
                records = _zstd.stream_reader(packed).read(chunk_head.unpacked_size + 1)
            case b"lz4":
                decompressor = lz4.frame.LZ4FrameDecompressor()
                records = decompressor.decompress(packed, max_length=chunk_head.unpacked_size + 1)
            case _:
                records = packed
    except Exception:  # by the packages, for malformed bytes
        return Damage("a chunk that cannot be unpacked")
    if len(records) != chunk_head.unpacked_size or zlib.crc32(records) != chunk_head.checksum:
        return Damage("a chunk with a wrong checksum")
    return records


_zstd = zstandard.ZstdDecompressor(max_window_size=2 * MAX_CHUNK_BYTES)


# --- other records ---------------------------------------------------------------------------------

_DATA_END_BYTES = 4
_IGNORED_BEFORE_CHUNKS: dict[int, type[Header | Schema | Channel]] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
}
"""Types of records that are ignored before the first chunk, because chunks contain them, too."""


def _read_other(opcode: int, content: bytes, *, before_chunks: bool) -> Metadata | Attachment | Damage | None:
    """Return a trustworthy record that is not a chunk; `before_chunks`: no chunk precedes it."""
    if opcode == Opcode.MESSAGE and len(content) >= _MESSAGE.size and before_chunks:
        raise UnchunkedError
    stream = ReadDataStream(BytesIO(content))
    record: object = None
    try:
        if opcode == Opcode.MESSAGE_INDEX and _is_message_index(content):
            return None
        if opcode == Opcode.METADATA:
            record = Metadata.read(stream)
        elif opcode == Opcode.ATTACHMENT:
            record = Attachment.read(stream)
        elif before_chunks and opcode in _IGNORED_BEFORE_CHUNKS:
            record = _IGNORED_BEFORE_CHUNKS[opcode].read(stream)
    except Exception:  # by the package, for malformed bytes
        return Damage("a record that cannot be read", is_attachment=opcode == Opcode.ATTACHMENT)
    if record is None or stream.count != len(content):
        return Damage("a record that does not belong here")
    match record:
        case Metadata(name=name, metadata=members):
            is_colonys = name.startswith(METADATA)
            is_damaged = is_colonys and members.get(CHECKSUM, checksum(members)) != checksum(members)
            return Damage("metadata with a wrong checksum") if is_damaged else record
        case Attachment():
            is_intact = zlib.crc32(content[:-4]) == int.from_bytes(content[-4:], "little")
            return record if is_intact else Damage("an attachment with a wrong checksum", is_attachment=True)
        case _:
            return None


def _is_message_index(content: bytes) -> bool:
    """Return True for a channel, and an array of times and offsets."""
    return len(content) >= 6 and len(content) - 6 == int.from_bytes(content[2:6], "little")
