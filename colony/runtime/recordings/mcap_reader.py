"""Reader of the MCAP recordings of `mcap_writer.py`, including files that other tools have rewritten.

Damage among the frames loses only the damaged chunk. If the part before the frames (the run, the channels) is
damaged, nothing can be read. If a file of its program is, the frames can be read with the program from
elsewhere.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
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
from colony.runtime.frames.run_frame import FilePosition, HeardCommand, Keyframe, RunFrame
from colony.runtime.protocol.messages import Tick, Verdict
from colony.runtime.recordings.json_text import (
    AnswerMessage,
    lone_surrogate,
    parse_int,
    read_answers,
    read_keyframe,
)
from colony.runtime.recordings.mcap_records import (
    ChunkMessage,
    Damage,
    Leftover,
    Record,
    RecordTooLargeError,
    TruncatedError,
    UnchunkedError,
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
    HeardMessage,
    VerdictMessage,
)
from colony.runtime.recordings.reader import BREAKS_OFF, begins_in_middle, command_values, gaps
from colony.runtime.recordings.recorded import RunInfo
from colony.runtime.recordings.replay import RECORD_AGAIN, read_site
from colony.runtime.recordings.schemas import CONTRACTS, FRAMES, HEARD, KEYFRAMES, SHADOW, VERDICTS
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Source, Span
from colony.text.wording import counted

SOURCES_BYTES = 32 * 1024 * 1024
"""Maximum total size of the files of a program, in bytes."""

MAX_SOURCES = 4000
"""Maximum number of the files of a program."""

MAX_CHANNELS = 1000
"""Maximum number of channels of colony's topics."""


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
        self.remarks: list[str] = []
        self.damaged = False
        self._topics: dict[int, str] = {}
        self._actuators: frozenset[str] = frozenset()
        records = self._records(file)
        self.run, first_records = self._read_header(records)
        if self.run.program_damage:
            self.remarks.append(f"the program in it is damaged ({self.run.program_damage})")
        self.shadow = self.run.shadow
        self._remaining = chain(first_records, records)

    def go_to(self, place: FilePosition) -> None:
        """Let the first frame be the one at a place in the file; call it before `frames`."""
        self._topics.update(place.topics)
        self._remaining = chain((), self._records(self._file, place.offset))
        self._is_at_start = False

    def frames(self, program: Program) -> Iterator[RunFrame]:
        """Yield the frames, as frames of `program`.

        Raises:
            DiagnosticError: A004, the frames are not of that program, or malformed.
        """
        for actuator in program.robot.actuators if self._topics else ():
            if actuator.name not in self._actuators:
                self._fail("A004", f"its robot lacks the actuator `{actuator.name}` of this program")
        assembler, last_ns = _RecordedFrameAssembler(self._topics, program), None
        for frame in self._assembled(assembler):
            t_ns = frame.frame.t_ns
            if last_ns is not None and t_ns <= last_ns:
                self._fail("A004", f"time must increase: {t_ns} ns follows {last_ns} ns")
            if last_ns is None and self._is_at_start:
                self.remarks += begins_in_middle(frame)
            last_ns, self.damaged = t_ns, False
            yield frame

    def _assembled(self, assembler: _RecordedFrameAssembler) -> Iterator[RunFrame]:
        try:
            for record in self._remaining:
                frame = None
                match record:
                    case ChunkMessage():
                        frame = assembler.take(record, damaged=self.damaged)
                    case Damage(is_attachment=False):
                        frame = assembler.finish(damaged=self.damaged)
                    case _:
                        pass
                if frame is not None:
                    yield frame
                self.damaged = self.damaged or (isinstance(record, Damage) and not record.is_attachment)
            frame = assembler.finish(damaged=self.damaged)
            if frame is not None:
                yield frame
        except (DiagnosticError, OSError):
            raise
        except _OrderError as problem:
            self._fail("A004", str(problem), "`mcap sort` writes a copy in the order of time")
        except Exception as problem:  # malformed in any way
            self._fail("A004", f"the frame after {assembler.place} is not one of this program: {problem}")

    def _records(self, file: BinaryIO, start: int | None = None) -> Iterator[Record]:
        """Yield every record up to the end, and collect the topics of channels."""
        try:
            for record in read_records(file, start):
                if isinstance(record, Channel):
                    self._add_channel(record)
                if isinstance(record, Leftover):
                    left_out = counted(record.size, "byte")
                    self.remarks.append(f"{left_out} after the end of the recording: left out")
                yield record
        except TruncatedError:
            self.truncation = BREAKS_OFF
        except RecordTooLargeError:
            self._fail("A002", "it unpacks to far more data than any recording")
        except UnchunkedError:
            hint = "`mcap recover` writes a copy with chunks"
            self._fail("A002", "its messages are outside chunks, so that they have no checksums", hint)

    def _add_channel(self, channel: Channel) -> None:
        """Remember the topic of a channel, if it is one that frames are made of."""
        topic = channel.topic.removeprefix(SHADOW)
        if topic in (FRAMES, KEYFRAMES, CONTRACTS) or topic.startswith((VERDICTS, HEARD)):
            self._topics[channel.id] = topic
        if len(self._topics) > MAX_CHANNELS:
            self._fail("A002", f"it has more than {MAX_CHANNELS} channels")

    def _read_header(self, records: Iterator[Record]) -> tuple[RunInfo, tuple[Record, ...]]:
        metadata: dict[str, Mapping[str, str]] = {}
        sources: list[SourceFile] = []
        size, program_damage = 0, ""
        first: tuple[Record, ...] = ()
        for record in records:
            match record:
                case ChunkMessage():
                    first = (record,)
                    break
                case Damage(reason=reason, is_attachment=True):
                    program_damage = reason
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
                    size += len(record.data)
                    if size > SOURCES_BYTES:
                        self._fail("A002", f"its program is larger than {size_text(SOURCES_BYTES)}")
                    if len(sources) > MAX_SOURCES:
                        self._fail("A002", f"its program has more than {MAX_SOURCES} files")
                case _:
                    pass
        return replace(self._run(metadata, tuple(sources)), program_damage=program_damage), first

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
        except Exception as problem:  # malformed in any way
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


