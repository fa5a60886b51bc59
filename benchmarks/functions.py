"""Functions and inputs: 1,000 modules that use them throughout, against the same written out."""

from __future__ import annotations

import time
from typing import Any

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text

MODULES = 1000
ROUNDS = 5

HEAD = """robot r {
  sensor s[1000] : mm from DServer.S
  actuator drive { velocity : mm/s, turn : deg/s } to RServer.drive idle drive(velocity = 0, turn = 0)
}
"""
LIBRARY = """
let near(r : mm, limit : mm = 900 mm) = recently(r < limit, 1 s)
let away(left : mm, right : mm, swerve : deg/s) = if left > right then swerve else -swerve
let slow(r : mm, most : mm/s) = clamp(r / 2 s, 0, most)
let clear(scan[] : mm) = min(scan) > 500 mm
module follow {
  input side : mm
  input other : mm
  input scan[] : mm
  param keep = 400 mm
  when near(side, keep) and not near(other) and clear(scan)
  do drive(velocity = slow(side, most = 300 mm/s), turn = away(side, other, swerve = 30 deg/s))
}
"""


def with_functions(modules: int) -> str:
    """Return a program of so many modules, each derived from one with inputs that calls functions."""
    lines = [HEAD, LIBRARY]
    for i in range(modules):
        side, other, scan = _sources(i)
        lines.append(
            f"module m{i} = follow(side = {side}, other = {other}, scan = {scan}, keep = {i + 1} mm)"
        )
    return "\n".join([*lines, _network(modules)])


def written_out(modules: int) -> str:
    """Return the same program without functions and inputs."""
    lines = [HEAD]
    for i in range(modules):
        side, other, scan = _sources(i)
        lines += [f"let side{i} = {side}", f"let other{i} = {other}", f"let scan{i} = {scan}"]
        when = f"recently(side{i} < keep, 1 s) and not recently(other{i} < 900 mm, 1 s)"
        velocity = f"clamp(side{i} / 2 s, 0, 300 mm/s)"
        turn = f"if side{i} > other{i} then 30 deg/s else -30 deg/s"
        lines.append(f"module m{i} {{\n  param keep = {i + 1} mm\n  when {when} and min(scan{i}) > 500 mm")
        lines.append(f"  do drive(velocity = {velocity}, turn = {turn})\n}}")
    return "\n".join([*lines, _network(modules)])


def _sources(i: int) -> tuple[str, str, str]:
    first = i * 7 % 990
    return f"s[{i}]", f"min(s[{first}], s[{first + 3}])", f"s[{first}..{first + 4}]"


def _network(modules: int) -> str:
    return "network {\n  drive = " + " suppresses ".join(f"m{i}" for i in range(modules)) + "\n}\n"


def _seconds(text: str) -> float:
    start = time.perf_counter()
    compile_program(load_text(text))
    return time.perf_counter() - start


def run() -> list[dict[str, Any]]:
    """Return rows of name, value, unit, target, ok, note."""
    texts = with_functions(MODULES), written_out(MODULES)
    rounds = [[_seconds(text) for text in texts] for _ in range(ROUNDS)]
    short, long = (min(seconds) for seconds in zip(*rounds, strict=True))
    name = f"{MODULES:,} modules from text to clients"
    note = f"{len(texts[0]) // 1000} against {len(texts[1]) // 1000} thousand characters"
    return [
        _row(f"{name}, with functions and inputs", short, "s", None, ""),
        _row(f"{name}, written out", long, "s", None, ""),
        _row("functions and inputs, times as long", short / long, "", 1.3, note),
    ]


def _row(name: str, value: float, unit: str, target: float | None, note: str) -> dict[str, Any]:
    ok = target is None or value <= target
    return {"name": name, "value": value, "unit": unit, "target": target, "ok": ok, "note": note}


if __name__ == "__main__":
    for row in run():
        print(row)
