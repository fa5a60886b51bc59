"""Explaining a moment of an hour: the index that is built once, and any moment after that.

The recording is a minute of wander in a simulated building, sixty times over, as the runtime writes it. Times
are processor time, so that what else the machine does counts little.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from colony.analysis.finding import build_index, encode
from colony.analysis.recording import OpenRecording
from colony.compile.pipeline import compile_program
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.observer import KEYFRAME_NS
from colony.runtime.recordings.mcap_writer import McapRecording

MINUTES = 60
MINUTE_NS = 60_000_000_000
MOMENTS_S = (1.0, 1800.025, 3599.9)
ROOT = Path(__file__).parent.parent


def run() -> list[dict[str, Any]]:
    """Rows of name, value, unit, target, ok, note."""
    with TemporaryDirectory(prefix="colony-bench-") as name:
        folder = Path(name)
        minute, hour = folder / "minute.mcap", folder / "hour.mcap"
        _colony("run", "wander", "--map", "loop", "--duration", "60", "--record", minute, "--no-picture")
        _write_hour(minute, hour)
        seconds, index_bytes = _index(hour)
        length, size = MINUTES * 60, hour.stat().st_size
        os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
        first = _explain(hour, MOMENTS_S[0])
        times = [_explain(hour, at) for at in MOMENTS_S]
    note = f"{seconds:.0f} s for {length} s; {index_bytes / 1e6:.1f} MB beside {size / 1e6:.1f} MB"
    return [
        _row("building the index / the length of the recording", seconds / length, "times", 0.1, note),
        _row("a moment of an hour, with the index", max(times), "s", 2.0, f"the slowest of {len(times)}"),
        _row("a moment of an hour, without", first, "s", None, "the first question, which builds it"),
    ]


def _row(name: str, value: float, unit: str, target: float | None, note: str) -> dict[str, Any]:
    ok = target is None or value <= target
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": ok, "note": note}


def _colony(*arguments: str | Path) -> None:
    words = [sys.executable, "-m", "colony.cli.main", *map(str, arguments)]
    subprocess.run(words, cwd=ROOT, check=True, capture_output=True)


def _explain(recording: Path, at_s: float) -> float:
    """Return the processor time of a whole command, in seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    _colony("explain", recording, "--at", str(at_s))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _index(recording: Path) -> tuple[float, int]:
    """Return the processor time of building the index, in seconds, and its size in bytes."""
    with OpenRecording.at(recording) as opened:
        program = opened.program()
        start = time.process_time()
        data = encode(build_index(program, opened.reader))
        return time.process_time() - start, len(data)


def _write_hour(minute: Path, hour: Path) -> None:
    with OpenRecording.at(minute) as opened, open(hour, "wb", buffering=0) as file:
        program, run = opened.program(), opened.run
        assert run is not None
        frames = list(opened.reader.frames(program))
        recording = McapRecording(compile_program(program).compiled, run, file)
        for log in _repeated(frames):
            recording.take(log)
        recording.close()


def _repeated(frames: list[RunFrame]) -> Iterator[RunFrame]:
    """Yield the frames of a minute again and again, with the times and numbers of a longer run.

    All keyframes are the first one: only damage would make a reader use them.
    """
    keyframe = next(f.keyframe for f in frames if f.keyframe is not None)
    keyframe_ns = -KEYFRAME_NS
    for k in range(MINUTES * len(frames)):
        minute, i = divmod(k, len(frames))
        t_ns = frames[i].frame.t_ns + minute * MINUTE_NS
        is_due = t_ns - keyframe_ns >= KEYFRAME_NS
        keyframe_ns = t_ns if is_due else keyframe_ns
        yield RunFrame(
            tick=msgspec.structs.replace(frames[i].tick, k=k, t_ns=t_ns, start=0),
            frame=frames[i].frame._replace(t_ns=t_ns),
            verdicts={
                name: msgspec.structs.replace(verdict, k=k, t_ns=t_ns)
                for name, verdict in frames[i].verdicts.items()
            },
            keyframe=keyframe if is_due else None,
        )
