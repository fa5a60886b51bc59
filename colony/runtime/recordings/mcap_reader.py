"""Reader of the MCAP recordings of `mcap_writer.py`, including files that other tools have rewritten.

Damage among the frames loses only the damaged chunk. If the part before the frames (the run, its program, the
channels) is damaged, nothing can be read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import PurePosixPath
from typing import Any, BinaryIO, Literal, NoReturn

import msgspec
from mcap.records import Attachment, Channel, Metadata

from colony.execute.compiled import SourceFile, is_source_path
from colony.files import size_text
from colony.ir.frame import Frame
from colony.ir.program import Actuator, Program
from colony.ir.version import SEMANTICS, semantics_mismatch
from colony.runtime.observe.monitor import Keyframe
from colony.runtime.protocol.messages import Tick, Verdict
from colony.runtime.recordings.answers import AnswerMessage, read_answers
from colony.runtime.recordings.keyframes import read_keyframe
from colony.runtime.recordings.mcap_records import (
    ChunkMessage,
    Damage,
    Record,
    RecordTooLargeError,
    TruncatedError,
    read_records,
)
from colony.runtime.recordings.mcap_writer import (
    CHECKSUM,
    CLIENTS,
    FORMAT,
    METADATA,
    SITE,
    SITE_MEMBER,
    ContractsMessage,
    VerdictMessage,
)
from colony.runtime.recordings.reader import BREAKS_OFF, command_values, gaps
from colony.runtime.recordings.recorded import Place, RecordedFrame, RunInfo
from colony.runtime.recordings.replay import RECORD_AGAIN
from colony.runtime.recordings.schemas import CONTRACTS, FRAMES, KEYFRAMES, SHADOW, VERDICTS
from colony.runtime.recordings.site import read_site
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Source, Span

SOURCES_BYTES = 32 * 1024 * 1024
"""Maximum total size of the files of a program, in bytes."""


class FrameMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A message of `/frames`. `sensors` stays undecoded: infinity is written as a number that overflows."""

    k: int
    t_ns: int
    sensors: msgspec.Raw
    start: int = 0
    previous: int | None = None
    restart: bool = False
    restarted: bool = False
    skipped: int | None = None
    down: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    python: dict[str, AnswerMessage] = {}


class _RunText(msgspec.Struct, frozen=True, kw_only=True):
    """The metadata of the run; in the file, its numbers are strings.

    Recordings of version 1 of the semantics do not name their version.
    """

    format: str
    semantics: int = 1
    version: str
    robot: str
    program: str
    frame_ns: int
    seed: int
    run: str = ""
    started: str = ""
    shadow: bool = False


