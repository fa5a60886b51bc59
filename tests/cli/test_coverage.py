"""`colony coverage` from end to end: of tests, of recordings, and with the tests that it writes."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.cli.explained import recorded
from tests.verify.small_robot import go, robot

ROAM = (
    robot()
    + go("cruise", "true")
    + go("avoid", "sonar < 1 m and not bumper", "0")
    + go("halt", "bumper", "0").replace("module", "failsafe module")
    + """network { drive = halt suppresses avoid suppresses cruise }
limit drive.velocity <= 200 mm/s when level > 50
test "cruises" { at 0 s given sonar = 3 m, bumper = false expect drive by cruise }
"""
)


@pytest.fixture
def roam(tmp_path: Path) -> Path:
    path = tmp_path / "roam.colony"
    path.write_text(ROAM)
    return path


def test_it_counts_by_kind_and_shows_what_would_cover_the_rest(colony: Colony, roam: Path) -> None:
    lines = colony.output("coverage", "roam.colony").splitlines()
    assert lines[0] == "roam.colony: 5 of 19 obligations covered (26.3 %) in 1 frame"
    assert lines[1].split() == ["covered", "uncovered", "unknown", "impossible"]
    assert [line.split()[0] for line in lines[2:7]] == ["module", "node", "condition", "limit", "sensor"]
    at = lines.index("  roam.colony:10:21: no frame in which `sonar < 1 m` is true and decides `avoid`")
    assert lines[at + 1] == "    at 0 s given sonar = 0 mm, bumper = false"


def test_the_tests_that_it_writes_pass_and_cover_everything_once(colony: Colony, roam: Path) -> None:
    colony.output("coverage", "roam.colony", "--generate")
    written = roam.read_text()
    assert written.startswith(ROAM)
    assert written.count("# observed: accept or correct\ntest") == written.count('test "covers: ') > 3
    colony.output("test", "roam.colony")
    out = colony.output("coverage", "roam.colony", "--generate", "--fail-under", "100")
    assert "19 of 19 obligations covered (100.0 %)" in out
    assert roam.read_text() == written


def test_json_has_each_obligation_with_its_place_and_state(colony: Colony, roam: Path) -> None:
    row = json.loads(colony.output("coverage", "roam.colony", "--format", "json"))
    assert (row["counts"]["covered"], row["kinds"]["sensor"]["uncovered"]) == (5, 2)
    (found,) = [o for o in row["obligations"] if (o["subject"], o["text"]) == ("halt", "blind")]
    assert (found["line"], found["state"]) == (11, "uncovered")
    assert found["missing"] == ["`halt` is blind: `bumper` is missing"]


def test_lcov_has_obligations_as_branches_of_lines(colony: Colony, roam: Path) -> None:
    colony.output("coverage", "roam.colony", "--lcov", "roam.info")
    lines = Path("roam.info").read_text().splitlines()
    assert lines[:2] == ["TN:", f"SF:{roam}"]
    branches = [x.rpartition(",")[2] for x in lines if x.startswith("BRDA:9,")]
    assert branches == ["1", "1", "0"]  # active, wins, dominated
    assert "DA:9,2" in lines
    assert ("BRF:19" in lines, "BRH:5" in lines, lines[-1]) == (True, True, "end_of_record")


def test_the_page_shows_below_each_line_what_it_lacks(colony: Colony, roam: Path) -> None:
    colony.output("coverage", "roam.colony", "--html", "roam.html")
    page = Path("roam.html").read_text()
    assert "<p>5 of 19 obligations covered (26.3 %) in 1 frame</p>" in page
    assert "<script" not in page
    assert "http" not in page
    rows = re.findall(r"<tr class=.*?</tr>", page, flags=re.DOTALL)
    assert rows[9].startswith('<tr class="uncovered"><td>10</td><td>0/')
    assert '<mark class="uncovered">sonar &lt; 1 m</mark>' in rows[9]
    lacking = "<li>no frame in which `sonar &lt; 1 m` is true and decides `avoid`"
    assert f"{lacking}<pre>at 0 s given sonar = 0 mm, bumper = false</pre></li>" in rows[9]
    code = (re.sub(r"<ul>.*</ul>|</?mark[^>]*>", "", row, flags=re.DOTALL) for row in rows)
    lines = [unescape(re.fullmatch(r".*<td>(.*)</td></tr>", row)[1]) for row in code]  # type: ignore[index]
    assert lines == ROAM.splitlines()


def test_what_is_proved_impossible_is_left_out(colony: Colony, tmp_path: Path) -> None:
    never = go("never", "sonar < 500 mm and sonar > 1 m")
    text = f'{robot()}{never}network {{ drive = never }}\ntest "t" {{ at 0 s given sonar = 2 m }}\n'
    (tmp_path / "n.colony").write_text(text)
    out = colony.output("coverage", "n.colony")
    assert "impossible, which is proved, and left out of 100 %:" in out
    assert "  n.colony:9:8: no frame in which `never` is active" in out
    assert colony("coverage", "n.colony", "--fail-under", "99").code == 1


def test_recordings_count_in_the_place_of_tests(colony: Colony) -> None:
    Path("run.mcap").write_bytes(recorded())
    tested = json.loads(colony.output("coverage", "wander", "--format", "json"))
    row = json.loads(colony.output("coverage", "wander", "run.mcap", "--format", "json"))
    assert (tested["percent"], row["frames"]) == (100.0, 100)
    states = {(o["subject"], o["text"]): o["state"] for o in row["obligations"]}
    audited = colony.output("explain", "run.mcap", "--when", "drive by avoid", "wander")
    assert (states["avoid", "wins"] == "covered") == ("drive by avoid" in audited)


def test_misuse(colony: Colony, roam: Path) -> None:
    assert "cannot write" in colony.one_line("coverage", "roam.colony", "--lcov", "roam.colony")
    assert colony("coverage", "roam.colony", "no.mcap").code == 2
    roam.write_text("module")
    assert colony("coverage", "roam.colony").code == 1