class _OrderError(ValueError):
    """A message belongs to an earlier frame than the one before it."""


class _RecordedFrameAssembler:
    """Assembles messages into frames. Stateful: keeps the messages of the incomplete frame.

    A frame is complete when a message of the next one follows, so that its own messages may be in any order.
    If its `/frames` message is missing, the others are dropped. The first keyframe may have any number.
    """

    def __init__(self, topics: Mapping[int, str], program: Program) -> None:
        self._topics, self._program = topics, program
        self._chunk = -1
        self._actuators = {VERDICTS + a.name: a for a in program.robot.actuators}
        self._heard_actuators = {HEARD + a.name: a for a in program.robot.actuators}
        self._k: int | None = None
        self._drop_messages()
        self._next_number: int | None = None
        self._gap = False
        self._decode_frame = msgspec.json.Decoder(FrameMessage).decode
        self._decode_verdict = msgspec.json.Decoder(VerdictMessage).decode
        self._decode_contracts = msgspec.json.Decoder(ContractsMessage).decode
        self._decode_heard = msgspec.json.Decoder(HeardMessage).decode

    @property
    def place(self) -> str:
        """The place of the frame before the next one, for messages."""
        return "the beginning" if self._k is None else f"frame {self._k}"

    def _drop_messages(self) -> None:
        self._begins_chunk = False
        self._frame: FrameMessage | None = None
        self._verdicts: dict[str, VerdictMessage] = {}  # by topic
        self._broken: tuple[str, ...] = ()
        self._heard_broken: tuple[str, ...] = ()
        self._heard: dict[str, HeardMessage] = {}  # by topic
        self._keyframe: Keyframe | None = None

    def take(self, message: ChunkMessage, *, damaged: bool) -> RunFrame | None:
        """Take a message, and return the frame before it if it begins another.

        Raises:
            Exception: the message is malformed.
        """
        topic = self._topics.get(message.channel_id, "")
        if topic == FRAMES:
            frame = self._decode_frame(message.data)
            done = self._begin(frame.k, message.chunk, damaged)
            self._frame = frame
        elif topic == CONTRACTS:
            contracts = self._decode_contracts(message.data)
            done = self._begin(contracts.k, message.chunk, damaged)
            self._broken, self._heard_broken = contracts.broken, contracts.heard
        elif topic == KEYFRAMES:
            members = json.loads(message.data)
            done = self._begin(members["k"], message.chunk, damaged)
            self._take_keyframe(members)
        elif topic in self._actuators:
            verdict = self._decode_verdict(message.data)
            done = self._begin(verdict.k, message.chunk, damaged)
            self._verdicts[topic] = verdict
        elif topic in self._heard_actuators:
            heard = self._decode_heard(message.data)
            done = self._begin(heard.k, message.chunk, damaged)
            self._heard[topic] = heard
        elif topic:
            raise ValueError(f"the program has no actuator `{topic.removeprefix(VERDICTS)}`")
        else:
            done = None
        return done

    def _begin(self, k: int, chunk: int, damaged: bool) -> RunFrame | None:
        """Begin frame `k`, if it has not begun; return the frame before it."""
        begins_chunk, self._chunk = chunk != self._chunk, chunk
        if k == self._k:
            return None
        if self._k is not None and k < self._k:
            raise _OrderError(f"its messages are not in the order of time: frame {k} follows frame {self._k}")
        done = self.finish(damaged=damaged)
        self._k, self._begins_chunk = k, begins_chunk
        return done

    def _take_keyframe(self, members: dict[str, Any]) -> None:
        """Take a keyframe. If the previous one is missing, another tool has removed damaged data."""
        self._keyframe = read_keyframe(members)
        number = members.get("n")
        self._gap = self._gap or number != (number if self._next_number is None else self._next_number)
        self._next_number = number + 1 if isinstance(number, int) else 0

    def finish(self, *, damaged: bool) -> RunFrame | None:
        """Return the frame that was taken, None if it is not whole; for `damaged` see `RunFrame`."""
        message = self._frame
        if message is None:
            self._drop_messages()
            return None
        t_ns = message.t_ns
        verdicts = [
            _to_verdict(self._actuators[topic], verdict, t_ns) for topic, verdict in self._verdicts.items()
        ]
        place = (
            FilePosition(self._chunk, message.start, tuple(self._topics.items()))
            if self._begins_chunk
            else None
        )
        frame = RunFrame(
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
            breaches=self._broken,
            keyframe=self._keyframe,
            damaged=damaged or self._gap,
            answers=read_answers(message.python, self._program),
            place=place,
            heard=self._heard_commands(),
            heard_breaches=self._heard_broken,
        )
        self._gap = False
        self._drop_messages()
        return frame

    def _heard_commands(self) -> dict[str, HeardCommand | None]:
        """Return the commands of another controller, None for an actuator that it left alone."""
        found: dict[str, HeardCommand | None] = {}
        for topic in self._topics.values():
            actuator, message = self._heard_actuators.get(topic), self._heard.get(topic)
            if actuator is not None:
                found[actuator.name] = (
                    None
                    if message is None
                    else HeardCommand(command_values(actuator, message.values), message.age_ns)
                )
        return found


def _readings(sensors: msgspec.Raw) -> dict[str, Any]:
    text = bytes(sensors).decode()
    readings = json.loads(text, parse_int=parse_int)
    if lone_surrogate(text, readings) is not None:
        raise ValueError("`sensors` has half of a surrogate pair")
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