class McapReader:
    """An MCAP recording; the constructor reads the part before the first frame. Stateful: keeps the position.

    Raises:
        DiagnosticError: A002, the file is not a recording; A006, the part before the frames is damaged; A007,
            it is of another version of the semantics.
    """

    def __init__(self, file: BinaryIO, name: str) -> None:
        self._name, self._file = name, file
        self._is_at_start = True
        self.truncation: str | None = None
        self.damaged = False
        self._topics: dict[int, str] = {}
        self._actuators: frozenset[str] = frozenset()
        records = self._records(file)
        self.run, first_records = self._read_header(records)
        self.shadow = self.run.shadow
        self._remaining = chain(first_records, records)

    def go_to(self, place: Place) -> None:
        """Let the first frame be the one at a place in the file; call it before `frames`."""
        self._topics.update(place.topics)
        self._remaining = chain((), self._records(self._file, place.offset))
        self._is_at_start = False

    def frames(self, program: Program) -> Iterator[RecordedFrame]:
        """Yield the frames, as frames of `program`.

        Raises:
            DiagnosticError: A004, the frames are not of that program, or malformed.
        """
        for actuator in program.robot.actuators if self._topics else ():
            if actuator.name not in self._actuators:
                self._fail("A004", f"its robot lacks the actuator `{actuator.name}` of this program")
        assembler = _RecordedFrameAssembler(self._topics, program, at_start=self._is_at_start)
        last_ns = None
        for record in self._remaining:
            match record:
                case Damage():
                    self.damaged = True
                    assembler.drop_messages()
                case ChunkMessage():
                    frame = self._frame(assembler, record)
                    if frame is not None:
                        t_ns = frame.frame.t_ns
                        if last_ns is not None and t_ns <= last_ns:
                            self._fail("A004", f"time must increase: {t_ns} ns follows {last_ns} ns")
                        last_ns, self.damaged = t_ns, False
                        yield frame
                case _:
                    pass

    def _frame(self, assembler: _RecordedFrameAssembler, message: ChunkMessage) -> RecordedFrame | None:
        try:
            return assembler.take(message, damaged=self.damaged)
        except (msgspec.MsgspecError, ValueError, RecursionError) as problem:
            text = f"the frame at {message.log_time} ns is not one of this program: {problem}"
            self._fail("A004", text)

    def _records(self, file: BinaryIO, start: int | None = None) -> Iterator[Record]:
        """Yield every record up to the end, and collect the topics of channels."""
        try:
            for record in read_records(file, start):
                if isinstance(record, Channel):
                    self._topics[record.id] = record.topic.removeprefix(SHADOW)
                yield record
        except TruncatedError:
            self.truncation = BREAKS_OFF
        except RecordTooLargeError:
            self._fail("A002", "it unpacks to far more data than any recording")

    def _read_header(self, records: Iterator[Record]) -> tuple[RunInfo, tuple[Record, ...]]:
        metadata: dict[str, Mapping[str, str]] = {}
        sources: list[SourceFile] = []
        first: tuple[Record, ...] = ()
        for record in records:
            match record:
                case ChunkMessage():
                    first = (record,)
                    break
                case Damage(reason=reason) if not self._topics:
                    self._fail(
                        "A006", f"it is damaged before its first frame ({reason}): nothing can be read"
                    )
                case Damage():
                    first = (record,)
                    break
                case Metadata():
                    metadata[record.name] = record.metadata
                case Attachment():
                    sources += _source(record)
                    if sum(len(source.data) for source in sources) > SOURCES_BYTES:
                        self._fail("A002", f"its program is larger than {size_text(SOURCES_BYTES)}")
                case Channel():
                    pass
        return self._run(metadata, tuple(sources)), first

    def _run(self, metadata: Mapping[str, Mapping[str, str]], sources: tuple[SourceFile, ...]) -> RunInfo:
        if METADATA not in metadata:
            suffix = f": {self.truncation}" if self.truncation else ""
            self._fail("A002", f"this is MCAP, but not a recording of a run{suffix}")
        try:
            run = msgspec.convert(metadata[METADATA], _RunText, strict=False)
            clients = tuple(
                (name.removeprefix(CLIENTS), module, int(priority))
                for name, members in metadata.items()
                if name.startswith(CLIENTS)
                for module, priority in members.items()
                if module != CHECKSUM
            )
            site = read_site(json.loads(metadata[SITE][SITE_MEMBER])) if SITE in metadata else None
        except (msgspec.ValidationError, ValueError, KeyError, RecursionError) as problem:
            self._fail("A002", f"its metadata is malformed: {problem}")
        self._actuators = frozenset(
            name.removeprefix(CLIENTS) for name in metadata if name.startswith(CLIENTS)
        )
        if run.format != FORMAT:
            self._fail("A002", f"its format is `{run.format}`; expected `{FORMAT}`")
        if any(CHECKSUM not in metadata[name] for name in metadata if name.startswith(METADATA)):
            self._fail("A006", "it is damaged before its first frame (a checksum is missing)")
        if run.semantics != SEMANTICS:
            mismatch = semantics_mismatch(run.semantics)
            hint = f"{RECORD_AGAIN}; it was recorded by colony {run.version}"
            self._fail("A007", f"the recording {mismatch}", hint)
        return RunInfo(
            robot=run.robot,
            frame_ns=run.frame_ns,
            seed=run.seed,
            version=run.version,
            clients=clients,
            program=run.program,
            sources=sources,
            run=run.run,
            started=run.started,
            shadow=run.shadow,
            site=site,
        )

    def _fail(
        self, code: Literal["A002", "A004", "A006", "A007"], message: str, hint: str | None = None
    ) -> NoReturn:
        raise DiagnosticError([error(code, Span(Source(self._name, ""), 0, 0), message, hint)]) from None


def _source(attachment: Attachment) -> Iterator[SourceFile]:
    """Yield the source file in an attachment, if its kind is known and its path is safe."""
    kind, _, name = attachment.name.partition("/")
    if not is_source_path(name):
        return
    match kind:
        case "behavior" | "body" | "python":
            yield SourceFile(kind=kind, path=str(PurePosixPath(name)), data=attachment.data)
        case _:
            pass


