"""docs/drivers.md: its robot checks, drives over a pseudoterminal, and stands when its driver is killed."""

from __future__ import annotations

import configparser
import math
import re
from pathlib import Path
from typing import Any

import pytest

from colony.drivers.dialect import REFUSALS
from colony.drivers.guard_outbox import REPEATS_NS
from colony.drivers.measurements import Measurements
from colony.drivers.serial_base import DEADLINE_FRAMES, DEADLINE_NS
from colony.runtime.servers.drivers import Reading
from tests.pages import COMMANDS, typed
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "drivers.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```\w+ file=(\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))


def write_files(folder: Path) -> None:
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def test_commands_print_what_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_files(tmp_path)
    ((commands, shown),) = COMMANDS.findall(PAGE)
    printed = "".join(typed(command, monkeypatch, errors=True) for command in commands.splitlines())
    assert sorted(printed.splitlines()) == sorted(shown.splitlines())


def test_the_protocol_of_lines_gives_ranges_and_refuses_damage() -> None:
    module: dict[str, Any] = {}
    exec(FILES["scan_drivers.py"], module)
    dialect = module["Scan"]()
    lines = [
        f"{text}*{sum(text[1:].encode()) % 256:02x}\n" for text in ("R,310,-,1200", "R,abc,2,3", "R,5,9,9")
    ]
    assert "`R,310,-,1200*" + lines[0][-3:-1] in PAGE
    stream = "R,31\xff\n" + lines[0] + lines[0].replace("3", "4") + "".join(lines[1:])
    good, unreadable, outside = dialect.decoder().feed(stream.encode("latin-1"))
    measured = Measurements(rings={}, bounds=dialect.bounds, max_speed=0.0, max_turn=0.0)
    measured.take(dialect.read(good, 0), 0)
    assert measured.readings(0) == {"range": Reading((310.0, math.inf, 1200.0), 0)}
    with pytest.raises(REFUSALS, match="'abc'"):
        dialect.read(unreadable, 0)
    with pytest.raises(REFUSALS, match="range is 5"):
        measured.take(dialect.read(outside, 0), 0)


def test_the_page_has_the_times_of_the_guard() -> None:
    assert f"for {DEADLINE_NS // 1_000_000} ms, or for three frames" in PAGE
    assert DEADLINE_FRAMES == 3
    first, second, third = (t_ns // 1_000_000 for t_ns in REPEATS_NS[1:])
    assert f"after {first}, {second} and {third} ms" in " ".join(PAGE.split())


def test_the_unit_is_one() -> None:
    unit = configparser.ConfigParser(strict=True)
    unit.optionxform = str  # type: ignore[assignment, method-assign]
    unit.read_string(FILES["rover.service"])
    assert unit["Service"]["ExecStart"].endswith("serve all --robot r1=rover --port /dev/rover")
