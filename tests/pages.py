"""Commands on the pages of docs/, typed as printed."""

from __future__ import annotations

import io
import re
import shlex
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from colony.cli.main import main

COMMANDS = re.compile(r"```sh\n((?:(?!```).)*)```\n\n```text\n(.*?)```", re.DOTALL)
"""A block of commands, and the block of output below it."""


def typed(line: str, monkeypatch: pytest.MonkeyPatch, errors: bool = False) -> str:
    """What a command prints on standard output, and after it on standard error if `errors`.

    `colony` is run in this process; anything else by the shell.
    """
    words = shlex.split(line)
    if words[0] != "colony":
        subprocess.run(line, shell=True, check=True)
        return ""
    printed, said = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "argv", words)
    monkeypatch.setattr(sys, "path", list(sys.path))
    with redirect_stdout(printed), redirect_stderr(said), pytest.raises(SystemExit):
        main()
    return printed.getvalue() + (said.getvalue() if errors else "")


def is_same_picture(drawn: Path, kept: Path) -> bool:
    """Whether two SVGs are the same, or of two versions of matplotlib, which may set text differently."""
    texts = [path.read_text(encoding="utf-8") for path in (drawn, kept)]
    versions = [re.findall(r"<dc:title>(Matplotlib [^<]*)</dc:title>", text) for text in texts]
    return texts[0] == texts[1] or versions[0] != versions[1]
