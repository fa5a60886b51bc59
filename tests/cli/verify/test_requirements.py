"""`colony verify --report`: requirements, and the contracts that they rest on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from colony.verify.requirements import read_requirements
from tests.cli.conftest import Colony

CONTRACTS = """
contract backs requirement "SR-1": drive by back implies drive.velocity <= 0
contract slow requirement "SR-2", "SR-1": drive.velocity <= 10 m/s
contract quick requirement "SR-4": drive.velocity > -100 mm/s
reach goes requirement "SR-5": drive by back
contract unlinked: true
"""
TABLE = '"SR-1" = "backs <off>"\n"SR-2" = "is slow"\n"SR-3" = "sings"\n"SR-4" = "is quick"\n"SR-5" = "goes"\n'


def test_the_report_says_which_requirements_are_met(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    behavior.write_text(behavior.read_text() + CONTRACTS)
    table = tmp_path / "table.toml"
    table.write_text(TABLE)
    for folder in ("one", "other"):
        done = colony("verify", behavior, "--report", tmp_path / folder, "--requirements", table)
        assert done.code == 1
        assert "requirement SR-3: without contracts\nrequirement SR-4: unmet (quick refuted)\n" in done.out
        assert f"3 of 5 requirements met: {tmp_path / folder / 'index.html'}\n" in done.out
    for name in ("report.json", "index.html"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes()
    report = json.loads((tmp_path / "one" / "report.json").read_text())
    found = {
        each["id"]: (each["status"], [c["contract"] for c in each["contracts"]])
        for each in report["requirements"]
    }
    assert found == {
        "SR-1": ("met", ["backs", "slow"]),
        "SR-2": ("met", ["slow"]),
        "SR-3": ("without contracts", []),
        "SR-4": ("unmet", ["quick"]),
        "SR-5": ("met", ["goes"]),
    }
    covered = {each["id"]: each["coverage"] for each in report["requirements"]}
    of_file = report["files"][0]["coverage"]
    assert covered["SR-3"] == {"covered": 0, "possible": 0}
    assert covered["SR-1"] == {"covered": 9, "possible": 12}  # of all but `shine`
    assert (of_file["covered"], of_file["possible"], len(of_file["uncovered"])) == (12, 15, 3)
    assert {each["path"] for each in report["inputs"]} >= {behavior.name, "table.toml"}
    assert all(len(each["sha256"]) == 64 for each in report["inputs"])
    html = (tmp_path / "one" / "index.html").read_text()
    assert "backs &lt;off&gt;" in html
    assert str(tmp_path) not in html


def test_the_report_says_what_a_verdict_rests_on(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    calm = 'assume calm: not bumper\ncontract stays requirement "SR-8": value_or(not bumper, true)\n'
    behavior.write_text(behavior.read_text() + calm)
    colony("verify", behavior, "--report", tmp_path)
    (required,) = json.loads((tmp_path / "report.json").read_text())["requirements"]
    assert required["contracts"] == [
        {"contract": "stays", "verdict": "proved", "assuming": ["calm"], "in_time": False}
    ]
    assert "stays (assuming calm)" in (tmp_path / "index.html").read_text()


def test_what_the_table_lacks_is_not_met(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    behavior.write_text(behavior.read_text() + 'contract fine requirement "SR-7": true\n')
    assert colony("verify", behavior, "--report", tmp_path / "without").code == 0
    table = tmp_path / "table.csv"
    table.write_text("id,text\n")
    done = colony("verify", behavior, "--report", tmp_path / "with", "--requirements", table)
    assert done.code == 1
    assert "requirement SR-7: without text (fine proved)" in done.out


def test_tables_are_toml_or_csv(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text('text,id\n"one, and two",A-1\n,A-2\n')
    assert read_requirements(path).texts == {"A-1": "one, and two", "A-2": ""}
    for text, said in (
        ("id\nA\n", "the first line must name the columns `id` and `text`"),
        ("id,text\nA,a\nA,b\n", "line 3: `A` is there twice"),
        ("id,text\n,b\n", "line 2: an id is missing"),
        ('id,text\nA,"b\n', "unexpected end of data"),
    ):
        path.write_text(text)
        with pytest.raises(ValueError, match=said):
            read_requirements(path)
    toml = tmp_path / "t.toml"
    toml.write_text("A = 1\n")
    with pytest.raises(ValueError, match="`A` is no text; expected"):
        read_requirements(toml)


def test_misuse(colony: Colony, behavior: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("A = 1\n")
    report = ("--report", tmp_path / "r")
    for options, said in (
        (("--requirements", "t.toml"), "--requirements requires --report DIR"),
        ((*report, "--contract", "x"), "--report is about all contracts"),
        ((*report, "--requirements", "none.toml"), "cannot read none.toml"),
        ((*report, "--requirements", tmp_path / "bad.toml"), "`A` is no text"),
    ):
        done = colony("verify", behavior, *options)
        assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done
        assert said in done.err
