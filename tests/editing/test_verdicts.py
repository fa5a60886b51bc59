"""Contracts that are proved, and tests that are run, behind a pause: lenses, and what they offer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from colony.editing.server.proofs import PROVE_LIMIT_FACTOR
from tests.editing.client import far_editor
from tests.editing.project import PATROL, Project

FAST = PATROL.replace("velocity = 60 mm/s, turn", "velocity = speed, turn").replace(
    "  let  close = near", "  param speed = 200 mm/s\n  param creep = 60 mm/s\n  let  close = near"
)


@pytest.fixture
def proving(tmp_path: Path) -> Project:
    return Project(tmp_path, prove=True)


def test_lenses_show_verdicts_after_a_pause(proving: Project) -> None:
    assert proving.lenses(proving.uri)[:2] == ["slow: waiting", "turns: waiting"]
    proving.settle()
    found = proving.lenses(proving.uri)
    assert found[:4] == [
        "slow: proved",
        "turns: reached",
        "turns: show the run that gets there",
        "turns: write the test",
    ]
    assert found[4:] == ["avoids what is near: passed", "avoids what is near: run this test"]
    proving.replace(proving.uri, "<= 100 mm/s\n", "<= 50 mm/s\n")
    assert proving.lenses(proving.uri)[0] == "slow: proved (before the last change)"
    proving.settle()
    assert proving.lenses(proving.uri)[:2] == ["slow: REFUTED", "slow: show the run that breaks it"]
    assert "V010" in proving.findings(proving.uri)
    proving.replace(proving.uri, "<= 50 mm/s\n", "<= 100 mm/s\n")
    assert proving.lenses(proving.uri)[0] == "slow: REFUTED (before the last change)"
    proving.settle()
    assert proving.lenses(proving.uri)[0] == "slow: proved"
    assert "V010" not in proving.findings(proving.uri)


def test_a_refuted_contract_is_mended_with_lenses_completion_and_quick_fixes(proving: Project) -> None:
    """A transcript: each step is one that an editor offers."""
    uri = proving.uri
    proving.change(uri, 0, len(PATROL), FAST)
    proving.settle()
    assert proving.lenses(uri)[:3] == [
        *("slow: REFUTED", "slow: show the run that breaks it", "slow: write the test"),
    ]
    shown = proving.ask("workspace/executeCommand", {"command": "colony.showRun", "arguments": [uri, "slow"]})
    assert "avoid: velocity = 200 mm/s" in shown["text"]
    edit = proving.ask(
        "workspace/executeCommand", {"command": "colony.writeTest", "arguments": [uri, "slow"]}
    )
    asked = [m["params"]["edit"] for m in proving.received if m.get("method") == "workspace/applyEdit"]
    assert asked == [edit]
    proving.apply(edit)
    proving.settle()
    assert proving.texts[uri].startswith(FAST)
    name = "counterexample: slow"
    assert f"{name}: FAILED" in proving.lenses(uri)

    proving.replace(uri, "drive(velocity = speed, turn = if", "drive(velocity = cree, turn = if")
    proving.settle()
    assert "E101" in proving.findings(uri)
    assert proving.completions(uri, "drive(velocity = cree|, turn = if")[:2] == ["close", "creep"]
    proving.fix(uri, "write `creep`")
    proving.settle()
    assert [code for code in proving.findings(uri) if code[0] != "V"] == []
    found = proving.lenses(uri)
    assert "slow: proved" in found
    assert f"{name}: passed" in found
    proving.ask("workspace/executeCommand", {"command": "colony.runTest", "arguments": [uri, name]})
    proving.settle()
    messages = [m["params"]["message"] for m in proving.received if m.get("method") == "window/showMessage"]
    assert messages[-1] == f"{name}: passed"


def test_a_module_that_should_be_failsafe_is_offered_to_be(proving: Project) -> None:
    proving.settle()
    assert "V030" in proving.findings(proving.uri)
    proving.replace(proving.uri, "failsafe module avoid", "module avoid")
    proving.settle()
    proving.fix(proving.uri, "write `failsafe module avoid`")
    proving.settle()
    assert "failsafe module avoid" in proving.texts[proving.uri]


def test_a_key_stops_the_proof_and_a_proof_without_end_is_stopped(proving: Project) -> None:
    """The prover of this test never answers."""
    session = proving.session
    proving.prover.answers = lambda job: iter(())  # type: ignore[method-assign]
    proving.settle()
    assert proving.lenses(proving.uri)[0] == "slow: proving"
    assert not session.proofs.stops
    proving.replace(proving.uri, "<= 100 mm/s\n", "<= 99 mm/s\n")
    assert session.proofs.stops
    session.proofs.stops = False
    proving.settle()
    assert proving.lenses(proving.uri)[0] == "slow: proving"
    proving.now += PROVE_LIMIT_FACTOR * session.settings.seconds
    proving.settle()
    assert session.proofs.stops
    assert proving.lenses(proving.uri)[0] == "slow: not decided in time"


def test_commands_about_what_is_not_known_are_refused(proving: Project) -> None:
    for command, arguments, why in (
        ("colony.nothing", [proving.uri, "slow"], "expected one of"),
        ("colony.showRun", [proving.uri], "expected one of"),
        ("colony.showRun", [proving.uri, "no_contract"], "nothing is known"),
    ):
        with pytest.raises(KeyError, match=why):
            proving.ask("workspace/executeCommand", {"command": command, "arguments": arguments})
    proving.settle()
    with pytest.raises(KeyError, match="no test repeats"):
        proving.ask(
            "workspace/executeCommand", {"command": "colony.writeTest", "arguments": [proving.uri, "slow"]}
        )


def test_modules_in_python_run_only_when_asked_for(proving: Project) -> None:
    (proving.folder / "loud.py").write_text(
        "print('loaded', flush=True)\n\nclass Loud:\n    def step(self, frame):\n        return None\n"
    )
    proving.replace(
        proving.uri, "module pause { when paused }", 'module pause from python "loud:Loud" { reads paused }'
    )
    proving.settle()
    assert "avoids what is near: run this test" in proving.lenses(proving.uri)
    assert not [lens for lens in proving.lenses(proving.uri) if "passed" in lens]


def test_a_server_of_its_own_proves_and_is_stopped_by_a_key(tmp_path: Path) -> None:
    """The processes: the editor's, the one that analyzes and the one that proves."""
    near = Project(tmp_path)
    with far_editor() as editor:
        assert "hoverProvider" in editor.initialize(near.folder)["capabilities"]
        uri = editor.open(near.path)
        assert "What is straight ahead." in editor.hover(uri, "let ah|ead")
        for bound in (90, 80, 70):  # each key stops the proof of the text before
            editor.replace(uri, f"<= {bound + 10} mm/s\n", f"<= {bound} mm/s\n")

        def is_proved(message: dict[str, Any]) -> bool:
            params = message.get("params") or {}
            words = {row["name"]: row["verdict"] for row in params.get("verdicts", ())}
            return message.get("method") == "colony/verdicts" and params["state"] == "" and "slow" in words

        editor.wait_until(is_proved)
        assert editor.lenses(uri)[0] == "slow: proved"
        editor.replace(uri, "<= 70 mm/s\n", "<= 50 mm/s\n")
        editor.wait_until(lambda m: "REFUTED" in str(m.get("params")))
        editor.ask("shutdown", None)
        editor.tell("exit", None)
        assert editor.exit_code() == 0


