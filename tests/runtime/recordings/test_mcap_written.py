"""Recordings as MCAP whose writer is killed, or whose disk is full."""

from __future__ import annotations

import errno
import os
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from colony.runtime.recordings.mcap_reader import McapReader
from tests.paths import ROOT
from tests.runtime.recordings.mcap_files import (
    PROGRAM,
    SOURCES,
    lenient,
    trace,
)
from tests.sampling import sampled
from tests.verify.audit.recorded_runs import Kept, as_mcap, logs, mcap_to, read_mcap, run_info, written


class Full(Kept):
    """A disk with room for so many bytes."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self.room = room

    def write(self, data: Any, /) -> int:
        took = min(self.room, len(data), 100)
        if not took:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.room -= took
        return super().write(bytes(data)[:took])


def test_a_full_disk() -> None:
    right = logs(PROGRAM, trace(20))
    whole = as_mcap(PROGRAM, right).writes
    file = Full(sum(map(len, whole[:2])) + 150)
    recording = mcap_to(file, PROGRAM)
    for log in right[:15]:
        recording.take(log)
    with pytest.raises(OSError, match="No space left"):
        recording.take(right[15])
    recording.close()
    assert file.closed
    found, reader = read_mcap(PROGRAM, file.content)
    assert (len(found), reader.truncation) == (8, "it breaks off in the middle of a frame")


def test_a_disk_that_is_full_at_once() -> None:
    file = Full(10)
    with pytest.raises(OSError, match="No space left"):
        mcap_to(file, PROGRAM)
    assert file.closed


def test_a_disk_that_is_full_in_the_end() -> None:
    right = logs(PROGRAM, trace())
    file = Full(len(as_mcap(PROGRAM, right).content) - 1)
    with pytest.raises(OSError, match="No space left"):
        written(mcap_to(file, PROGRAM), right)
    assert file.closed
    assert len(read_mcap(PROGRAM, file.content)[0]) == 6


WRITER = """
import os, sys
from dataclasses import replace
from itertools import count
import msgspec
from colony.files import open_exclusive
from colony.runtime.recordings.mcap_writer import McapRecording
from tests.runtime.recordings.mcap_files import PROGRAM, SOURCES, trace
from tests.verify.audit.recorded_runs import logs, mcap_to
from tests.sampling import sampled

recording = mcap_to(open_exclusive(sys.argv[1]), PROGRAM, *SOURCES)
[log] = logs(PROGRAM, trace(1))
for k in count():
    verdicts = {name: msgspec.structs.replace(v, k=k) for name, v in log.verdicts.items()}
    tick = msgspec.structs.replace(log.tick, k=k, t_ns=k * 50_000_000)
    recording.take(replace(log, tick=tick, verdicts=verdicts))
    os.write(1, b".")
"""


@pytest.mark.parametrize("seed", sampled(range(3), every=3))
def test_a_killed_process_leaves_every_frame_that_it_had_written(seed: int, tmp_path: Path) -> None:
    """Killed at a moment of chance: all but the last chunk can be read, by both readers."""
    path = tmp_path / "run.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert process.stdout is not None
    with process:
        wanted = random.Random(seed).randint(1, 2000)
        acknowledged = len(process.stdout.read(wanted))
        process.kill()
        acknowledged += len(process.stdout.read())
    assert acknowledged >= wanted
    with path.open("rb") as file:
        reader = McapReader(file, "run.mcap")
        found = list(reader.frames(PROGRAM))
    assert reader.truncation is not None
    assert reader.run == run_info(PROGRAM, *SOURCES)
    assert acknowledged - 8 < len(found) <= acknowledged + 1
    assert [f.tick.k for f in found] == list(range(len(found)))
    assert all(len(f.verdicts) == 2 for f in found)
    assert len([m for m in lenient(path.read_bytes()) if b'"t_ns"' in m.data]) == len(found)
