"""An audit goes on after what is damaged, compares everything else, and never judges by damage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from colony.analysis.audit import Auditor, audit
from colony.analysis.report import AuditReport, DamagedSpan
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from tests.analysis.recorded_runs import MS, as_lines, as_mcap, logs, read_lines, read_mcap
from tests.analysis.test_audit import DEGRADING, changed
from tests.analysis.test_audit import trace as short
from tests.analysis.test_resuming import EVERYTHING
from tests.programs import program

FRAMES = 40
A_CHUNK = 8


def trace(frames: int = FRAMES) -> tuple[Frame, ...]:
    readings = (
        {"a": k % 7 == 2, "b": k % 5 < 2, "c": k % 11 == 4, "x": float(k), "y": float(k // 6)}
        for k in range(frames)
    )
    return tuple(
        Frame(50 * MS * k, {**row, "four": [row["x"] // n for n in (1, 2, 3, 4)]})
        for k, row in enumerate(readings)
    )


def audited(of: Program, frames: Sequence[RunFrame], *, end: bool) -> AuditReport:
    """Audit frames, after which there is damage if it is damaged in the end."""
    auditor = Auditor(of)
    for frame in frames:
        auditor.take(frame)
    auditor.end(damaged=end)
    return auditor.report()


def damaged(data: bytes) -> bytes:
    """One bit in the middle is another."""
    at = len(data) // 2
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


def times(frames: range) -> DamagedSpan:
    """The whole frames around those that are lost."""
    after = None if frames.start == 0 else (frames.start - 1) * 50 * MS
    return DamagedSpan(after_ns=after, before_ns=None if frames.stop == FRAMES else frames.stop * 50 * MS)


@pytest.mark.parametrize("chunk", range(FRAMES // A_CHUNK))
def test_a_damaged_chunk_costs_its_frames_and_no_others(chunk: int) -> None:
    of = program(EVERYTHING)
    file = as_mcap(of, logs(of, trace()))
    file.writes[1 + chunk] = damaged(file.writes[1 + chunk])
    found, reader = read_mcap(of, file.content)
    report = audited(of, found, end=reader.damaged)
    lost = range(chunk * A_CHUNK, (chunk + 1) * A_CHUNK)
    assert report.damaged == (times(lost),)
    assert (report.first, report.forgotten, report.frames) == (None, 0, FRAMES - A_CHUNK)
    assert report.compared == 2 * (FRAMES - A_CHUNK)


@pytest.mark.parametrize("line", range(FRAMES))
def test_a_damaged_line_costs_half_a_second(line: int) -> None:
    of = program(EVERYTHING)
    file = as_lines(of, logs(of, trace()))
    file.writes[line] = damaged(file.writes[line])
    found, reader = read_lines(of, file.content)
    report = audited(of, found, end=reader.damaged)
    assert report.damaged == (times(range(line, line + 1)),)
    assert (report.first, report.frames) == (None, FRAMES - 1)
    assert report.forgotten == (
        A_CHUNK - 1 - line % A_CHUNK if line < FRAMES - A_CHUNK else FRAMES - 1 - line
    )


def test_what_was_decided_wrongly_after_damage_is_found() -> None:
    of = program(EVERYTHING)
    right = logs(of, trace())
    file = as_mcap(of, changed(right, 30, "base", values=(1.0, 0.0)))
    file.writes[2] = damaged(file.writes[2])
    report = audit(of, read_mcap(of, file.content)[0])
    assert (report.first.k, report.differing) == (30, 1)


def test_a_restart_among_what_is_damaged() -> None:
    of = program(EVERYTHING)
    for write, read, at in ((as_mcap, read_mcap, 2), (as_lines, read_lines, 13)):
        file = write(of, logs(of, trace(), restarts=[13]))
        file.writes[at] = damaged(file.writes[at])
        report = audit(of, read(of, file.content)[0])
        assert report.first is None
        assert report.frames - report.forgotten >= FRAMES - A_CHUNK


def test_without_a_keyframe_nothing_is_compared_until_memory_is_initial() -> None:
    of = program(EVERYTHING)
    bare = [replace(log, keyframe=None) for log in logs(of, trace(), restarts=[20])]
    file = as_lines(of, bare)
    file.writes[5] = damaged(file.writes[5])
    report = audit(of, read_lines(of, file.content)[0])
    assert (report.first, report.forgotten) == (None, 14)


def test_after_a_client_was_lost_its_actuator_is_not_compared() -> None:
    """What `on_loss degrade` makes of lost clients is memory that no keyframe has."""
    frames = tuple(frame._replace(t_ns=k * 50 * MS) for k, frame in enumerate(short() * 3))
    right = logs(DEGRADING, frames)
    degraded = [
        log if log.keyframe is None else replace(log, keyframe=log.keyframe._replace(degraded=True))
        for log in right
    ]
    file = as_mcap(DEGRADING, degraded)
    file.writes[2] = damaged(file.writes[2])
    report = audit(DEGRADING, read_mcap(DEGRADING, file.content)[0])
    rest = len(frames) - A_CHUNK
    assert report.first is None
    assert report.compared == rest + A_CHUNK  # the lamp everywhere, the drive before the damage
    assert (report.undecided, report.forgotten) == (rest - A_CHUNK, 0)
