"""Files as they are while somebody writes: what can be read is known, and nothing fails."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from colony.editing.server import jobs
from colony.editing.server.jobs import Unpacking, packed
from colony.editing.server.protocol import Framing, ProtocolError, framed
from colony.editing.text import Drift, Lines, TextPosition
from tests.editing.client import NearEditor, far_editor
from tests.editing.project import PATROL, Project
from tools.edits import files, run


def test_a_declaration_that_cannot_be_read_leaves_all_others(project: Project) -> None:
    project.replace(project.uri, "  when close\n", "  when (close and \n")
    project.settle()
    assert project.findings(project.uri) == ["E005"]
    found = project.ask("textDocument/documentSymbol", project.about(project.uri))
    names = {symbol["name"] for symbol in found}
    assert {"ahead", "cruise", "gentle", "pause", "roam", "slow"} <= names
    assert "What is straight ahead." in project.hover(project.uri, "min|(sonar") + project.hover(
        project.uri, "let ah|ead"
    )
    assert "close" not in project.completions(project.uri, "speed = 100 mm/s|)")
    assert "bumper" in project.completions(project.uri, "when (close and |\n")


def test_answers_before_the_next_analysis_are_of_the_text_as_it_is(project: Project) -> None:
    project.replace(project.uri, "# What is straight", "# One line\n# and another 🤖: what is straight")
    place = project.at(project.uri, "if sonar[90 deg] > so|nar")
    found = project.ask("textDocument/documentHighlight", place)
    assert [project.text_at({"uri": project.uri, **row}) for row in found] == 5 * ["sonar"]
    project.settle()
    project.replace(project.uri, "limit = room", "limit = 2 * room")
    found = project.ask("textDocument/definition", project.at(project.uri, "limit = 2 * ro|om"))
    assert project.text_at(found) == "room"
    assert project.hover(project.uri, "limit = 2 |* room") == ""


def test_drawn_edits_break_nothing() -> None:
    assert run(files(), 25, seed=1) == 100


@pytest.mark.long
def test_many_drawn_edits_break_nothing() -> None:
    assert run(files(), 1000, seed=2) == 4000


@pytest.mark.parametrize(
    ("then", "now"),
    [("abcdef", "abXdef"), ("abc", "abc"), ("", "abc"), ("aaaa", "aa"), ("abcabc", "abc"), ("x", "yxy")],
)
def test_the_difference_of_two_texts_makes_one_of_the_other(then: str, now: str) -> None:
    drift = Drift.between(then, now)
    if then == now:
        assert drift.start < 0
        return
    assert then[: drift.start] + now[drift.start : drift.now] + then[drift.then :] == now


def test_a_place_outlives_changes_around_it() -> None:
    text, drift = "one two three four", Drift()
    for start, end, new in ((0, 3, "1"), (12, 14, "4"), (2, 2, "and ")):
        text = text[:start] + new + text[end:]
        drift.change(start, end, len(new))
    assert text == "1 and two three 4ur"
    assert drift.to_now(0) == 0
    assert drift.to_now(17) == text.index("r", 16)
    assert drift.to_then(text.index("r", 16)) == 17
    assert drift.to_now(5) is None


def test_positions_count_in_utf_16() -> None:
    lines = Lines("a🤖b\r\nc\rd\n")
    assert [lines.position(i) for i in (0, 2, 3, 5, 7)] == [
        TextPosition(*row) for row in ((0, 0), (0, 3), (0, 4), (1, 0), (2, 0))
    ]
    assert [lines.offset(TextPosition(*row)) for row in ((0, 3), (0, 99), (1, 1), (2, 0), (9, 0))] == [
        2,
        3,
        6,
        7,
        9,
    ]


def test_messages_come_in_any_pieces() -> None:
    data = framed({"id": 1}) + framed({"id": 2})
    framing = Framing()
    assert [body for byte in data for body in framing.feed(bytes([byte]))] == [b'{"id":1}', b'{"id":2}']
    for length in (b"x", b"1" * 5000):
        with pytest.raises(ProtocolError):
            list(Framing().feed(b"Content-Length: %b\r\n\r\n" % length))
    program = jobs.OpenProgram("/a.colony", {"/a.colony": "text"})
    for job in (jobs.AnalyzeJob(1, program), jobs.FormatJob(2, "/a", "b"), jobs.ProveJob(4, program, 5.0)):
        assert list(Unpacking().feed(packed(job), jobs.Job)) == [job]  # type: ignore[arg-type]


@pytest.mark.parametrize("data", [b"{", b'{"id":7,"method":"exit","params":' + b"[" * 100_000])
def test_a_message_that_is_no_json_is_refused_and_the_next_one_answered(
    project: Project, data: bytes
) -> None:
    project.session.receive(data, project.now)
    assert b"-32700" in project.session.out.pop()
    assert project.hover(project.uri, "let ah|ead")


@pytest.mark.parametrize("uri", ["file://[x/a.colony", "file:///a%00b.colony"])
def test_a_uri_that_names_no_file_is_refused(project: Project, uri: str) -> None:
    item = {"uri": uri, "version": 1, "text": "let a = 1\n"}
    project.tell("textDocument/didOpen", {"textDocument": item})
    at = {"textDocument": {"uri": uri}, "position": {"line": 0, "character": 4}}
    with pytest.raises(KeyError, match="is not open"):
        project.ask("textDocument/hover", at)
    with pytest.raises(KeyError, match="names no file"):
        NearEditor().ask("initialize", {"rootUri": uri, "capabilities": {}})
    assert project.hover(project.uri, "let ah|ead")


def test_an_analysis_that_fails_is_reported_and_the_session_goes_on(
    project: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*arguments: object) -> None:
        raise ZeroDivisionError("no such index")

    analyzer = project.worker._analyzer
    monkeypatch.setattr(type(analyzer), "analyze", fail)
    project.replace(project.uri, "# What is", "# what is")
    project.settle()
    (message,) = [m["params"]["message"] for m in project.received if m.get("method") == "window/logMessage"]
    assert "no such index" in message
    assert project.hover(project.uri, "let ah|ead")
    with pytest.raises(KeyError, match="a bug in colony"):
        project.ask("textDocument/rename", {**project.at(project.uri, "let ah|ead"), "newName": "x"})


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_worker_that_dies_is_started_again(tmp_path: Path) -> None:
    near = Project(tmp_path)
    with far_editor() as editor:
        editor.initialize(near.folder, prove=False)
        uri = editor.open(near.path)
        assert editor.hover(uri, "let ah|ead")
        (worker,) = Path(f"/proc/{editor.pid}/task/{editor.pid}/children").read_text().split()
        os.kill(int(worker), signal.SIGKILL)
        editor.replace(uri, "# What is straight ahead.", "# In front.")
        while "In front." not in editor.hover(uri, "let ah|ead"):
            editor.replace(uri, "# In front.", "# In front.")


def test_an_editor_that_leaves_ends_the_server(tmp_path: Path) -> None:
    with far_editor() as editor:
        editor.initialize(tmp_path)
        editor.open(tmp_path / "a.colony", PATROL)
        editor.close()
        assert editor.exit_code() == 0


def test_a_document_without_a_file_is_checked_as_it_is() -> None:
    editor = NearEditor()
    editor.initialize()
    uri = "untitled:Untitled-1"
    editor.texts[uri] = "let x = 3 mm\n"
    item = {"uri": uri, "languageId": "colony", "version": 1, "text": editor.texts[uri]}
    editor.tell("textDocument/didOpen", {"textDocument": item})
    editor.settle()
    assert sorted(editor.findings(uri)) == ["E301", "N001"]
    editor.fix(uri, "write `import robot`")
    assert editor.texts[uri].startswith("import robot\n")


def test_a_standard_input_that_is_a_file_is_read(tmp_path: Path) -> None:
    script = tmp_path / "session"
    script.write_bytes(framed({"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": {}}))
    command = [sys.executable, "-m", "colony.cli.main", "lsp"]
    for name in (str(script), os.devnull):
        with open(name, "rb") as file:
            done = subprocess.run(command, stdin=file, capture_output=True, check=True)
        assert (b"hoverProvider" in done.stdout) is (name != os.devnull)
