"""`colony explain` from end to end: on a recording in which everything happens, whole and broken."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.analysis.recorded_runs import as_lines
from tests.cli.conftest import Colony
from tests.cli.explained import BLOCKS, GOLDEN, printed, recorded


@pytest.fixture(scope="module")
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The user's cache of most tests, so that they need not all build the index."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def environment(shared_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(shared_cache))


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of indexes in a cache of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "colony" / "moments"


@pytest.fixture
def run(colony: Colony) -> Colony:
    """Commands, in a folder with the recording as run.mcap."""
    Path("run.mcap").write_bytes(recorded())
    return colony


def test_answers_are_as_shown(run: Colony) -> None:
    blocks = BLOCKS.findall(GOLDEN.read_text(encoding="utf-8"))
    assert len(blocks) >= 10
    for command, shown in blocks:
        assert printed(command) == shown, f"{command}: `python -m tests.cli.explained` writes it again"


QUESTIONS = (
    ("--at", "1.1", "--why-not", "cruise"),
    ("--at", "2.3", "--format", "json"),
    ("--at", "0"),
    ("--when", "drive by avoid", "--at", "1", "--format", "json"),
    ("--when", "sonar is missing", "--nth", "1"),
    ("--at", "5"),
    ("--when", "drive is idle", "--nth", "99"),
)


def test_times_are_those_of_the_run_whenever_it_began(run: Colony) -> None:
    expected = [run("explain", "run.mcap", "wander", *question) for question in QUESTIONS]
    Path("run.mcap").write_bytes(recorded(begin_ns=89_751_399_999))
    assert [run("explain", "run.mcap", "wander", *question) for question in QUESTIONS] == expected


def test_the_second_question_is_answered_from_the_cache(run: Colony, cache: Path) -> None:
    first = run("explain", "run.mcap", "wander", "--at", "1.1")
    [index] = cache.iterdir()
    kept = index.read_bytes()
    again = run("explain", "run.mcap", "wander", "--at", "1.1")
    assert (first.code, again.code) == (0, 0)
    assert again.out == first.out
    assert index.read_bytes() == kept


@pytest.mark.parametrize("place", [20, 200])
def test_a_damaged_index_is_built_again(run: Colony, cache: Path, place: int) -> None:
    first = run("explain", "run.mcap", "wander", "--at", "1.1")
    [index] = cache.iterdir()
    kept = index.read_bytes()
    index.write_bytes(kept[: place % len(kept)] + b"\xff" + kept[place % len(kept) + 1 :])
    assert run("explain", "run.mcap", "wander", "--at", "1.1").out == first.out
    assert index.read_bytes() == kept


def test_the_cache_may_be_unwritable(run: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    ran = run("explain", "run.mcap", "wander", "--at", "1.1")
    assert ran.code == 0
    assert "the index cannot be kept" in ran.err


def test_json_has_the_answer_its_conditions_and_what_had_to_change(run: Colony) -> None:
    ran = run(
        *("explain", "run.mcap", "wander", "--when", "drive by back_off", "--why", "drive"),
        *("--format", "json"),
    )
    found = json.loads(ran.out)
    assert found["when"]["spans"] == [{"from": 2.0, "to": 3.0}, {"from": 3.5, "to": 3.55}]
    [answer] = found["answers"]
    assert (answer["t"], answer["answer"]) == (2.0, "drive is by back_off")
    assert answer["sent"]["by"] == "back_off"
    assert [b["name"] for b in answer["because"]] == ["back_off", "docked", "blind", "stuck"]
    assert answer["changes"][0]["text"] == "`front_bumper` did not hold"
    [kind] = {c["kind"] for c in answer["changes"][0]["conditions"]}
    assert kind == "reading"


def test_json_lines_are_explained_with_the_program_beside_them(colony: Colony) -> None:
    Path("run.jsonl").write_bytes(recorded(as_lines))
    assert "run.jsonl" in colony("explain", "run.jsonl", "--at", "1.1").err
    ran = colony("explain", "run.jsonl", "wander", "--at", "1.1", "--why-not", "cruise")
    assert ran.out.startswith("1.1 s: drive is not by cruise; drive is by avoid\n")


def test_of_a_program_in_the_shadow_of_a_robot_it_is_told_that_nothing_was_sent(colony: Colony) -> None:
    Path("run.jsonl").write_bytes(
        re.sub(rb', "@sum": "[0-9a-f]*"}', b', "@shadow": true}', recorded(as_lines))
    )
    asked = ("explain", "run.jsonl", "wander", "--at", "1.1")
    assert colony(*asked).out.startswith("SHADOW: this is what it would have sent; it commanded nothing\n")
    assert json.loads(colony(*asked, "--format", "json").out)["shadow"] is True


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "no moment: give --at SECONDS or --when CONDITION"),
        (["--at", "soon"], "found `soon`; expected a time in seconds, such as 12.3"),
        (["--at", "nan"], "found `nan`; expected a time in seconds"),
        (["--at", "1e300"], "found `1e300`; expected a time in seconds"),
        (["--at", "1e999999999"], "found `1e999999999`; expected a time in seconds"),
        (["--at", "9e9"], "9000000000 s is after the recording"),
        (["--at", "-1"], "-1 s is before the recording; the recording has 100 frames from 0 s to 4.95 s"),
        (["--at", "5"], "5 s is after the recording; the recording has 100 frames from 0 s to 4.95 s"),
        (["--at", "1", "--why", "avoif"], "`avoif`; did you mean `avoid`?"),
        (
            ["--at", "1", "--why-not", "zzz"],
            "no actuator, module, wire or sensor `zzz`; the program has drive",
        ),
        (["--when", "drive by avoif"], "no module `avoif`; did you mean `avoid`?"),
        (["--when", "drve is idle"], "no actuator `drve`; did you mean `drive`?"),
        (["--when", "near < 3 m"], "found `near < 3 m`; expected `ACTUATOR by MODULE`"),
        (["--when", "avoid is odd"], "found `avoid is odd`; expected `ACTUATOR by MODULE`"),
        (["--when", "avoid is odd"], "`MODULE is active` (or inactive, silent, blind, late, lost, refused)"),
        (["--when", "keep_middle is active"], "`keep_middle is active` never begins"),
        (["--when", "drive by avoid", "--nth", "9"], "`drive by avoid` begins 2 times"),
    ],
)
def test_misuse_is_told_in_one_line(run: Colony, arguments: list[str], said: str) -> None:
    assert said in run.refusal("explain", "run.mcap", "wander", *arguments)


def test_a_search_can_begin_later(run: Colony) -> None:
    ran = run("explain", "run.mcap", "wander", "--when", "drive by back_off", "--at", "2.5")
    assert "1. from 3.5 s" in ran.out


def test_a_client_that_was_never_late_is_not_late(run: Colony) -> None:
    ran = run("explain", "run.mcap", "wander", "--when", "avoid is not late")
    assert "1. from 0 s to the end" in ran.out


def test_a_recording_that_breaks_off_is_explained_as_far_as_it_goes(run: Colony) -> None:
    Path("cut.mcap").write_bytes(recorded()[: len(recorded()) // 2])
    assert run("explain", "cut.mcap", "wander", "--at", "1.1").code == 0
    err = run.refusal("explain", "cut.mcap", "wander", "--at", "4.5")
    assert "after the recording" in err
    assert "it breaks off in the middle of a frame" in err


def test_damage_is_told_and_what_is_around_it_is_explained(run: Colony) -> None:
    recording = recorded()
    at = len(recording) // 2
    Path("bad.mcap").write_bytes(recording[:at] + bytes(40) + recording[at + 40 :])
    ran = run("explain", "bad.mcap", "wander", "--at", "4.2", "--why", "avoid")
    assert ran.code == 0
    assert ran.out.startswith("4.2 s: avoid is active")
    assert "warning: damaged from " in ran.err


def test_no_recording_and_no_program(colony: Colony) -> None:
    assert colony("explain", "none.mcap", "--at", "1").code == 2
    Path("text.mcap").write_text("hello")
    assert "error[A002]" in colony("explain", "text.mcap", "--at", "1").err


def test_a_failing_test_is_explained(colony: Colony, behavior: Path) -> None:
    text = behavior.read_text().replace("expect drive by cruise", "expect drive by back")
    behavior.write_text(text)
    ran = colony("test", behavior, "--explain")
    assert ran.code == 1
    assert "  0.2 s: `drive by back` is not true\n    back is not active: its predicate is false\n" in ran.out
    assert "`bumper` was last true at 0 s, 200 ms before: longer ago than 100 ms" in ran.out
    [failure] = json.loads(colony("test", behavior, "--explain", "--format", "json").out)
    assert failure["explanation"]["answer"] == "`drive by back` is not true"