def _run(editor: Project, command: str, name: str) -> Any:
    arguments = {"command": f"colony.{command}", "arguments": [editor.uri, name]}
    found = editor.ask("workspace/executeCommand", arguments)
    editor.settle()
    return found


def _shown(editor: Project) -> str:
    found = [m["params"] for m in editor.received if m.get("method") == "window/showMessage"]
    return str(found[-1]["message"])


def test_a_test_that_is_run_leaves_verdicts_of_an_earlier_text_stale(proving: Project) -> None:
    name = "avoids what is near"
    proving.settle()
    proving.tell("workspace/didChangeConfiguration", {"settings": {"colony": {"prove": False}}})
    proving.replace(proving.uri, "velocity = 60 mm/s, turn", "velocity = 600 mm/s, turn")
    proving.settle()
    _run(proving, "runTest", name)
    assert _shown(proving).startswith(f"{name}: FAILED")
    assert proving.lenses(proving.uri)[0] == "slow: proved (before the last change)"
    proving.replace(proving.uri, "velocity = 600 mm/s, turn", "velocity = 600 mm/s, tur")
    proving.settle()
    _run(proving, "runTest", name)
    assert _shown(proving) == f"{name}: the file has errors"
    assert proving.lenses(proving.uri)[0] == "slow: proved (before the last change)"


def test_no_test_is_written_from_a_verdict_of_an_earlier_text(proving: Project) -> None:
    proving.replace(proving.uri, "<= 100 mm/s\n", "<= 50 mm/s\n")
    proving.settle()
    proving.replace(proving.uri, "when paused", "when pausd")
    for _ in range(2):  # before the analysis, and after it
        with pytest.raises(KeyError, match="`slow` is from before the last change"):
            _run(proving, "writeTest", "slow")


def test_a_file_that_is_closed_unsaved_counts_as_it_is_on_disk(proving: Project) -> None:
    speed = proving.folder / "speed.colony"
    speed.write_text("language 1\nparam creep = 600 mm/s\n")
    proving.replace(proving.uri, "import robot", 'import robot\nimport "speed.colony"')
    proving.replace(proving.uri, "velocity = 60 mm/s, turn", "velocity = creep, turn")
    imported = proving.open(speed)
    proving.replace(imported, "600", "60")
    proving.settle()
    proving.settle()
    assert proving.lenses(proving.uri)[0] == "slow: proved"
    proving.tell("textDocument/didClose", {"textDocument": {"uri": imported}})
    proving.settle()
    proving.settle()
    assert proving.lenses(proving.uri)[0] == "slow: REFUTED"
