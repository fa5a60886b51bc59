"""`colony upgrade`: what is written, what is printed, and files that nobody means to be upgraded."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.paths import ROOT
from tests.waiting import PATIENCE_S, killed_in_the_end, until

ROBOT = """robot r {
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)
}
"""
OLD = f"# Backs off.\n\n{ROBOT}let bumped = held(bumper, 1 s)  # off-delay\n"
NEW = f"# Backs off.\n\nlanguage 2\n\n{ROBOT}let bumped = recently(bumper, 1 s)  # off-delay\n"


@pytest.fixture
def old(tmp_path: Path) -> Path:
    """A file of version 1."""
    path = tmp_path / "a.colony"
    path.write_text(OLD)
    return path


def test_a_file_is_rewritten_once(colony: Colony, old: Path) -> None:
    assert colony("upgrade", "a.colony") == (0, "a.colony: upgraded to version 2\n", "")
    assert old.read_text() == NEW
    assert colony("upgrade", "a.colony") == (0, "a.colony: already version 2\n", "")
    assert old.read_text() == NEW
    code, _, err = colony("check", "a.colony")
    assert (code, re.findall(r"\w+\[\w+\]", err)) == (0, ["note[N003]"])  # its robot has no body


def test_what_is_to_be_decided_is_a_warning_at_its_place(colony: Colony, old: Path) -> None:
    old.write_text(OLD + "contract stops: bumper implies drive.velocity <= 0\n")
    code, out, err = colony("upgrade", "a.colony")
    assert (code, out) == (0, "a.colony: upgraded to version 2; 1 place to decide\n")
    assert err.startswith("a.colony:10:10: warning[U004]: `stops` can be broken where `bumper` is missing")
    assert "  10 | contract stops: bumper implies drive.velocity <= 0\n" in err
    assert "hint: write `fresh(bumper) implies (...)` or `value_or(bumper, VALUE)`" in err


def test_check_writes_nothing(colony: Colony, old: Path) -> None:
    code, out, _ = colony("upgrade", "--check", "a.colony")
    assert (code, out) == (1, "a.colony: would be upgraded to version 2\n")
    assert old.read_text() == OLD
    old.write_text(NEW)
    assert colony("upgrade", "--check", "a.colony").code == 0


def test_diff_writes_nothing(colony: Colony, old: Path) -> None:
    code, out, err = colony("upgrade", "--diff", "a.colony")
    assert (code, err) == (0, "")
    assert out.startswith("--- a.colony\n+++ a.colony (version 2)\n@@ ")
    assert "\n+language 2\n" in out
    assert "\n-let bumped = held(bumper, 1 s)  # off-delay\n+let bumped = recently(bumper" in out
    assert old.read_text() == OLD
    assert colony("upgrade", "--diff", "--check", "a.colony") == (1, out, "")
    old.write_text(NEW)
    assert colony("upgrade", "--diff", "a.colony") == (0, "", "")


@pytest.mark.skipif(shutil.which("patch") is None, reason="no patch")
def test_a_diff_is_one_that_patch_applies(colony: Colony, old: Path) -> None:
    for text in (OLD, OLD.rstrip("\n"), OLD.replace("\n", "\r\n"), OLD.replace("# off", "# \f\u2028off")):
        old.write_bytes(text.encode())
        out = colony("upgrade", "--diff", "a.colony").out
        done = subprocess.run(
            ["patch", "--binary", "-o", "-", str(old)], input=out.encode(), capture_output=True, check=True
        )
        assert colony("upgrade", "a.colony").code == 0
        assert done.stdout == old.read_bytes()


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.rstrip("\n"),
        lambda text: "\ufeff" + text,
        lambda text: text.replace("Backs off", "Weicht zurück"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace("  # off", "\t\f # off"),
    ],
    ids=["CRLF", "no line break at the end", "byte order mark", "umlaut", "CR", "form feed"],
)
def test_all_other_bytes_stay(colony: Colony, old: Path, change: Callable[[str], str]) -> None:
    old.write_bytes(change(OLD).encode())
    assert colony("upgrade", "a.colony").code == 0
    assert old.read_bytes() == change(NEW).encode()


def test_mode_and_link_stay(colony: Colony, old: Path) -> None:
    old.chmod(0o640)
    Path("link.colony").symlink_to("a.colony")
    assert colony("upgrade", "link.colony").out == "link.colony: upgraded to version 2\n"
    assert Path("link.colony").is_symlink()
    assert old.read_text() == NEW
    assert old.stat().st_mode & 0o777 == 0o640
    assert sorted(os.listdir()) == ["a.colony", "link.colony"]


def test_imports_are_rewritten_only_where_they_are_named(colony: Colony, old: Path) -> None:
    Path("b.colony").write_text('import "a.colony"\nlet again = bumped\n')
    ran = colony("upgrade", "b.colony")
    assert ran.code == 0
    assert "b.colony: imports a.colony, which is still version 1; upgrade it too\n" in ran.err
    assert Path("b.colony").read_text().startswith("language 2\n\nimport")
    assert old.read_text() == OLD
    assert "still version 1" not in colony("upgrade", "b.colony", "a.colony").err


def test_places_in_files_that_are_not_named_are_those_on_disk(colony: Colony) -> None:
    robot = "robot r { actuator d { v : mm/s } to RServer.d idle d(v = 0) }\n"
    Path("base.colony").write_text(f"{robot}limit d.v <= 5 mm/s\n")
    drive = "module m { when true do d(v = 1 mm/s) }\nnetwork { d = m }\n"
    Path("top.colony").write_text(f'import "base.colony"\n{drive}limit d.v >= 8 mm/s\n')
    [place] = [
        x for x in colony("upgrade", "--diff", "top.colony").err.splitlines() if "the other limit" in x
    ]
    assert "base.colony:2:" in place
    together = colony("upgrade", "--diff", "top.colony", "base.colony").err.splitlines()
    [place] = [x for x in together if "the other limit" in x]
    assert "base.colony:4:" in place


def test_files_of_one_command_do_not_hold_up_each_other(colony: Colony, old: Path) -> None:
    Path("bad.colony").write_text("let a = = 3\n")
    Path("bytes.colony").write_bytes(b"let a = \xff\n")
    Path("new.colony").write_text("language 3\n")
    Path("folder.colony").mkdir()
    names = ("bad", "none", "bytes", "a", "new", "folder")
    code, out, err = colony("upgrade", *(f"{name}.colony" for name in names))
    assert (code, out) == (2, "a.colony: upgraded to version 2\n")
    for said in (
        "bad.colony:1:9: error[E005]: found `=`",
        "bad.colony: not changed, because it has errors",
        "none.colony:1:1: error[E001]: cannot read `none.colony`: No such file or directory",
        "bytes.colony:1:9: error[E002]: found a byte that is not UTF-8",
        "new.colony:1:1: error[E008]: found version 3 of the language",
        "folder.colony:1:1: error[E001]: cannot read `folder.colony`: it is a directory",
    ):
        assert said in err
    assert Path("bad.colony").read_text() == "let a = = 3\n"
    assert Path("bytes.colony").read_bytes() == b"let a = \xff\n"
    assert colony("upgrade", "bad.colony").code == 1


def test_a_file_that_is_read_only_stays(colony: Colony, old: Path) -> None:
    old.chmod(0o444)
    code, out, err = colony("upgrade", "a.colony")
    assert (code, out, err) == (2, "", "a.colony: error: cannot write: Permission denied\n")
    assert old.read_text() == OLD
    assert colony("upgrade", "--check", "a.colony").code == 1


def test_behaviors_that_come_with_colony_are_found_by_path_only(colony: Colony) -> None:
    before = (ROOT / "behaviors" / "wander.colony").read_bytes()
    code, _, err = colony("upgrade", "wander")
    assert code == 2
    assert "cannot read `wander`" in err
    assert (ROOT / "behaviors" / "wander.colony").read_bytes() == before


def test_a_compiled_program_is_refused(colony: Colony, behavior: Path) -> None:
    assert colony("compile", behavior, "-o", "b.colonyc").code == 0
    code, _, err = colony("upgrade", "b.colonyc")
    assert code == 2
    assert "it is a compiled program, and its source is needed here" in err


def test_an_interrupt_leaves_each_file_old_or_new(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.colony" for number in range(60)]
    for path in paths:
        path.write_text(OLD)
    command = [sys.executable, "-m", "colony.cli.main", "upgrade", *(path.name for path in paths)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    started = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL)
    with killed_in_the_end(started) as process:
        until(lambda: paths[0].read_text() == NEW, "the first file is upgraded")
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) in (0, 130)
    assert {path.read_text() for path in paths} <= {OLD, NEW}
    assert sorted(os.listdir(tmp_path)) == sorted(path.name for path in paths)
