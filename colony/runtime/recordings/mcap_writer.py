"""Recordings as MCAP, which Foxglove and other tools open (`schemas.py` lists the channels).

In addition to the frames, a recording has metadata about the run, and the sources of the program as
attachments: `behavior/...` are the files of the behavior, `body/...` is the body of the robot, and
`python/...` are the files of modules in Python. Everything else can be derived from these.

Frames are in chunks. Each chunk has a checksum, is written in one piece, and begins with a keyframe: the
memory from which a reader resumes if the previous chunk is damaged. A chunk spans less than half a second, so
a killed run loses no more than that. Schemas and channels are in the first chunk, so that its checksum covers
them; attachments have their own checksums, and metadata has one as a member. The `/frames` message is the
last message of its frame. There is no index, which would have to be kept in memory until the end of the run;
`mcap recover` writes a copy with an index.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping
from typing import IO, cast

import msgspec
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, IndexType, Writer

from colony.execute.compiled import Compiled
from colony.ir.frame import Bid
from colony.ir.program import Actuator, in_declared_units
from colony.ir.types import ScalarValue
from colony.ir.version import SEMANTICS
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.observer import KEYFRAME_NS
from colony.runtime.protocol.messages import Fate, Hold, Request, Verdict
from colony.runtime.recordings.json_text import answers_text, keyframe_members, seconds_text, sensor_members
from colony.runtime.recordings.lines import ByteFile, write_all
from colony.runtime.recordings.recorded import RunInfo
from colony.runtime.recordings.replay import site_text
from colony.runtime.recordings.schemas import (
    CONTRACTS,
    FRAMES,
    HEARD,
    KEYFRAMES,
    REQUESTS,
    SHADOW,
    VERDICTS,
    channel_schemas,
)

FORMAT = "colony-recording/2"
"""Format of recordings. Version 1 had no checksums."""

METADATA = "colony"
"""Name of the metadata about the run; `mcap_reader` defines its members."""

CLIENTS = "colony clients of "
"""Prefix of metadata names; metadata `<prefix><actuator>` has the priorities of its clients."""

SITE = "colony params"
"""Name of the metadata about the params that a site set."""

SITE_MEMBER = "json"
"""Name of the member of `SITE` with them as a JSON object."""

CHECKSUM = "checksum"
"""Name of the metadata member with the checksum of the other members."""

CHUNK_BYTES = 1024 * 1024
"""Size in bytes beyond which a chunk is written early."""

MAX_COMPRESSION_RATIO = 32
"""Compression ratio from which a chunk is stored uncompressed: readers reject decompression bombs."""

MEDIA_TYPES = {"behavior": "text/x-colony", "body": "application/toml", "python": "text/x-python"}


class VerdictMessage(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A message of `/verdicts/<actuator>`."""

    k: int
    by: str | None = None
    values: dict[str, float | bool] | None = None
    fates: dict[str, Fate] = {}
    fault: str | None = None
    violation: bool = False
    outside: str | None = None
    unlimited: bool = False
    hold: Hold | None = None
    notes: tuple[str, ...] = ()


