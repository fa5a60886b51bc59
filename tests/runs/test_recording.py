"""The recording of a run that breaks off: what is said of it is what is in its file."""

from __future__ import annotations

import resource
from collections.abc import Callable
from pathlib import Path

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.compiled import Compiled
from colony.files import open_exclusive
from colony.ir.frame import Frame
from colony.runs.recording import RunRecording
from colony.runs.spec import MisuseError
from colony.runtime.recordings.lines import ByteFile, Recording
from colony.runtime.recordings.mcap_writer import McapRecording
from tests.analysis.recorded_runs import MS, logs, read_lines, read_mcap, run_info

PROGRAM = load_text(
    """
    robot rome {
      sensor near : mm from PServer.near
      actuator lamp { on : bool } to DServer.Lamp idle hold
    }
    module shine { when near < 300 mm do lamp(on = true) }
    network { lamp = shine }
    """
)
COMPILED = compile_program(PROGRAM).compiled
FRAMES = tuple(Frame(k * 50 * MS, {"near": float(k * 7919 % 997)}) for k in range(200))


def mcap(compiled: Compiled, file: ByteFile) -> McapRecording:
    return McapRecording(compiled, run_info(PROGRAM), file)


def broken_off(
    path: Path, sink: Callable[[Compiled, ByteFile], Recording | McapRecording], most: int
) -> RunRecording:
    """A recording whose file may not get larger than `most` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    recording = RunRecording(sink(COMPILED, open_exclusive(str(path))), str(path))
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        for log in logs(PROGRAM, FRAMES):
            recording.take(log)
        recording.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    return recording


@pytest.mark.parametrize("most", [8_000, 8_500, 9_000, 9_500])
def test_it_goes_as_far_as_is_said(tmp_path: Path, most: int) -> None:
    advice = "File too large: raise the limit of file sizes (`ulimit -f`)"
    for sink, read in ((mcap, read_mcap), (Recording, read_lines)):
        path = tmp_path / "run"
        recording = broken_off(path, sink, most)
        frames, _ = read(PROGRAM, path.read_bytes())
        assert 0 < len(frames) < len(FRAMES)
        seconds = frames[-1].frame.t_ns / 1e9
        assert (
            recording.truncation == f"the recording {path} contains only the first {seconds:.2f} s: {advice}"
        )
        recording.expect_frames()


@pytest.mark.parametrize("sink", [mcap, Recording])
def test_one_without_frames_is_none(
    tmp_path: Path, sink: Callable[[Compiled, ByteFile], Recording | McapRecording]
) -> None:
    path = tmp_path / "run"
    size = 0 if sink is Recording else written_before_frames(path)
    recording = broken_off(path, sink, size + 10)
    with pytest.raises(MisuseError, match=f"{path}: error: cannot write: File too large: raise the limit"):
        recording.expect_frames()


def written_before_frames(path: Path) -> int:
    with open_exclusive(str(path)) as file:
        mcap(COMPILED, file)
    return path.stat().st_size
