"""Files that commands write: whole or not at all, never over a source or over what is being read."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import click
import pytest

from colony.cli.outputs import check_output, write_whole
from colony.files import open_exclusive
from tests.cli.conftest import Colony
from tests.paths import ROOT

MAP = str(ROOT / "maps" / "loop.stickrep")


def refused(path: str | Path, *inputs: str | Path) -> bool:
    try:
        check_output(path, inputs)
    except click.exceptions.Exit:
        return True
    return False


@pytest.mark.parametrize(
    "arguments",
    [
        ("compile", "b.colony", "-o", "b.colony"),
        ("compile", "b.colony", "-o", "link"),
        ("graph", "b.colony", "--format", "svg", "-o", "robot.colony"),
        ("trace", "b.colony", "--input", "frames.jsonl", "-o", "frames.jsonl"),
        ("trace", "b.colony", "--input", "frames.jsonl", "-o", "robot.colony"),
        ("run", "b.colony", "--map", MAP, "--record", "robot.colony"),
        ("run", "b.colony", "--map", MAP, "--record", "link"),
        ("run", "b.colony", "--map", MAP, "--record", "other.stickrep"),
        ("new", "robot.colony"),
    ],
)
def test_sources_and_inputs_are_never_overwritten(
    colony: Colony, behavior: Path, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    for name in ("robot.colony", "other.stickrep", "frames.jsonl"):
        (tmp_path / name).write_text("")
    (tmp_path / "link").symlink_to(behavior)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    code, out, err = colony(*arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "error: cannot write: it is a" in err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    "arguments",
    [
        ("compile", "b.colony", "-o"),
        ("graph", "b.colony", "--format", "dot", "-o"),
        ("trace", "b.colony", "--input", os.devnull, "-o"),
        ("new",),
    ],
)
@pytest.mark.parametrize("name", ["", "x" * 300, "no/such"])
def test_odd_names_are_one_line(
    colony: Colony, behavior: Path, tmp_path: Path, arguments: tuple[str, ...], name: str
) -> None:
    code, out, err = colony(*arguments, name)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert list(tmp_path.iterdir()) == [behavior]


def test_a_pipe_that_is_open_is_written_into() -> None:
    """As a shell gives it: `colony graph x.colony -o >(less)`."""
    reader, writer = os.pipe()
    try:
        path = Path(f"/dev/fd/{writer}")
        check_output(path)
        write_whole(path, "text")
        assert os.read(reader, 100) == b"text"
    finally:
        os.close(reader)
        os.close(writer)


@pytest.mark.parametrize(
    "arguments",
    [
        ("compile", "b.colony", "-o", "pipe.colonyc"),
        ("graph", "b.colony", "-o", "pipe.svg"),
        ("trace", "b.colony", "--input", os.devnull, "-o", "pipe.jsonl"),
        ("run", "b.colony", "--map", MAP, "--record", "pipe.mcap"),
        ("run", "b.colony", "--map", MAP, "--picture", "pipe.png"),
        ("map", MAP, "-o", "pipe.png"),
        ("plan", MAP, "201", "216", "-o", "pipe.png"),
    ],
)
def test_a_pipe_that_nobody_may_read_is_refused(
    colony: Colony, behavior: Path, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    pipe = tmp_path / arguments[-1]
    os.mkfifo(pipe)
    code, out, err = colony(*arguments)
    assert (code, out) == (2, ""), err
    assert err == f"{pipe.name}: error: cannot write: it is not a regular file\n"
    assert pipe.is_fifo()


def test_what_a_link_leads_to_is_replaced(tmp_path: Path) -> None:
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old")
    target.chmod(0o640)
    link.symlink_to(target)
    write_whole(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert target.stat().st_mode & 0o777 == 0o640
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "target"]


def test_what_cannot_be_replaced_is_left_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "x"
    target.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(click.exceptions.Exit):
        write_whole(target, "new")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_outputs_that_are_refused_beforehand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "x"
    assert not refused(target)
    assert refused(tmp_path)
    assert refused(tmp_path / "no" / "x")
    assert refused("\0")
    target.write_text("")
    assert not refused(target)
    assert refused(target, "other", target)
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert refused(target)
    assert refused(tmp_path / "y")


def test_two_runs_do_not_record_into_one_file(tmp_path: Path) -> None:
    path = str(tmp_path / "run.jsonl")
    with open_exclusive(path) as first:
        first.write(b"first")
        with pytest.raises(BlockingIOError):
            open_exclusive(path)
    assert Path(path).read_bytes() == b"first"
    with open_exclusive(path) as second:
        second.write(b"2")
    assert Path(path).read_bytes() == b"2"


def test_standard_output_goes_on_where_it_stands(tmp_path: Path) -> None:
    code = (
        "from pathlib import Path; from colony.cli.outputs import write_whole; "
        "write_whole(Path('/dev/stdout'), 'b')"
    )
    with (tmp_path / "out").open("wb") as file:
        file.write(b"a")
        file.flush()
        subprocess.run([sys.executable, "-c", code], stdout=file, check=True)
        file.write(b"c")
    assert (tmp_path / "out").read_bytes() == b"abc"
