"""`colony help` explains every code and every command."""

from __future__ import annotations

import pytest

from colony.cli.main import COMMANDS
from colony.dsl.errors import CODES as FRONT_END_CODES
from colony.text.codes import CODES
from tests.cli.conftest import Colony


def test_every_code_is_explained(colony: Colony) -> None:
    for code in (*FRONT_END_CODES, *CODES):
        out = colony.output("help", code.lower())
        assert out.startswith(f"{code}: ")
        assert out.count("\n") > 3
        assert "### " not in out


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_explained(colony: Colony, name: str) -> None:
    assert colony("help", name).out == colony(name, "--help").out


def test_what_there_is_not(colony: Colony) -> None:
    assert "no code or command `vrify`; did you mean `verify`?" in colony.refusal("help", "vrify")
    for word in ("percent", "failsafe", "sensor", "recently", "min", "implies"):
        assert f"`{word}` is a word of the language: see docs/language.md" in colony("help", word).err
    assert "for words of the language see docs/language.md" in colony("help", "zzzzz").err
    assert colony("help").out.startswith("Usage: colony")
