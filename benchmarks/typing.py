"""Typing in a file of 2,000 lines: how soon `colony lsp` answers, and the memory that it takes."""

from __future__ import annotations

import random
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

from tests.editing.client import FarEditor, far_editor

BLOCKS = 200
KEYS = 150
PACE_S = 0.2
HOUR = 18_000
"""Edits of an hour of typing, five a second."""

_HEAD = """language 1

robot rome {
  sensor   sonar[24] : mm  bearing -180 deg  range 0 .. 10000  from PServer.sonar  within 300 ms
  sensor   bumper    : bool                  from RServer.bumper within 300 ms
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive  idle drive(velocity = 0, turn = 0)
}
"""

_BLOCK = """
# Turns away from what is near, number {i}.
param clearance_{i} = {i} * 3 mm
let   near_{i} = min(sonar[{a} deg .. {b} deg])
module avoid_{i} {{
  let  turning = recently(near_{i} < clearance_{i}, 400 ms)
  when turning or bumper
  do   drive(velocity = 60 mm/s, turn = if sonar[90 deg] > sonar[-90 deg] then 30 deg/s else -30 deg/s)
}}
contract slow_{i}: drive by avoid_{i} implies drive.velocity <= 100 mm/s
"""


def program_text(blocks: int) -> str:
    """A program of ten lines a block."""
    parts = [_BLOCK.format(i=i, a=-90 + i % 60, b=i % 90) for i in range(blocks)]
    wiring = " suppresses ".join(f"avoid_{i}" for i in range(blocks))
    return f"{_HEAD}{''.join(parts)}\nnetwork {{ drive = {wiring} }}\n"


class Answer(NamedTuple):
    """How long an answer took, and the processor time of the server meanwhile, in milliseconds."""

    method: str
    took: float
    worked: float


def _processor_ms(pid: int) -> float:
    """The processor time of a process's main thread, whatever else the machine does."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) / 1e6


def _request(draw: random.Random, editor: FarEditor, uri: str, at: dict[str, Any]) -> Answer:
    whole = editor.about(uri)
    requests = {
        "completion": at,
        "hover": at,
        "definition": at,
        "signatureHelp": at,
        "documentHighlight": at,
        "documentSymbol": whole,
        "semanticTokens/full": whole,
        "foldingRange": whole,
        "codeLens": whole,
        "inlayHint": whole,
        "codeAction": {**whole, "context": {"diagnostics": []}},
    }
    method = draw.choice(sorted(requests))
    start, worked = time.perf_counter(), _processor_ms(editor.pid)
    editor.ask(f"textDocument/{method}", requests[method])
    return Answer(method, (time.perf_counter() - start) * 1000, _processor_ms(editor.pid) - worked)


def _type(editor: FarEditor, uri: str, keys: int) -> list[Answer]:
    """Type a module in the middle, five keys a second, with two requests after each key."""
    draw = random.Random(1)
    written = "\nmodule added { when near_3 < clearance_4  do drive(velocity = 40 mm/s, turn = 0) }\n"
    offset = editor.texts[uri].index("\nparam clearance_100") if BLOCKS > 100 else len(_HEAD)
    answers: list[Answer] = []
    for i in range(keys):
        due = time.perf_counter() + PACE_S
        editor.change(uri, offset, offset, written[i % len(written)])
        offset += 1
        for _ in range(2):
            at = editor.at_offset(uri, offset)
            answers.append(_request(draw, editor, uri, at))
        time.sleep(max(0.0, due - time.perf_counter()))
    return answers


def _edit(editor: FarEditor, uri: str, edits: int) -> None:
    """Write and delete words all over the file, as fast as it goes."""
    draw = random.Random(2)
    for i in range(edits):
        text = editor.texts[uri]
        if i % 2 == 0:
            place = draw.randrange(len(text))
            editor.change(uri, place, place, draw.choice(("x", " ", "when", "}", "3 mm")))
            undo = (place, len(editor.texts[uri]) - len(text))
        else:
            editor.change(uri, undo[0], undo[0] + undo[1], "")
        if i % 10 == 0:
            editor.ask("textDocument/hover", editor.at_offset(uri, undo[0]))


def memory_mb(pid: int) -> float:
    """The proportional memory of a process and of those that it started."""
    total, work = 0.0, [pid]
    while work:
        one = work.pop()
        try:
            rows = Path(f"/proc/{one}/smaps_rollup").read_text().splitlines()
            children = Path(f"/proc/{one}/task/{one}/children").read_text().split()
        except OSError:  # it has just ended
            continue
        total += next(int(row.split()[1]) for row in rows if row.startswith("Pss:")) / 1024
        work += map(int, children)
    return total


def run() -> list[dict[str, Any]]:
    """Rows of name, value, unit, target, ok, note."""
    with tempfile.TemporaryDirectory() as folder, far_editor() as editor:
        path = Path(folder).resolve() / "typing.colony"
        path.write_text(program_text(BLOCKS))
        editor.initialize(path.parent)
        start = time.perf_counter()
        uri = editor.open(path)
        editor.ask("textDocument/hover", editor.at_offset(uri, 300))
        opened = time.perf_counter() - start
        answers = _type(editor, uri, KEYS)
        typed = memory_mb(editor.pid)
        _edit(editor, uri, HOUR)
        editor.ask("textDocument/hover", editor.at_offset(uri, 300))
        after = memory_mb(editor.pid)
    took, worked = (sorted(times) for times in zip(*((a.took, a.worked) for a in answers), strict=True))
    late = int(0.95 * len(answers))
    lines = program_text(BLOCKS).count("\n")
    slowest = max(answers, key=lambda a: a.worked).method
    return [
        _row(
            "from opening to the first answer",
            opened * 1000,
            "ms",
            None,
            f"{lines:,} lines, all cold",
        ),
        _row("an answer while typing, median", statistics.median(took), "ms", None, f"of {len(answers)}"),
        _row("an answer while typing, 95 of 100", took[late], "ms", 50.0, "with all else on the machine"),
        _row("processor time of an answer, 95 of 100", worked[late], "ms", 50.0, f"the slowest: {slowest}"),
        _row("memory while typing", typed, "MB", 250.0, "of the server, the analysis and the prover"),
        _row("memory after an hour of edits", after, "MB", 250.0, f"{HOUR:,} edits"),
    ]


def _row(name: str, value: float, unit: str, target: float | None, note: str) -> dict[str, Any]:
    ok = target is None or value <= target
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": ok, "note": note}


if __name__ == "__main__":
    for row in run():
        print(row)
