"""Readers of recordings: JSON lines here, MCAP in `mcap_reader.py`.

A run may be killed while it writes. If a recording breaks off in the middle of a frame, the reader ends with
the previous frame, and reports that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, BinaryIO

import msgspec

from colony.files import bounded_lines, reason
from colony.ir.program import Actuator, Program
from colony.runtime.frames.run_frame import FilePosition, HeardCommand, RunFrame
from colony.runtime.protocol.messages import Fate, Hold, Tick, Verdict
from colony.runtime.recordings.json_text import AnswerMessage, read_answers, read_keyframe
from colony.runtime.recordings.replay import LINE_BYTES, SHADOW, RecordingLine, Rows, line_error
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Source, Span

MAGIC = b"\x89MCAP0\r\n"
"""First bytes of MCAP files."""

BREAKS_OFF = "it breaks off in the middle of a frame"


class _Lines:
    """A file of JSON lines. Stateful: keeps the reading position."""

    run = None

    def __init__(self, file: BinaryIO, name: str) -> None:
        self._file = file
        self._name = name
        self._place: FilePosition | None = None
        self.truncation: str | None = None
        self.remarks: list[str] = []
        self.damaged = False
        self.shadow = False

    def go_to(self, place: FilePosition) -> None:
        """Let the first frame be the one at a place in the file; call it before `frames`."""
        self._place = place
        self._file.seek(place.offset)

    def _finish(self, rows: Rows) -> None:
        self.damaged = rows.damaged
        self.truncation = BREAKS_OFF if rows.broken_off else None


class LinesReader(_Lines):
    """A recording in JSON lines. Stateful: keeps the reading position.

    `name` is the file's name in messages. The format contains no information about the run.
    """

    def frames(self, program: Program) -> Iterator[RunFrame]:
        """Yield the frames, as frames of `program`.

        Raises:
            DiagnosticError: at the first bad line. Codes: those of `Rows`, A004 for a malformed decision, and
                A001 if the file cannot be read or a line is too long.
        """
        place = self._place or FilePosition(0, _UNKNOWN_START)
        start = None if self._place is None else self._place.start
        rows = Rows(self._bounded(), self._name, program)
        for index, row in enumerate(rows):
            try:
                members = msgspec.convert(row.values, _Row)
                k = index if members.tick is None else members.tick
                if members.restart or start is None:
                    start = k if members.restart else _start(k, row)
                tick = Tick(k=k, t_ns=row.frame.t_ns, start=start, gaps=gaps(members.previous, k))
                recorded = _recorded_frame(tick, row, program, members)
                recorded = replace(recorded, place=FilePosition(place.offset + row.offset, start))
            except Exception as problem:  # malformed in any way
                message = f"this is not a decision of this program: {problem}"
                raise DiagnosticError(
                    [line_error("A004", self._name, row.number, row.text, 0, message)]
                ) from None
            self.shadow = self.shadow or members.shadow
            if index == 0 and self._place is None:
                self.remarks += begins_in_middle(recorded)
            yield recorded
        self._finish(rows)

    def _bounded(self) -> Iterator[bytes]:
        try:
            yield from bounded_lines(self._file, LINE_BYTES)
        except OSError as problem:
            message = f"cannot read the recording: {reason(problem)}"
            raise DiagnosticError([error("A001", Span(Source(self._name, ""), 0, 0), message)]) from None


class FramesReader(_Lines):
    """Frames in JSON lines, from a recording or another source; members about actuators are ignored.

    Stateful: keeps the reading position.
    """

    def frames(self, program: Program) -> Iterator[RunFrame]:
        """Yield the frames, as frames of `program`, without verdicts.

        Raises:
            DiagnosticError: at the first bad line, with the codes of `Rows`.
            OSError: the file cannot be read.
        """
        rows = Rows(bounded_lines(self._file, LINE_BYTES), self._name, program)
        for index, row in enumerate(rows):
            k = row.values.get("@tick")
            k = k if type(k) is int else index
            self.shadow = self.shadow or row.values.get(SHADOW) is True
            recorded = RunFrame(
                tick=Tick(k=k, t_ns=row.frame.t_ns, start=_start(k, row) if index == 0 else 0),
                frame=row.frame,
                verdicts={},
                restart=row.values.get("@restart") is True,
                memory_unknown=row.values.get("@skipped") is not None,
                keyframe=read_keyframe(row.values.get("@keyframe")),
                damaged=row.damaged,
            )
            if index == 0:
                self.remarks += begins_in_middle(recorded)
            yield recorded
        self._finish(rows)


def gaps(previous: int | None, k: int) -> tuple[tuple[int, int], ...]:
    """Return the gap before frame `k`, if `previous` is the recorded number of the frame before it."""
    return () if previous is None else ((previous, k),)


_UNKNOWN_START = -1
"""Placeholder for the first frame of an epoch, if it is unknown."""


def _start(k: int, row: RecordingLine) -> int:
    """Return the first frame of the epoch of a recording's first line.

    A recorded line without a keyframe is in the middle of an epoch, and so is one whose keyframe has memory
    that is not initial.
    """
    keyframe = read_keyframe(row.values.get("@keyframe"))
    if keyframe is None:
        in_middle = "@sum" in row.values and bool(row.values.get("@tick"))
    else:
        in_middle = keyframe.memory is None or keyframe.memory.first_ns is not None
    return _UNKNOWN_START if row.damaged or in_middle else k


def begins_in_middle(first: RunFrame) -> tuple[str, ...]:
    """Return the remark on a recording whose first frame is this one, if it begins in the middle of a run."""
    if first.damaged or first.restart or first.tick.k == first.tick.start:
        return ()
    return (f"it begins in the middle of a run, with frame {first.tick.k}",)


class _Row(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    rename=lambda name: f"@{name}",
):
    """The members of a line about the frame itself."""

    tick: int | None = None
    previous: int | None = None
    restart: bool = False
    skipped: int | None = None
    keyframe: dict[str, Any] | None = None
    python: dict[str, AnswerMessage] = {}
    shadow: bool = False
    heard: dict[str, dict[str, float | bool] | None] = {}
    heard_broken: tuple[str, ...] = ()


class _Decision(
    msgspec.Struct,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    rename={"outside": "@outside", "unlimited": "@unlimited", "held_by": "@held_by"},
):
    """The members of an actuator's object, apart from the command's fields."""

    by: str | None = None
    fault: str | None = None
    fates: dict[str, Fate] = {}
    outside: str | None = None
    unlimited: bool = False
    held_by: Hold | None = None


def _recorded_frame(tick: Tick, row: RecordingLine, program: Program, members: _Row) -> RunFrame:
    actuators = program.robot.actuators
    verdicts = {a.name: _verdict(tick, a, row.values[a.name]) for a in actuators if a.name in row.values}
    lost = {f"{v.actuator}/{c}" for v in verdicts.values() for c, fate in v.fates if fate == "lost"}
    return RunFrame(
        tick=msgspec.structs.replace(tick, lost=tuple(sorted(lost))),
        frame=row.frame,
        verdicts=verdicts,
        restart=members.restart,
        skipped=members.skipped or 0,
        memory_unknown=members.skipped is not None,
        keyframe=read_keyframe(members.keyframe),
        damaged=row.damaged,
        answers=read_answers(members.python, program),
        heard={a.name: _heard(a, members.heard[a.name]) for a in actuators if a.name in members.heard},
        heard_breaches=members.heard_broken,
    )


def _heard(actuator: Actuator, members: dict[str, float | bool] | None) -> HeardCommand | None:
    if members is None:
        return None
    values = {name: value for name, value in members.items() if name != "@age_ns"}
    return HeardCommand(command_values(actuator, values), int(members["@age_ns"]))


def _verdict(tick: Tick, actuator: Actuator, row: Any) -> Verdict:
    if row is None:
        row = {}
    if not isinstance(row, dict):
        raise msgspec.ValidationError(f"`{actuator.name}` is not an object")
    names = [f.name for f in actuator.fields]
    members = msgspec.convert({key: row[key] for key in row if key not in names}, _Decision)
    values = {name: row[name] for name in names if name in row}
    return Verdict(
        k=tick.k,
        t_ns=tick.t_ns,
        actuator=actuator.name,
        by=members.by,
        values=command_values(actuator, msgspec.convert(values, dict[str, float | bool])) if values else None,
        fates=tuple(members.fates.items()),
        fault=members.fault,
        violation="overruled" in members.fates.values(),
        outside=members.outside,
        unlimited=members.unlimited,
        hold=members.held_by,
    )


def command_values(actuator: Actuator, values: dict[str, float | bool]) -> tuple[float | bool, ...]:
    """Return a recorded command in the order of the actuator's fields.

    Raises:
        msgspec.ValidationError: the command does not have exactly these fields.
    """
    names = [f.name for f in actuator.fields]
    if set(values) != set(names):
        found, expected = ", ".join(values) or "none", ", ".join(names)
        raise msgspec.ValidationError(f"`{actuator.name}` has the fields {found}; expected {expected}")
    return tuple(values[name] for name in names)
