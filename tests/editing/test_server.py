"""What an editor sees: requests and notifications of a session, over behaviors as a user edits them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from colony.editing.open_file import uri_of
from colony.editing.server.jobs import Answer, Job
from tests.editing.client import NearEditor
from tests.editing.project import PATROL, Project
from tests.paths import ROOT


def test_a_clean_file_has_no_findings_and_a_change_has_some(project: Project) -> None:
    assert project.findings(project.uri) == []
    project.replace(project.uri, "when close", "when clse")
    assert project.findings(project.uri) == []  # the pause is not over
    project.settle()
    assert project.findings(project.uri) == ["E101"]
    project.replace(project.uri, "when clse", "when close")
    project.settle()
    assert project.findings(project.uri) == []


def test_findings_of_an_imported_file_are_published_there_as_it_is_open(project: Project) -> None:
    project.open(project.folder / "robots" / "rome" / "rome.colony")
    project.replace(project.robot_uri, "range 0 .. 10000", "range 9 .. 1")
    project.settle()
    assert "E303" in project.findings(project.robot_uri)
    project.replace(project.robot_uri, "range 9 .. 1", "range 0 .. 10000")
    project.replace(project.robot_uri, "bumper    :", "bump      :")
    project.settle()
    assert project.findings(project.robot_uri) == []
    assert "E101" in project.findings(project.uri)


def test_the_language_line_is_offered_where_it_lacks(project: Project) -> None:
    project.replace(project.uri, "language 1\n\n", "")
    project.settle()
    assert project.findings(project.uri) == ["N001"]
    project.fix(project.uri, "write `language 1`")
    project.settle()
    assert project.texts[project.uri] == PATROL


@pytest.mark.parametrize(
    ("right", "wrong", "title", "mended"),
    [
        ("when close", "when clsoe", "write `close`", "when close"),
        ("mode.roaming\n", "mode.raoming\n", "write `roaming`", "mode.roaming\n"),
        ("drive by avoid implies", "drive by avoids implies", "write `avoid`", "drive by avoid implies"),
        ("r < limit", "r < 900", "write `900 mm`", "r < 900 mm"),
        ("speed = 100 mm/s", "speed = -100", "write `100 mm/s`", "speed = -100 mm/s"),
        ("not bumper }", "!bumper }", "write `not`", "not bumper }"),
        ("turns: drive.turn > 0", "turns: bumper = true", "write `==`", "turns: bumper == true"),
        ("min(sonar", "minn(sonar", "write `min`", "min(sonar"),
        ("min(sonar", "avg(sonar", "write `mean`", "mean(sonar"),
        ("cruise(speed", "cruise(sped", "write `speed`", "cruise(speed"),
        ("when paused", "when True", "write `true`", "when true"),
        ("mode == mode.roaming", "mode == roaming", "write `mode.roaming`", "mode == mode.roaming"),
    ],
)
def test_a_quick_fix_writes_what_the_hint_names(
    project: Project, right: str, wrong: str, title: str, mended: str
) -> None:
    project.replace(project.uri, right, wrong)
    project.settle()
    assert project.findings(project.uri)
    project.fix(project.uri, title)
    assert project.texts[project.uri] == PATROL.replace(right, mended)
    project.settle()
    assert project.findings(project.uri) == []


@pytest.mark.parametrize(
    ("marked", "parts"),
    [
        (
            "min(son|ar[-30 deg",
            ["sensor   sonar[24] : mm", "range 0 .. 10000 mm", "missing when older than 300 ms"],
        ),
        ("let ah|ead", ["# : mm", "What is straight ahead."]),
        ("param ro|om =", ["`900 mm`"]),
        ("when cl|ose", ["let  close", "# : bool"]),
        ("if ris|ing(", ["rising(b)", "became true"]),
        ("drive(velo|city = speed", ["velocity : mm/s range -600 .. 600", "field of `drive`"]),
        ("avoid sup|presses gentle", []),
        ("let ne|ar(", ["r : mm"]),
        ("mode.roam|ing\n", ["phase of `mode`"]),
    ],
)
def test_hover_says_what_a_name_is(project: Project, marked: str, parts: list[str]) -> None:
    found = project.hover(project.uri, marked)
    assert all(part in found for part in parts), found
    assert bool(found) == bool(parts)


def test_hover_over_a_module_has_its_place_in_the_network(project: Project) -> None:
    found = project.hover(project.uri, "module gen|tle")
    assert "priority 2 of 3 for drive" in found
    assert "can be suppressed by `avoid`" in found
    assert "can be inhibited by `pause`" in found
    assert "derived from `cruise`" in found
    avoid = project.hover(project.uri, "drive by av|oid implies")
    assert "Turns away from what is near." in avoid
    assert "failsafe" in avoid
    assert "guard: `P and not pause`" in avoid


@pytest.mark.parametrize(
    ("marked", "line", "is_of_robot"),
    [
        ("when cl|ose", "let  close", False),
        ("limit = ro|om)", "param room", False),
        ("cruise(spe|ed = 100", "param speed", False),
        ("avoid.cl|ose\n", "let  close", False),
        ("near(ahead, lim|it", "let near(r : mm, limit", False),
        ("mode == mo|de.roaming\n", "machine mode", False),
        ("if sonar[90 deg] > so|nar", "sensor   sonar", True),
        ("pause inhibits ro|am", "roam  = avoid", False),
        ("drive by avoid implies drive.velo|city", "actuator drive { velocity", True),
        ("reach turns: dr|ive", "actuator drive", True),
        ("import ro|bot", "language 1", True),
    ],
)
def test_a_definition_is_where_the_name_is_declared(
    project: Project, marked: str, line: str, is_of_robot: bool
) -> None:
    project.open(project.folder / "robots" / "rome" / "rome.colony")
    found = project.ask("textDocument/definition", project.at(project.uri, marked))
    assert (found["uri"] == project.robot_uri) is is_of_robot
    text = project.texts[found["uri"]].split("\n")[found["range"]["start"]["line"]]
    assert text.strip().startswith(line)


def test_references_are_found_in_every_file_of_the_folder(project: Project) -> None:
    (project.folder / "other.colony").write_text(
        'language 1\nimport "patrol.colony" as p\nmodule go = p.cruise(speed = 1 mm/s)\n'
        "network { drive = go }\n"
    )
    found = project.ask("textDocument/references", project.at(project.uri, "param spe|ed"))
    assert sorted(Path(place["uri"]).name for place in found) == ["other.colony"] + 3 * ["patrol.colony"]
    found = project.ask("textDocument/references", project.at(project.uri, "expect drive by av|oid, avoid"))
    assert [project.text_at(place) for place in found] == 5 * ["avoid"]


def test_a_rename_reaches_the_interface_of_the_robot(project: Project) -> None:
    project.open(project.folder / "robots" / "rome" / "rome.colony")
    at = project.at(project.uri, "min(son|ar[")
    edit = project.ask("textDocument/rename", {**at, "newName": "ranger"})
    assert {Path(uri).name: len(edits) for uri, edits in edit["changes"].items()} == {
        "patrol.colony": 5,
        "rome.colony": 1,
    }
    project.apply(edit)
    project.settle()
    assert "sonar" not in project.texts[project.uri]
    assert "sensor   ranger[24]" in project.texts[project.robot_uri]
    assert project.findings(project.uri) == []


@pytest.mark.parametrize(
    ("marked", "name", "why"),
    [
        ("min(son|ar[", "two words", "no name"),
        ("min(son|ar[", "implies", "reserved"),
        ("avo|ids what is near", "other", "a file or a title"),
        ("language| 1\n\nimport", "other", "no name of the program"),
        ("let ah|ead", "room", "an error in .*patrol.colony.: `room` is declared twice"),
        ("let ne|ar(r", "min", "a function of the language"),
    ],
)
def test_a_rename_that_makes_no_sense_is_refused(project: Project, marked: str, name: str, why: str) -> None:
    at = project.at(project.uri, marked)
    with pytest.raises(KeyError, match=why):
        project.ask("textDocument/rename", {**at, "newName": name})


def _rename(project: Project, marked: str, name: str) -> Any:
    return project.ask("textDocument/rename", {**project.at(project.uri, marked), "newName": name})


def test_a_rename_that_a_local_name_captures_is_refused(project: Project) -> None:
    project.replace(project.uri, "param room", "param top = 50 mm/s\nparam room")
    project.replace(project.uri, "  let  close", "  param fast = 600 mm/s\n  let  close")
    project.replace(project.uri, "velocity = 60 mm/s, turn", "velocity = top, turn")
    project.settle()
    with pytest.raises(KeyError, match=r"`fast` has another meaning in .*patrol.colony., line 27"):
        _rename(project, "param t|op", "fast")
    assert _rename(project, "param t|op", "other")


def test_a_rename_that_clashes_in_an_importer_without_the_name_is_refused(project: Project) -> None:
    (project.folder / "lib.colony").write_text("language 1\nlet free = 1\n")
    (project.folder / "both.colony").write_text('import "patrol.colony"\nimport "lib.colony"\n')
    (project.folder / "top.colony").write_text('import "both.colony"\n')
    with pytest.raises(KeyError, match=r"`free` is an error in .*both.colony"):
        _rename(project, "let ah|ead", "free")
    assert _rename(project, "let ah|ead", "clear")


@pytest.mark.parametrize(
    "data", [b'import "patrol.colony"\nlet b = ahead +\n', b'import "patrol.colony"\nlet b = ahead # \xff\n']
)
def test_a_rename_that_would_miss_a_use_is_refused(project: Project, data: bytes) -> None:
    half = project.folder / "half.colony"
    half.write_bytes(data)
    with pytest.raises(KeyError, match=r"`ahead` stands in .*half\.colony"):
        _rename(project, "let ah|ead", "clear")
    assert _rename(project, "param ro|om =", "space")  # which does not stand there
    half.write_bytes(data.replace(b"patrol", b"lib"))
    assert _rename(project, "let ah|ead", "clear")


def test_errors_elsewhere_in_a_file_do_not_keep_a_name_from_its_rename(project: Project) -> None:
    project.open(project.folder / "robots" / "rome" / "rome.colony")
    project.replace(project.robot_uri, "range 0 .. 10000", "range 9 .. 1")
    assert "from PServer.sonar" in project.texts[project.robot_uri]
    assert len(_rename(project, "min(son|ar[", "ranger")["changes"]) == 2


def test_a_rename_names_the_versions_of_what_is_open(project: Project) -> None:
    editor = NearEditor()
    able = {"workspace": {"workspaceEdit": {"documentChanges": True}}}
    editor.ask("initialize", {"rootUri": uri_of(str(project.folder)), "capabilities": able})
    uri = editor.open(project.path)
    editor.replace(uri, "# What is", "# what is")
    edit = editor.ask("textDocument/rename", {**editor.at(uri, "min(son|ar["), "newName": "ranger"})
    found = {
        change["textDocument"]["uri"]: change["textDocument"]["version"] for change in edit["documentChanges"]
    }
    assert found == {uri: 2, project.robot_uri: None}


@pytest.mark.parametrize("method", ["rename", "references", "formatting"])
def test_what_is_typed_while_a_worker_is_busy_is_served_and_makes_its_answer_invalid(
    project: Project, method: str
) -> None:
    params = {**project.about(project.uri), **project.at(project.uri, "let ah|ead")}
    params |= {"newName": "clear"} if method == "rename" else {}
    answers = project.worker.answers

    def typed_meanwhile(job: Job) -> Iterator[Answer]:
        assert "straight ahead" in project.hover(project.uri, "let ah|ead")
        project.replace(project.uri, "import robot\n", "import robot\n\n")
        project.worker.answers = answers  # type: ignore[method-assign]
        yield from answers(job)

    project.worker.answers = typed_meanwhile  # type: ignore[method-assign]
    with pytest.raises(KeyError, match="changed meanwhile"):
        project.ask(f"textDocument/{method}", params)
    assert [m["error"]["code"] for m in project.received if "error" in m] == [-32801]


def test_what_comes_with_colony_is_not_renamed(tmp_path: Path) -> None:
    path = tmp_path / "own.colony"
    path.write_text('language 1\nimport "wander"\nlet x = room_left\n')
    editor = NearEditor()
    editor.initialize(tmp_path)
    uri = editor.open(path.resolve())
    with pytest.raises(KeyError, match="outside of the workspace"):
        editor.ask("textDocument/rename", {**editor.at(uri, "= room_le|ft"), "newName": "other"})


def test_outlines_have_members_below_their_owners(project: Project) -> None:
    found = project.ask("textDocument/documentSymbol", project.about(project.uri))
    outline = {symbol["name"]: [child["name"] for child in symbol["children"]] for symbol in found}
    assert outline["cruise"] == ["speed"]
    assert outline["mode"] == ["roaming", "resting"]
    assert list(outline)[:4] == ["goal", "room", "ahead", "near"]
    names = project.ask("workspace/symbol", {"query": "avd"})
    assert [symbol["name"] for symbol in names] == ["avoid"]
    names = project.ask("workspace/symbol", {"query": "sonar"})
    assert [Path(symbol["location"]["uri"]).name for symbol in names] == ["rome.colony"]


def test_folds_are_between_braces_and_over_comments(project: Project) -> None:
    lines = PATROL.split("\n")
    found = project.ask("textDocument/foldingRange", project.about(project.uri))
    assert [lines[fold["startLine"]].split(" {")[0] for fold in found] == [
        *("module cruise", "failsafe module avoid", "network", 'test "avoids what is near"'),
    ]


def test_semantic_tokens_know_names_from_words(project: Project) -> None:
    project.replace(project.uri, "param room", "param step = 3\nparam room")
    project.settle()
    legend = project.session_legend()
    found = project.ask("textDocument/semanticTokens/full", project.about(project.uri))["data"]
    assert len(found) % 5 == 0
    lines, line, start = project.texts[project.uri].split("\n"), 0, 0
    kinds: dict[str, set[str]] = {}
    for i in range(0, len(found), 5):
        line, start = line + found[i], found[i + 1] + (0 if found[i] else start)
        kinds.setdefault(lines[line][start : start + found[i + 2]], set()).add(legend[found[i + 3]])
    assert kinds["step"] == {"variable"}  # a keyword of robots, here a name
    assert kinds["sonar"] == {"property"}
    assert kinds["avoid"] == kinds["drive"] == {"class"}
    assert kinds["roaming"] == {"enumMember"}
    assert kinds["suppresses"] == {"keyword"}


def test_hints_show_priorities_constants_and_units(project: Project) -> None:
    found = project.ask("textDocument/inlayHint", project.about(project.uri))
    lines = PATROL.split("\n")
    shown = [
        f"{lines[h['position']['line']][: h['position']['character']].strip()}|{h['label']}" for h in found
    ]
    assert "param room = 2 * 450 mm| = 900 mm" in shown
    assert "let ahead| : mm" in shown
    assert "module gentle| priority 2 of 3 for drive" in shown
    assert not [hint for hint in shown if "speed" in hint]  # it is written out


def test_signatures_say_which_argument_stands_here(project: Project) -> None:
    def help_at(marked: str) -> tuple[str, str]:
        found = project.ask("textDocument/signatureHelp", project.at(project.uri, marked))
        parameters = found["signatures"][0]["parameters"]
        return found["signatures"][0]["label"], parameters[found["activeParameter"]]["label"]

    assert help_at("near(ah|ead") == ("near(r : mm, limit : mm)", "r : mm")
    assert help_at("limit = ro|om)") == ("near(r : mm, limit : mm)", "limit : mm")
    assert help_at("drive(velocity = speed, turn = |0") == (
        "drive(velocity : mm/s, turn : deg/s)",
        "turn : deg/s",
    )
    assert help_at("if rising(|bumper") == ("rising(b)", "b")
    assert project.ask("textDocument/signatureHelp", project.at(project.uri, "network| {")) is None


def test_highlights_are_the_uses_in_this_file(project: Project) -> None:
    found = project.ask("textDocument/documentHighlight", project.at(project.uri, "let ahe|ad"))
    assert len(found) == 2


def test_an_editor_without_folders_or_a_file_that_is_not_open_is_answered(tmp_path: Path) -> None:
    editor = NearEditor()
    with pytest.raises(KeyError, match="not initialized"):
        editor.ask("textDocument/hover", {})
    editor.initialize()
    with pytest.raises(KeyError, match="is not open"):
        editor.ask(
            "textDocument/hover",
            {"textDocument": {"uri": "file:///x"}, "position": {"line": 0, "character": 0}},
        )
    with pytest.raises(KeyError, match="no method"):
        editor.ask("textDocument/nothing", {})
    with pytest.raises(KeyError, match="Expected"):
        editor.ask("textDocument/hover", {"textDocument": 3})
    uri = editor.open(tmp_path / "untitled.colony", "let x = ")
    editor.settle()
    assert editor.findings(uri) == ["E005"]
    editor.ask("shutdown", None)
    editor.tell("exit", None)
    assert editor.session.exit_code == 0


def test_requests_before_the_first_analysis_wait_for_it(tmp_path: Path) -> None:
    editor = NearEditor()
    editor.initialize(tmp_path)
    uri = editor.open(tmp_path / "a.colony", PATROL)
    assert "ahead" in editor.hover(uri, "let ah|ead")


def _paths(folder: str) -> Iterator[Path]:
    return (ROOT / folder).rglob("*.colony")


@pytest.mark.parametrize("path", [*_paths("behaviors"), *_paths("robots")], ids=lambda path: path.stem)
def test_every_name_of_a_shipped_file_leads_to_a_declaration(path: Path) -> None:
    """Each word is a word of the language, a unit, a function, or a use of a declaration."""
    from colony.editing.analysis import Analyzer
    from colony.editing.functions import FUNCTIONS
    from colony.editing.text import KEYWORDS, lexemes
    from colony.text.units import BASE_UNITS

    index = Analyzer().analyze(str(path.resolve()), {}).index
    uses = {start: number for start, _, number in index.root.uses}
    known = {
        *KEYWORDS,
        *BASE_UNITS,
        *FUNCTIONS,
        "bool",
        "number",
        "hold",
        "last",
        "frame_period",
        "restarted",
    }
    before = ""
    for lexeme in lexemes(index.root.text):
        if lexeme.kind == "word" and lexeme.start not in uses and before not in (".", "from", "to"):
            assert lexeme.text in known, index.root.text[lexeme.start - 40 : lexeme.end + 20]
        if lexeme.kind == "word" and lexeme.start in uses:
            declared = index.declarations[uses[lexeme.start]]
            assert declared.name == lexeme.text or declared.kind in ("file", "test")
        before = lexeme.text


def test_a_name_declared_twice_points_at_both_and_files_of_others_are_watched(project: Project) -> None:
    project.replace(project.uri, "state bumps = 0", "state bumps = 0\nlet ahead = 3 mm")
    project.settle()
    (row,) = project.diagnostics(project.uri)
    assert row["code"] == "E102"
    assert [project.text_at(label["location"]) for label in row["relatedInformation"]] == ["ahead"]
    robot = project.folder / "robots" / "rome" / "rome.colony"
    project.replace(project.uri, "\nlet ahead = 3 mm", "")
    project.settle()
    assert project.findings(project.uri) == []
    robot.write_text(robot.read_text().replace("bumper ", "bump   "))
    project.tell("workspace/didChangeWatchedFiles", {"changes": []})
    project.settle()
    assert "E101" in project.findings(project.uri)
    (asked,) = [m["params"] for m in project.received if m.get("method") == "client/registerCapability"]
    assert [row["method"] for row in asked["registrations"]] == ["workspace/didChangeWatchedFiles"]


def test_settings_choose_the_robot_and_wrong_ones_are_reported(project: Project) -> None:
    project.tell("workspace/didChangeConfiguration", {"settings": {"colony": {"robot": "no_such"}}})
    project.settle()
    assert project.findings(project.uri)[0] == "E321"
    project.tell("workspace/didChangeConfiguration", {"settings": {"colony": {"hints": "no"}}})
    (message,) = [m["params"]["message"] for m in project.received if m.get("method") == "window/logMessage"]
    assert "Expected `bool`" in message
    project.tell("workspace/didChangeConfiguration", {"settings": {"colony": {"hints": False}}})
    project.settle()
    assert project.findings(project.uri)[:1] != ["E321"]
    assert project.ask("textDocument/inlayHint", project.about(project.uri)) == []


def test_a_document_is_closed_and_its_findings_go(project: Project) -> None:
    project.replace(project.uri, "when close", "when clse")
    project.settle()
    assert project.findings(project.uri)
    project.tell("textDocument/didClose", {"textDocument": {"uri": project.uri}})
    assert project.findings(project.uri) == []
    with pytest.raises(KeyError, match="is not open"):
        project.hover(project.uri, "let ah|ead")


def test_formatting_is_that_of_the_formatter(project: Project) -> None:
    formatting = pytest.importorskip("colony.editing.formatting")
    project.replace(project.uri, "network {\n", "network {   \n\n\n")
    wanted = formatting.formatted(project.texts[project.uri], str(project.path))
    edits = project.ask("textDocument/formatting", project.about(project.uri))
    project.apply({"changes": {project.uri: edits}})
    assert project.texts[project.uri] == wanted
    assert project.ask("textDocument/formatting", project.about(project.uri)) == []
    project.replace(project.uri, "import robot", "import import")
    assert project.ask("textDocument/formatting", project.about(project.uri)) == []
