"""docs/your-robot.md, typed line by line: its files, its commands, and the robot with its drivers."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cli.machine import Machine, failed
from tests.pages import files, page_text, typed
from tests.waiting import until

PAGE = page_text("your-robot.md")
FILES = files("your-robot.md")
[(EDITED, TABLES)] = re.findall(r"^```toml edit=(\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def _write(folder: Path, *, real: bool = False) -> None:
    """Write the files of the page; with `real`, the body names the drivers, with files in this folder."""
    for name, text in FILES.items():
        if name == EDITED and real:
            text = text[: text.index("[server.Panel]")] + TABLES
            text = re.sub(r'file = "(\S+)"', rf'file = "{folder}/\1"', text)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


def test_without_failsafe_the_robot_drives_though_its_hitch_is_silent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _write(tmp_path)
    (tmp_path / "tow.colony").write_text(FILES["tow.colony"].replace("failsafe module wait", "module wait"))
    assert "REFUTED  waits_for_hitch" in typed("colony verify tow.colony", monkeypatch).out


@pytest.mark.long
def test_the_robot_drives_with_its_drivers(machine: Machine, tmp_path: Path) -> None:
    _write(tmp_path, real=True)
    robot = f"t1={tmp_path / 'robots' / 'tugger' / 'tugger.colony'}"
    hitch = tmp_path / "hitch.txt"
    served = machine.start("serve", "all", "--robot", robot, "--hardware", "--map", "loop")
    until(lambda: "safe\n" in _text(hitch) or failed(served), "the hitch was made safe")
    (tmp_path / "go").touch()
    run = machine.start("drive", str(tmp_path / "tow.colony"), "--robot", robot)
    until(lambda: "drive by cruise" in run.err or failed(served, run), "it drives")
    assert re.match(r"(safe\n)+close\n", _text(hitch))
    (tmp_path / "go").unlink()
    until(lambda: "open\n" in _text(hitch) or failed(served, run), "it opens the hitch")
    assert run.interrupt() == 130
    assert served.interrupt() == 0
    assert _text(hitch).endswith("safe\n")
    names = re.findall(r"^\| (?:a server|`(\w+)`)", PAGE, re.MULTILINE)
    assert set(filter(None, names)) == {"Clock", "DServer", "Limits", "Simulator"}
    assert "t1: Simulator, Clock, RServer, Lidar, Battery, DServer, Limits, Panel, Hitch;" in served.err


def _text(path: Path) -> str:
    return path.read_text() if path.exists() else ""
