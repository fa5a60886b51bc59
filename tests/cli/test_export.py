"""`colony export`: a recording as a file for Foxglove, and a layout."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.analysis.recorded_runs import as_lines
from tests.cli.conftest import Colony
from tests.watch.runs import FRAMES, PROGRAM, TEXT, recording, run


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    path.write_bytes(recording())
    return path


def topics(path: Path) -> dict[str, int]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = summary.statistics.channel_message_counts
    return {channel.topic: counts.get(number, 0) for number, channel in summary.channels.items()}


def test_a_recording_is_written_with_its_map_and_a_layout(colony: Colony, recorded: Path) -> None:
    options = ("-o", "out.mcap", "--layout", "out.json", "--map", "loop")
    assert colony.output("export", recorded, *options) == f"wrote out.mcap: {FRAMES} frames\n"
    found = topics(recorded.parent / "out.mcap")
    assert (found["/tf"], found["/map"], found["/actuators/drive"]) == (FRAMES, 1, FRAMES)
    layout = json.loads((recorded.parent / "out.json").read_text())
    assert set(layout["configById"]["3D!colony"]["topics"]) <= set(found)


def test_lines_need_the_behavior(colony: Colony, recorded: Path) -> None:
    folder = recorded.parent
    (folder / "run.jsonl").write_bytes(as_lines(PROGRAM, run()).content)
    (folder / "b.colony").write_text(TEXT)
    assert "A005" in colony("export", "run.jsonl", "-o", "out.mcap").err
    colony.output("export", "run.jsonl", "-o", "out.mcap", "--behavior", "b.colony")
    assert topics(folder / "out.mcap")["/tf"] == FRAMES


def test_what_breaks_off_is_said(colony: Colony, recorded: Path) -> None:
    content = recorded.read_bytes()
    recorded.write_bytes(content[: len(content) * 3 // 5])
    code, out, err = colony("export", recorded, "-o", "out.mcap")
    assert code == 0
    assert out == "wrote out.mcap: 12 frames\n"
    assert "breaks off" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "give -o OUT.mcap, or --layout OUT.json"),
        (("-o", "run.mcap"), "it is an input of this command"),
        (("-o", "nowhere/out.mcap"), "the folder does not exist"),
        (("-o", "out.mcap", "--map", "nowhere"), "nowhere"),
    ],
)
def test_misuse(colony: Colony, recorded: Path, arguments: tuple[str, ...], message: str) -> None:
    assert message in colony("export", recorded, *arguments).err
    assert {path.name for path in recorded.parent.iterdir()} == {"run.mcap"}


def test_what_fails_leaves_no_file(colony: Colony, recorded: Path) -> None:
    recorded.write_bytes(recorded.read_bytes()[:200])
    assert colony("export", recorded, "-o", "out.mcap").code != 0
    assert {path.name for path in recorded.parent.iterdir()} == {"run.mcap"}
