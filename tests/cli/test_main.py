from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from colony.cli.main import COMMANDS
from tests.cli.conftest import Colony


def test_help_names_every_command(colony: Colony) -> None:
    code, out, _ = colony("--help")
    assert code == 0
    assert all(name in out for name in COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_has_help_with_an_example(colony: Colony, name: str) -> None:
    code, out, _ = colony(name, "--help")
    assert code == 0
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
        (("trace", "x.colony", "--input", "f", "--backend", "c++"), "'c++' is not one of"),
        (("run",), "Missing"),
        (("map",), "Missing"),
    ],
)
def test_misuse_is_one_line_and_exit_code_2(colony: Colony, arguments: tuple[str, ...], said: str) -> None:
    code, out, err = colony(*arguments)
    assert code == 2
    assert out == ""
    assert said in err
    assert err.count("\n") == 1


def test_a_reader_that_goes_away_is_no_error(behavior: Path) -> None:
    command = f"{sys.executable} -m colony.cli.main compile --format python {behavior} | head -1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert done.stderr == ""
