from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from colony.cli.main import COMMANDS
from tests.cli.conftest import Colony
from tests.paths import ROOT


def test_help_names_every_command(colony: Colony) -> None:
    out = colony.output("--help")
    assert all(name in out for name in COMMANDS)


def test_alone_it_shows_its_help_as_it_is_with_help(colony: Colony) -> None:
    _, shown, _ = colony("--help")
    assert shown.startswith("Usage: colony [OPTIONS] COMMAND [ARGS]...\n")
    assert colony() == (2, "", shown)


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_has_help_with_an_example(colony: Colony, name: str) -> None:
    out = colony.output(name, "--help")
    assert "Example" in out
    assert f"colony {name}" in out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("chek",), "did you mean `check`?"),
        (("frobnicate",), "the commands are new, check"),
        (("check", "--nope"), "No such option"),
        (("check",), "Missing argument"),
        (("trace", "x.colony"), "Missing option '--input'"),
        (("compile", "x.colony", "--format", "xml"), "'xml' is not one of"),
        (("sim", "hold", "x", "--for"), "colony sim hold: error: Option '--for' requires an argument"),
        (("stop", "--robot", "nobody"), "no process of `nobody` runs on this machine (running robots: "),
    ],
)
def test_misuse_is_one_line_and_exit_code_2(colony: Colony, arguments: tuple[str, ...], said: str) -> None:
    assert said in colony.one_line(*arguments)


def test_a_reader_that_goes_away_is_no_error(behavior: Path) -> None:
    command = f"{sys.executable} -m colony.cli.main compile --no-proof --format python {behavior} | head -1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert done.stderr == ""


@pytest.mark.parametrize("arguments", ["--help", "compile --no-proof FILE", "check FILE"])
def test_a_reader_that_never_came_is_no_error(arguments: str) -> None:
    arguments = arguments.replace("FILE", "wander")
    command = f"set -o pipefail; {sys.executable} -m colony.cli.main {arguments} | true"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "arguments", ["check nowhere 2> /dev/full", "check --nope 2>&-", "trace wander --input nowhere 2>&-"]
)
def test_misuse_that_nobody_hears_is_still_exit_code_2(arguments: str) -> None:
    command = f"{sys.executable} -m colony.cli.main {arguments}"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    assert subprocess.run(["bash", "-c", command], env=environment).returncode == 2


def test_letters_that_the_encoding_lacks_become_escapes(behavior: Path) -> None:
    command = [sys.executable, "-m", "colony.cli.main", "compile", "--no-proof", "--explain", str(behavior)]
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1"}
    done = subprocess.run(command, capture_output=True, env=environment)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"\\u251c" in done.stdout


def test_names_with_line_breaks_stay_on_one_line(colony: Colony) -> None:
    for command in (("check",), ("compile",), ("check", "--no\npe")):
        code, _, err = colony(*command, "a\nb.colony")
        assert (code, err.count("\n")) == (2, 1)


@pytest.mark.parametrize(
    "command",
    ["run figure_4_14 --map nowhere", "run nowhere --map loop"],
)
def test_what_is_not_there_is_said_before_anything_slow_is_imported(command: str, tmp_path: Path) -> None:
    ran = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "colony", *command.split()],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 2
    assert "No such file or directory" in ran.stderr
    assert "numba.core" not in ran.stderr
