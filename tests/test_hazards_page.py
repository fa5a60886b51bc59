"""docs/hazards.md: its programs run, and its table has every hazard, every stream and every rate."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import Any

import pytest

from colony.sim.hazards.hazards import Hazard, Hazards
from colony.sim.world import people
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "hazards.md").read_text(encoding="utf-8")
ROWS = [line.strip("|").split("|") for line in PAGE.splitlines() if re.match(r"\| `[A-Z_]+` \| \d", line)]


def test_the_table_has_all_hazards_with_their_streams() -> None:
    assert [(name.strip(" `"), int(stream)) for name, stream, *_ in ROWS] == [
        (h.name, int(h)) for h in Hazard
    ]


def test_the_table_has_all_rates() -> None:
    told = dict(re.findall(r"`([a-z_]+)` ([\d./]+(?: to [\d.]+)?)", " ".join(row[-1] for row in ROWS)))
    expected = {f.name: getattr(Hazards(), f.name) for f in fields(Hazards) if f.name != "on"}
    assert {name: _value(text) for name, text in told.items()} == expected


def _value(text: str) -> Any:
    if " to " in text:
        return tuple(float(part) for part in text.split(" to "))
    above, _, below = text.partition("/")
    return float(above) / float(below or 1)


def test_the_programs_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    for program in re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL):
        exec(program, names)
    assert names["scenery"].people
    assert not names["empty"].people
    assert names["empty"].doors == names["scenery"].doors
    assert names["calm"].glass == names["calm"].doors == ()
    assert names["glass"].doors == ()
    assert names["elevators"].opening("acs.elev.L") == 1.0
    assert names["camera"].image(names["world"].true_pose(0), 0).shape == (120, 240)


@pytest.mark.parametrize(
    ("words", "value"),
    [
        ("less than {} m ahead", people._NOTICE_MM / 1000),
        ("with probability {},", people._STOPPING),
        ("for 1 to {} s", people.LONGEST_STOP_S),
        ("pass at {} m", people._PASSING_MM / 1000),
        ("or {} m where", people._TIGHT_MM / 1000),
        ("within {} s turns", people._BLOCKED_S),
        ("nearer than {} mm", people._BERTH_MM),
    ],
)
def test_what_is_said_of_people_is_so(words: str, value: float) -> None:
    assert words.format(f"{value:g}") in " ".join(PAGE.split())