class _RecordedFrameAssembler:
    """Assembles messages into frames. Stateful: keeps the messages of the incomplete frame.

    The `/frames` message is the last message of its frame; if it is missing, the others are dropped. Unless
    `at_start`, the first keyframe may have any number.
    """

    def __init__(self, topics: Mapping[int, str], program: Program, *, at_start: bool) -> None:
        self._topics = topics
        self._chunk = -1
        self._begins_chunk = False
        self._actuators = {VERDICTS + a.name: a for a in program.robot.actuators}
        self.drop_messages()
        self._next_number: int | None = 0 if at_start else None
        self._gap = False
        self._decode_frame = msgspec.json.Decoder(FrameMessage).decode
        self._decode_verdict = msgspec.json.Decoder(VerdictMessage).decode
        self._decode_contracts = msgspec.json.Decoder(ContractsMessage).decode

    def drop_messages(self) -> None:
        """Drop the messages of an incomplete frame."""
        self._is_empty = True
        self._verdicts: dict[str, VerdictMessage] = {}  # by topic
        self._broken: tuple[str, ...] = ()
        self._keyframe: Keyframe | None = None

    def take(self, message: ChunkMessage, *, damaged: bool) -> RecordedFrame | None:
        """Take a message, and return the frame that it completes, if any.

        Raises:
            msgspec.MsgspecError, ValueError: the message is malformed.
        """
        topic = self._topics.get(message.channel_id, "")
        if message.chunk != self._chunk:
            self._chunk, self._begins_chunk = message.chunk, self._is_empty
        self._is_empty = False
        if topic == FRAMES:
            return self._complete(self._decode_frame(message.data), damaged)
        if topic == CONTRACTS:
            self._broken = self._decode_contracts(message.data).broken
        elif topic == KEYFRAMES:
            self._take_keyframe(json.loads(message.data))
        elif topic in self._actuators:
            self._verdicts[topic] = self._decode_verdict(message.data)
        elif topic.startswith(VERDICTS):
            raise ValueError(f"the program has no actuator `{topic.removeprefix(VERDICTS)}`")
        return None

    def _take_keyframe(self, members: Any) -> None:
        """Take a keyframe. If the previous one is missing, another tool has removed damaged data."""
        self._keyframe = read_keyframe(members)
        number = members.get("n") if isinstance(members, dict) else None
        self._gap = self._gap or number != (number if self._next_number is None else self._next_number)
        self._next_number = number + 1 if isinstance(number, int) else 0

    def _complete(self, message: FrameMessage, damaged: bool) -> RecordedFrame:
        t_ns, broken, keyframe = message.t_ns, self._broken, self._keyframe
        verdicts = [
            _to_verdict(self._actuators[topic], verdict, t_ns)
            for topic, verdict in self._verdicts.items()
            if verdict.k == message.k
        ]
        damaged = damaged or self._gap
        place = Place(self._chunk, message.start, tuple(self._topics.items())) if self._begins_chunk else None
        self._gap = self._begins_chunk = False
        self.drop_messages()
        return RecordedFrame(
            tick=Tick(
                k=message.k,
                t_ns=t_ns,
                start=message.start,
                down=message.down,
                lost=message.lost,
                gaps=gaps(message.previous, message.k),
            ),
            frame=Frame(t_ns, _readings(message.sensors), restarted=message.restarted),
            verdicts={verdict.actuator: verdict for verdict in verdicts},
            restart=message.restart,
            skipped=message.skipped or 0,
            memory_unknown=message.skipped is not None,
            breaches=broken,
            keyframe=keyframe,
            damaged=damaged,
            answers=read_answers(message.python),
            place=place,
        )


def _readings(sensors: msgspec.Raw) -> dict[str, Any]:
    readings = json.loads(bytes(sensors))
    if not isinstance(readings, dict):
        raise ValueError("`sensors` is not an object")
    return readings


def _to_verdict(actuator: Actuator, message: VerdictMessage, t_ns: int) -> Verdict:
    return Verdict(
        k=message.k,
        t_ns=t_ns,
        actuator=actuator.name,
        by=message.by,
        values=None if message.values is None else command_values(actuator, message.values),
        fates=tuple(message.fates.items()),
        fault=message.fault,
        violation=message.violation,
        outside=message.outside,
        unlimited=message.unlimited,
        hold=message.hold,
        notes=message.notes,
    )