class BidMessage(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The bid of one client in a frame."""

    bid: Bid
    values: dict[str, float | bool] | None = None
    fault: str | None = None


class RequestsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A message of `/requests/<actuator>`."""

    k: int
    clients: dict[str, BidMessage]


class HeardMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A message of `/heard/<actuator>`, for a frame in which another controller commanded it."""

    k: int
    values: dict[str, float | bool]
    age_ns: int


class ContractsMessage(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A message of `/contracts`, for a frame in which one was broken, by the program or as `heard`."""

    k: int
    broken: tuple[str, ...]
    heard: tuple[str, ...] = ()


class McapRecording:
    """A sink that writes frames, one chunk at a time. Stateful: keeps the frames of the next chunk.

    Raises:
        OSError: the file cannot be written; everything written before can be read.
    """

    def __init__(self, compiled: Compiled, run: RunInfo, file: ByteFile) -> None:
        self._compiled = compiled
        self._file = file
        self._buffer = _Buffer()
        self._chunk = _Chunk()
        self._keyframes = 0
        self._last_write_succeeded = True
        self._last_frame_ns: int | None = None
        self.written_ns: int | None = None
        """Time of the last frame that is in the file."""
        self._encode = msgspec.json.Encoder().encode
        self._writer = Writer(
            cast(IO[bytes], self._buffer),
            compression=CompressionType.NONE,
            use_chunking=False,
            use_statistics=False,
            index_types=IndexType.ATTACHMENT | IndexType.METADATA,
        )
        try:
            self._begin(run)
            self._flush()
        except BaseException:
            file.close()
            raise

    def take(self, log: RunFrame) -> None:
        """Add the messages of a frame, and write the chunk if it is complete."""
        k, t_ns = log.tick.k, log.tick.t_ns
        if log.keyframe is not None:
            self._flush()
            members = ", ".join([f'"k": {k}', f'"n": {self._keyframes}', *keyframe_members(log.keyframe)])
            self._keyframes += 1
            self._add(KEYFRAMES, k, t_ns, f"{{{members}}}".encode())
        for actuator in self._compiled.robot.actuators:
            verdict = log.verdicts.get(actuator.name)
            if verdict is not None:
                self._add(VERDICTS + actuator.name, k, t_ns, self._encode(_verdict(actuator, verdict)))
            requests = [r for r in log.requests if r.actuator == actuator.name]
            if requests:
                self._add(REQUESTS + actuator.name, k, t_ns, self._encode(_requests(k, actuator, requests)))
            heard = log.heard.get(actuator.name)
            if heard is not None:
                values = _values_by_field(actuator, heard.values) or {}
                message = HeardMessage(k=k, values=values, age_ns=heard.age_ns)
                self._add(HEARD + actuator.name, k, t_ns, self._encode(message))
        if log.breaches or log.heard_breaches:
            broken = ContractsMessage(k=k, broken=log.breaches or (), heard=log.heard_breaches)
            self._add(CONTRACTS, k, t_ns, self._encode(broken))
        self._add(FRAMES, k, t_ns, self._frame(log))
        self._last_frame_ns = log.frame.t_ns
        next_end_ns = t_ns + 2 * self._compiled.robot.frame_ns
        if next_end_ns - self._chunk.first_ns > KEYFRAME_NS or self._chunk.size > CHUNK_BYTES:
            self._flush()

    def close(self) -> None:
        """Write the end of the file, unless an earlier write failed."""
        try:
            if self._last_write_succeeded:
                self._flush()
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._flush()
        finally:
            self._file.close()

    def _begin(self, run: RunInfo) -> None:
        writer = self._writer
        writer.start(library=f"colony {run.version}")
        self._add_metadata(METADATA, _metadata(run))
        if run.site is not None:
            self._add_metadata(SITE, {SITE_MEMBER: site_text(run.site)})
        clients: dict[str, tuple[str, ...]] = {}
        for actuator in self._compiled.robot.actuators:
            priorities = {
                module: str(priority) for name, module, priority in run.clients if name == actuator.name
            }
            self._add_metadata(CLIENTS + actuator.name, priorities)
            clients[actuator.name] = tuple(priorities)
        for source in run.sources:
            name, media_type = f"{source.kind}/{source.path}", MEDIA_TYPES[source.kind]
            writer.add_attachment(
                create_time=0, log_time=0, name=name, media_type=media_type, data=source.data
            )
        self._channels: dict[str, int] = {}
        for known_as, name, schema in channel_schemas(self._compiled, clients, run.heard):
            is_unsent = run.shadow and known_as.startswith((VERDICTS, REQUESTS))
            topic = SHADOW + known_as if is_unsent else known_as
            text = json.dumps(schema).encode()
            schema_id: int = writer.register_schema(name, SchemaEncoding.JSONSchema, text)
            self._channels[known_as] = writer.register_channel(topic, MessageEncoding.JSON, schema_id)
            self._chunk.add_channel(
                Schema(id=schema_id, data=text, encoding=SchemaEncoding.JSONSchema, name=name),
                Channel(
                    id=self._channels[known_as],
                    topic=topic,
                    message_encoding=MessageEncoding.JSON,
                    metadata={},
                    schema_id=schema_id,
                ),
            )

    def _add_metadata(self, name: str, members: dict[str, str]) -> None:
        self._writer.add_metadata(name, {**members, CHECKSUM: checksum(members)})

    def _add(self, topic: str, k: int, t_ns: int, data: bytes) -> None:
        self._chunk.add(self._channels[topic], k, max(t_ns, 0), data)  # MCAP has no time before 0

    def _frame(self, log: RunFrame) -> bytes:
        tick = log.tick
        parts = [
            f'"k": {tick.k}',
            f'"t": {seconds_text(tick.t_ns)}',
            f'"t_ns": {tick.t_ns}',
            f'"start": {tick.start}',
        ]
        if tick.previous != tick.k - 1:
            parts.append(f'"previous": {tick.previous}')
        if log.frame.restarted:
            parts.append('"restarted": true')
        if log.restart:
            parts.append('"restart": true')
        if log.memory_unknown:
            parts.append(f'"skipped": {log.skipped}')
        for name, texts in (("down", tick.down), ("lost", tick.lost), ("disagreements", log.disagreements)):
            if texts:
                parts.append(f'"{name}": {json.dumps(texts)}')
        if log.answers:
            parts.append(f'"python": {answers_text(log.answers)}')
        readings = ", ".join(sensor_members(log.frame, self._compiled.robot.sensors))
        return f'{{{", ".join(parts)}, "sensors": {{{readings}}}}}'.encode()

    def _flush(self) -> None:
        """Write all buffered data; after a failure, `close` writes nothing, as it would be unreadable."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._buffer.write(self._chunk.take())
        self._last_write_succeeded = False
        write_all(self._file, self._buffer.take())
        self._last_write_succeeded = True
        self.written_ns = self._last_frame_ns


_MESSAGE = struct.Struct("<BQHIQQ")
"""Layout before the data of a message: opcode and length of the record, channel, sequence, two times."""


class _Chunk:
    """The records of the next chunk. Mutable."""

    def __init__(self) -> None:
        self._records: list[bytes] = []
        self.first_ns = 0
        self._last_ns = 0
        self.size = 0

    def add_channel(self, schema: Schema, channel: Channel) -> None:
        builder = RecordBuilder()
        schema.write(builder)
        channel.write(builder)
        self._records.append(builder.end())  # type: ignore[no-untyped-call]

    def add(self, channel: int, k: int, t_ns: int, data: bytes) -> None:
        """Add a message."""
        if not self._records:
            self.first_ns = t_ns
        self._last_ns = t_ns
        length = _MESSAGE.size - 9 + len(data)
        self.size += len(data)
        self._records += (_MESSAGE.pack(Opcode.MESSAGE, length, channel, k & 0xFFFFFFFF, t_ns, t_ns), data)

    def take(self) -> bytes:
        """Return the chunk as a record (empty bytes if there are no records), and begin the next chunk."""
        records = b"".join(self._records)
        self._records.clear()
        self.size = 0
        if not records:
            return b""
        builder, packed = RecordBuilder(), _compress(records)
        compressed = len(records) < MAX_COMPRESSION_RATIO * len(packed)
        Chunk(
            compression="zstd" if compressed else "",
            data=packed if compressed else records,
            message_start_time=self.first_ns,
            message_end_time=self._last_ns,
            uncompressed_crc=zlib.crc32(records),
            uncompressed_size=len(records),
        ).write(builder)
        return cast(bytes, builder.end())  # type: ignore[no-untyped-call]


_compress = zstandard.ZstdCompressor(level=1).compress


def checksum(metadata: Mapping[str, str]) -> str:
    """Return the checksum of all metadata members except the checksum itself."""
    members = sorted((name, value) for name, value in metadata.items() if name != CHECKSUM)
    return f"{zlib.crc32(json.dumps(members).encode()):08x}"


class _Buffer:
    """The output of the MCAP writer. Stateful: keeps the unwritten bytes, and counts all bytes."""

    def __init__(self) -> None:
        self._unwritten: list[bytes] = []
        self._length = 0

    def write(self, data: bytes) -> int:
        self._unwritten.append(bytes(data))
        self._length += len(data)
        return len(data)

    def tell(self) -> int:
        return self._length

    def flush(self) -> None:
        """Do nothing: `take` empties the buffer."""

    def take(self) -> bytes:
        data = b"".join(self._unwritten)
        self._unwritten.clear()
        return data


def _metadata(run: RunInfo) -> dict[str, str]:
    return {
        "format": FORMAT,
        "semantics": str(SEMANTICS),
        "version": run.version,
        "robot": run.robot,
        "program": run.program,
        "frame_ns": str(run.frame_ns),
        "seed": str(run.seed),
        "run": run.run,
        "started": run.started,
        **({"shadow": "true"} if run.shadow else {}),
    }


def _verdict(actuator: Actuator, verdict: Verdict) -> VerdictMessage:
    return VerdictMessage(
        k=verdict.k,
        by=verdict.by,
        values=_values_by_field(actuator, verdict.values),
        fates=dict(verdict.fates),
        fault=verdict.fault,
        violation=verdict.violation,
        outside=verdict.outside,
        unlimited=verdict.unlimited,
        hold=verdict.hold,
        notes=verdict.notes,
    )


def _requests(k: int, actuator: Actuator, requests: list[Request]) -> RequestsMessage:
    clients: dict[str, BidMessage] = {}
    for request in requests:
        values = request.values
        if values is not None and len(values) == len(actuator.fields):  # other requests were refused
            values = in_declared_units(values, actuator.fields)
        else:
            values = None
        bid = BidMessage(bid=request.bid, values=_values_by_field(actuator, values), fault=request.fault)
        clients.setdefault(request.client, bid)
    return RequestsMessage(k=k, clients=clients)


def _values_by_field(
    actuator: Actuator, values: tuple[ScalarValue, ...] | None
) -> dict[str, float | bool] | None:
    if values is None:
        return None
    return dict(zip((f.name for f in actuator.fields), values, strict=True))
