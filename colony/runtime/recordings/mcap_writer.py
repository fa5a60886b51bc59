"""Recordings as MCAP, which Foxglove and other tools open (see schemas.py for its channels).

Beside the frames such a recording has the run in its metadata and the sources of the program as attachments:
`behavior/...` the files of the behavior, `python/...` those of modules in Python. All else can be found again
from these.

There are no chunks: a chunk is of use only once it is whole, and a run may be killed at any moment. Instead
each frame leaves in one write, in which the message of `/frames` is the last and so tells that all messages
of its frame are there. `mcap compress` writes a copy with chunks and an index.
"""

from __future__ import annotations

import json
from typing import IO, cast

import msgspec
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from colony.ir.program import Actuator, Program
from colony.ir.types import ScalarValue
from colony.runtime.arbitration import declared_units
from colony.runtime.messages import Bid, Fate, Hold, Request, Verdict
from colony.runtime.observer import FrameLog
from colony.runtime.recordings.lines import ByteFile, seconds_text, sensor_members
from colony.runtime.recordings.recorded import RunInfo
from colony.runtime.recordings.schemas import CONTRACTS, FRAMES, REQUESTS, VERDICTS, channel_schemas

FORMAT = "colony-recording/1"
METADATA = "colony"
"""The name of the metadata that tells of the run; what it must contain is in `mcap_reader`."""

CLIENTS = "colony clients of "
"""Metadata of this name, and an actuator's, have the priority of each of its clients."""

MEDIA_TYPES = {"behavior": "text/x-colony", "python": "text/x-python"}


