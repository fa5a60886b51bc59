"""docs/devices.md: its tables are the body of a robot, which checks, and its picture is drawn of it."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import pytest

from colony.body.devices import AccelerationErrors, Bumper, Compass, RangeFinder, TurnErrors
from colony.body.model import Faults
from tests.pages import COMMANDS, is_same_picture, typed
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "devices.md").read_text(encoding="utf-8")
BODY = "\n".join(re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
((PATH, INTERFACE),) = re.findall(r"^```colony file=(\S+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def test_the_robot_of_the_page_checks_and_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    interface = tmp_path / PATH
    interface.parent.mkdir(parents=True)
    interface.write_text(INTERFACE, encoding="utf-8")
    interface.with_suffix(".toml").write_text(BODY, encoding="utf-8")
    [(commands, shown)] = COMMANDS.findall(PAGE)
    assert "".join(typed(line, monkeypatch, errors=True) for line in commands.splitlines()) == shown
    assert "](devices.svg)" in PAGE
    assert is_same_picture(tmp_path / "devices.svg", ROOT / "docs" / "devices.svg")


@pytest.mark.parametrize("type_", [RangeFinder, Bumper, TurnErrors, AccelerationErrors, Compass, Faults])
def test_the_page_speaks_of_every_key(type_: type) -> None:
    for field in fields(type_):
        key = field.metadata["key"]
        assert re.search(rf"\b{key}\b", PAGE), key
