"""Runs as an observer hands them to a recording, decided by the reference interpreter, for tests."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from typing import Any

from colony.compile.pipeline import compile_program
from colony.execute.compiled import SourceFile
from colony.execute.executor import ModuleExecutor, ProgramExecutor
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.observer import KEYFRAME_NS, Monitor, Sink
from colony.runtime.protocol.messages import Fate, Tick, Verdict
from colony.runtime.recordings.lines import ByteFile, Recording
from colony.runtime.recordings.mcap_reader import McapReader
from colony.runtime.recordings.mcap_writer import McapRecording
from colony.runtime.recordings.reader import LinesReader
from colony.runtime.recordings.recorded import RunInfo
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.agreement import frame_in_base_units

MS = 1_000_000


class Kept(io.BytesIO):
    """A file whose content outlives it, and that keeps its writes apart."""

    def __init__(self) -> None:
        super().__init__()
        self.writes: list[bytes] = []

    def write(self, data: Any, /) -> int:
        self.writes.append(bytes(data))
        return len(data)

    @property
    def content(self) -> bytes:
        return b"".join(self.writes)


def logs(
    program: Program, trace: Sequence[Frame], restarts: Iterable[int] = (), missing: Iterable[int] = ()
) -> list[RunFrame]:
    """A run in which nothing goes wrong, but that all memory begins anew at the frames in `restarts`, and
    that no answer of a module in Python is heard in the frames in `missing`."""
    restarts, missing, start, out = frozenset(restarts), frozenset(missing), 0, []
    interpreter = Interpreter(program)
    compiled = compile_program(program).compiled
    executor = ProgramExecutor(compiled, simplified=False, answers_given=True)
    monitor = Monitor(executor, modules=compiled.python_modules)
    keyframe_ns = trace[0].t_ns - KEYFRAME_NS if trace else 0
    modules = {name: ModuleExecutor(compiled, name) for name in compiled.python_modules}
    clients = {
        a.name: [m.name for m in program.modules if m.actuator == a.name] for a in program.robot.actuators
    }
    for k, frame in enumerate(trace):
        if k in restarts:
            interpreter, start = Interpreter(program), k
            monitor.restart()
            for module in modules.values():
                module.restart()
        keyframe = None
        if k in restarts or frame.t_ns + program.robot.frame_ns - keyframe_ns > KEYFRAME_NS:
            keyframe, keyframe_ns = monitor.keyframe(), frame.t_ns
        answers = {name: module.step(frame_in_base_units(program, frame)) for name, module in modules.items()}
        answers = {} if k in missing else answers
        checked = monitor.check(frame, {}, answers=answers).expected
        outcome = interpreter.step(frame)
        verdicts = {
            d.actuator: Verdict(
                k=k,
                t_ns=frame.t_ns,
                actuator=d.actuator,
                by=d.by,
                values=d.values,
                fault=d.fault,
                fates=tuple((c, _fate(c, d.by, interpreter)) for c in clients[d.actuator]),
            )
            for d in outcome.decisions
        }
        tick = Tick(k=k, t_ns=frame.t_ns, start=start)
        out.append(
            RunFrame(
                tick=tick,
                frame=frame,
                verdicts=verdicts,
                expected=outcome if checked.decisions else checked,
                breaches=outcome.breaches if checked.decisions else (),
                memory_unknown=not checked.decisions,
                restart=k in restarts,
                keyframe=keyframe,
                answers=answers,
            )
        )
    return out


def _fate(client: str, by: str | None, interpreter: Interpreter) -> Fate:
    if client == by:
        return "won"
    if interpreter.is_active(client):
        return "suppressed"
    return "silent" if interpreter.is_silent(client) else "inactive"


def run_info(program: Program, *sources: SourceFile) -> RunInfo:
    clients = compile_program(program).compiled.clients
    root = sources[-1].path if sources else ""
    return RunInfo(
        robot="rome",
        frame_ns=50 * MS,
        seed=7,
        version="1.2.3",
        clients=clients,
        program=root,
        sources=sources,
    )


def written(sink: Sink, frames: Iterable[RunFrame]) -> None:
    for log in frames:
        sink.take(log)
    sink.close()


def mcap_to(file: ByteFile, program: Program, *sources: SourceFile) -> McapRecording:
    return McapRecording(compile_program(program).compiled, run_info(program, *sources), file)


def as_mcap(program: Program, frames: Iterable[RunFrame], *sources: SourceFile) -> Kept:
    file = Kept()
    written(mcap_to(file, program, *sources), frames)
    return file


def as_lines(program: Program, frames: Iterable[RunFrame]) -> Kept:
    file = Kept()
    written(Recording(compile_program(program).compiled, file), frames)
    return file


WAYS = ("logs", "mcap", "lines")
"""Ways of the frames of a run to an auditor: as they are, and through each format of recordings."""


def brought(way: str, program: Program, frames: Sequence[RunFrame]) -> Sequence[RunFrame]:
    """Return the frames of a run as they are on one of `WAYS`."""
    if way == "logs":
        return frames
    if way == "mcap":
        return read_mcap(program, as_mcap(program, frames).content)[0]
    return read_lines(program, as_lines(program, frames).content)[0]


def read_mcap(program: Program, data: bytes) -> tuple[list[RunFrame], McapReader]:
    reader = McapReader(io.BytesIO(data), "run.mcap")
    return list(reader.frames(program)), reader


def read_lines(program: Program, data: bytes) -> tuple[list[RunFrame], LinesReader]:
    reader = LinesReader(io.BytesIO(data), "run.jsonl")
    return list(reader.frames(program)), reader
