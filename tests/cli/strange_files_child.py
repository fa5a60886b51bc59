"""Runs a command on one strange file after another, and tells what came of it, a line of JSON each.

    python -m tests.cli.strange_files_child COMMAND FILE...

COMMAND is JSON: the arguments, with `FILE` in the place of the file. The first thing that runs is `--help`,
whose memory the others are held to. A command that hangs ends this process, and the missing line tells which.
"""

from __future__ import annotations

import io
import json
import resource
import signal
import sys
import time

from colony.cli.main import main
from tests.waiting import PATIENCE_S

ROOM = 3 << 30
"""Bytes of address space that a command may take, so that a mistake costs no other process its memory."""


class Stream(io.TextIOWrapper):
    """Output that is no file of the system, as the type says."""


def run(arguments: list[str]) -> dict[str, object]:
    """Run a command; return what it left behind, the seconds it took, and the peak of memory so far in MB."""
    out, err = io.BytesIO(), io.BytesIO()
    sys.argv = ["colony", *arguments]
    sys.stdin = io.TextIOWrapper(io.BytesIO())
    sys.stdout = Stream(out, encoding="utf-8")
    sys.stderr = Stream(err, encoding="utf-8", errors="backslashreplace")
    code: object = "none"
    signal.alarm(int(PATIENCE_S))
    began = time.monotonic()
    try:
        main()
    except SystemExit as ended:
        code = ended.code
    took_s = time.monotonic() - began
    signal.alarm(0)
    sys.stdout.flush()
    sys.stderr.flush()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    told = {"code": code, "out": out.getvalue().decode(), "err": err.getvalue().decode()}
    return {**told, "seconds": took_s, "peak_mb": peak}


def everything() -> None:
    console = sys.stdout
    resource.setrlimit(resource.RLIMIT_AS, (ROOM, ROOM))
    command, files = json.loads(sys.argv[1]), sys.argv[2:]
    runs = [[*command[:1], "--help"], *([file if a == "FILE" else a for a in command] for file in files)]
    for arguments in runs:
        print(json.dumps(run(arguments)), file=console, flush=True)


if __name__ == "__main__":
    everything()
