"""A recording of wander in which everything happens that `colony explain` tells, and what it prints of it.

`python -m tests.cli.explained` writes the output of the commands again.
"""

from __future__ import annotations

import io
import os
import re
import shlex
import sys
import tempfile
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import pytest

from colony.cli.main import main
from colony.dsl.load import load_file
from colony.ir.frame import Frame
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Fate, Verdict
from tests.analysis.recorded_runs import MS, Kept, as_mcap, logs
from tests.paths import ROOT

WANDER = ROOT / "behaviors" / "wander.colony"
GOLDEN = Path(__file__).with_name("explained.txt")
BLOCKS = re.compile(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", re.MULTILINE)
"""The blocks of the golden file: a command, and what it prints."""


def readings(t_ns: int) -> dict[str, object]:
    """Return what the robot senses: open space, a wall ahead, a bump, no sonars, a corner."""
    ahead = 900.0 if 1000 * MS <= t_ns < 1200 * MS else 250.0 if t_ns >= 4000 * MS else 5000.0
    sonar: list[float] | None = [5000.0] * 24
    sonar = None if 3000 * MS <= t_ns < 3500 * MS else [*sonar[:12], ahead, *sonar[13:]]  # type: ignore[index]
    return {
        "sonar": sonar,
        "front_bumper": 2000 * MS <= t_ns < 2100 * MS,
        "rear_bumper": False,
        "docked_at": 0.0,
    }


@cache
def recorded(write: Callable[..., Kept] = as_mcap, begin_ns: int = 0) -> bytes:
    """Return the recording of a run of five seconds, in which clients are late and an operator drives.

    The run begins at `begin_ns` of the robot's time.
    """
    program = load_file(str(WANDER))
    trace = [Frame(begin_ns + 50 * MS * k, readings(50 * MS * k)) for k in range(100)]  # type: ignore[arg-type]
    return write(program, [_disturbed(log, begin_ns) for log in logs(program, trace)]).content


def _disturbed(log: RunFrame, begin_ns: int) -> RunFrame:
    """Return a frame in which, at some times, `cruise` is late, an operator drives, or the stop is on."""
    verdict = log.verdicts["drive"]
    match (log.frame.t_ns - begin_ns) // (50 * MS):
        case 10:
            changed = _idle(verdict, "cruise", "late")
        case 12 | 13:
            outside = {"outside": "operator/3", "values": (100.0, 0.0)}
            changed = msgspec.structs.replace(_idle(verdict, "cruise", "overridden"), **outside)
        case 15:
            changed = msgspec.structs.replace(_idle(verdict, "cruise", "stopped"), hold="stopped")
        case _:
            return log
    return replace(log, verdicts=dict(log.verdicts) | {"drive": changed})


def _idle(verdict: Verdict, client: str, fate: Fate) -> Verdict:
    fates = tuple((c, fate if c == client else f) for c, f in verdict.fates)
    return msgspec.structs.replace(verdict, by=None, values=(0.0, 0.0), fates=fates)


def printed(command: str) -> str:
    """Return what a command prints, run in this process."""
    out, arguments = io.StringIO(), sys.argv
    sys.argv = shlex.split(command)
    try:
        with redirect_stdout(out), pytest.raises(SystemExit):
            main()
    finally:
        sys.argv = arguments
    return out.getvalue()


def main_() -> None:
    """Write the output of the commands of the golden file again."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        os.chdir(folder)
        Path("run.mcap").write_bytes(recorded())
        commands = [command for command, _ in BLOCKS.findall(GOLDEN.read_text(encoding="utf-8"))]
        GOLDEN.write_text("".join(f"$ {c}\n{printed(c)}" for c in commands), encoding="utf-8")


if __name__ == "__main__":
    main_()