class VerdictMessage(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A message of `/verdicts/<actuator>`."""

    k: int
    by: str | None = None
    values: dict[str, float | bool] | None = None
    fates: dict[str, Fate] = {}
    fault: str | None = None
    violation: bool = False
    outside: str | None = None
    hold: Hold | None = None
    notes: tuple[str, ...] = ()


class BidMessage(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What one client wanted in a frame."""

    bid: Bid
    values: dict[str, float | bool] | None = None
    fault: str | None = None


class RequestsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A message of `/requests/<actuator>`."""

    k: int
    clients: dict[str, BidMessage]


class ContractsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A message of `/contracts`, of a frame in which one was broken."""

    k: int
    broken: tuple[str, ...]


class McapRecording:
    """Writes each frame as it comes. A sink; mutable: what is not written yet.

    Raises:
        OSError: the file cannot be written; what was written until then can be read.
    """

    def __init__(self, program: Program, run: RunInfo, file: ByteFile) -> None:
        self._program = program
        self._file = file
        self._buffer = _Buffer()
        self._whole = True
        self._encode = msgspec.json.Encoder().encode
        self._writer = Writer(
            cast(IO[bytes], self._buffer),
            compression=CompressionType.NONE,
            use_chunking=False,
            enable_data_crcs=True,
        )
        try:
            self._begin(run)
            self._flush()
        except BaseException:
            file.close()
            raise

    def take(self, log: FrameLog) -> None:
        k, t_ns = log.tick.k, log.tick.t_ns
        for actuator in self._program.robot.actuators:
            verdict = log.verdicts.get(actuator.name)
            if verdict is not None:
                self._add(VERDICTS + actuator.name, k, t_ns, self._encode(_verdict(actuator, verdict)))
            requests = [r for r in log.requests if r.actuator == actuator.name]
            if requests:
                self._add(REQUESTS + actuator.name, k, t_ns, self._encode(_requests(k, actuator, requests)))
        if log.breaches:
            self._add(CONTRACTS, k, t_ns, self._encode(ContractsMessage(k=k, broken=log.breaches)))
        self._add(FRAMES, k, t_ns, self._frame(log))
        self._flush()

    def close(self) -> None:
        """End the file properly, unless something of it could not be written."""
        try:
            if self._whole:
                self._writer.finish()  # type: ignore[no-untyped-call]
                self._flush()
        finally:
            self._file.close()

    def _begin(self, run: RunInfo) -> None:
        writer = self._writer
        writer.start(library=f"colony {run.version}")
        writer.add_metadata(METADATA, _metadata(run))
        clients: dict[str, tuple[str, ...]] = {}
        for actuator in self._program.robot.actuators:
            found = {module: str(priority) for name, module, priority in run.clients if name == actuator.name}
            writer.add_metadata(CLIENTS + actuator.name, found)
            clients[actuator.name] = tuple(found)
        for source in run.sources:
            name, media_type = f"{source.kind}/{source.place}", MEDIA_TYPES[source.kind]
            writer.add_attachment(
                create_time=0, log_time=0, name=name, media_type=media_type, data=source.data
            )
        self._channels: dict[str, int] = {}
        for topic, name, schema in channel_schemas(self._program, clients):
            text = json.dumps(schema).encode()
            schema_id: int = writer.register_schema(name, SchemaEncoding.JSONSchema, text)
            self._channels[topic] = writer.register_channel(topic, MessageEncoding.JSON, schema_id)

    def _add(self, topic: str, k: int, t_ns: int, data: bytes) -> None:
        at = max(t_ns, 0)  # MCAP has no time before 0
        self._writer.add_message(
            self._channels[topic], log_time=at, data=data, publish_time=at, sequence=k & 0xFFFFFFFF
        )

    def _frame(self, log: FrameLog) -> bytes:
        tick = log.tick
        parts = [
            f'"k": {tick.k}',
            f'"t": {seconds_text(tick.t_ns)}',
            f'"t_ns": {tick.t_ns}',
            f'"start": {tick.start}',
        ]
        if log.restart:
            parts.append('"restart": true')
        if log.astray:
            parts.append(f'"skipped": {log.skipped}')
        for name, texts in (("down", tick.down), ("lost", tick.lost), ("disagreements", log.disagreements)):
            if texts:
                parts.append(f'"{name}": {json.dumps(texts)}')
        readings = ", ".join(sensor_members(log.frame, self._program.robot.sensors))
        return f'{{{", ".join(parts)}, "sensors": {{{readings}}}}}'.encode()

    def _flush(self) -> None:
        """Hand over all that waits. Where that fails the rest could not be read, and is not written."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._whole = False
        data = self._buffer.take()
        while data:
            written = self._file.write(data)
            data = b"" if written is None else data[written:]
        self._whole = True


class _Buffer:
    """What the MCAP writer writes into. Mutable: the bytes that wait, and how many there ever were."""

    def __init__(self) -> None:
        self._waiting: list[bytes] = []
        self._length = 0

    def write(self, data: bytes) -> int:
        self._waiting.append(bytes(data))
        self._length += len(data)
        return len(data)

    def tell(self) -> int:
        return self._length

    def flush(self) -> None:
        """Nothing: `take` hands over."""

    def take(self) -> bytes:
        data = b"".join(self._waiting)
        self._waiting.clear()
        return data


def _metadata(run: RunInfo) -> dict[str, str]:
    return {
        "format": FORMAT,
        "version": run.version,
        "robot": run.robot,
        "program": run.program,
        "frame_ns": str(run.frame_ns),
        "seed": str(run.seed),
        "run": run.run,
        "started": run.started,
    }


def _verdict(actuator: Actuator, verdict: Verdict) -> VerdictMessage:
    return VerdictMessage(
        k=verdict.k,
        by=verdict.by,
        values=_named(actuator, verdict.values),
        fates=dict(verdict.fates),
        fault=verdict.fault,
        violation=verdict.violation,
        outside=verdict.outside,
        hold=verdict.hold,
        notes=verdict.notes,
    )


def _requests(k: int, actuator: Actuator, requests: list[Request]) -> RequestsMessage:
    clients: dict[str, BidMessage] = {}
    for request in requests:
        values = request.values
        if values is not None and len(values) == len(actuator.fields):  # others were refused
            values = declared_units(actuator, values)
        else:
            values = None
        bid = BidMessage(bid=request.bid, values=_named(actuator, values), fault=request.fault)
        clients.setdefault(request.client, bid)
    return RequestsMessage(k=k, clients=clients)


def _named(actuator: Actuator, values: tuple[ScalarValue, ...] | None) -> dict[str, float | bool] | None:
    if values is None:
        return None
    return dict(zip((f.name for f in actuator.fields), values, strict=True))
