"""Counterexamples appended to behavior files as tests."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from colony.cli.outputs import cannot_write, write_whole
from colony.cli.reporting import say
from colony.dsl.files import MAX_BYTES
from colony.files import read_file, reason

if TYPE_CHECKING:
    from colony.ir.program import Program
    from colony.verify.contracts.results import Refuted


def check_writable(file: str) -> None:
    """Refuse a file that cannot be replaced, before the work begins; exit with 2."""
    path = Path(file)
    if not os.access(path, os.W_OK):
        cannot_write(path, "Permission denied (--write-test appends to it)")
    if path.is_file() and not os.access(path.resolve().parent, os.W_OK | os.X_OK):
        cannot_write(path, "Permission denied in its folder (--write-test replaces it)")


def append_tests(file: str, program: Program, refuted: Sequence[Refuted]) -> None:
    """Append a `test` block for each refuted contract or reach, and report it; exit with 2 if that fails.

    The file is replaced atomically. A test that it contains already is not written again.
    """
    path = Path(file)
    before = _bytes(path)
    text = before.decode("utf-8-sig").replace("\r\n", "\n")
    titles = {existing.name for existing in program.tests}
    blocks: list[str] = []
    written: list[str] = []
    for result in refuted:
        test = _new_test(program, result, titles, text)
        if test is None:
            what = "what it reaches, or one of its values" if result.contract.reach else "one of its values"
            say(f"{file}: no test for {result.contract.name}: the language cannot express {what}")
        elif test.block in text:
            say(f'{file}: the test "{test.title}" already exists')
        else:
            titles.add(test.title)
            blocks.append(test.block)
            written.append(test.title)
    if blocks:
        _append(path, before, blocks)
    for name in written:
        say(f'{file}: wrote the test "{name}"')


class _Test(NamedTuple):
    title: str
    block: str


def _new_test(program: Program, result: Refuted, titles: set[str], text: str) -> _Test | None:
    """Return the test, titled with the first free title or the title of the same test in `text`."""
    from colony.verify.contracts.example_block import example_block, title

    number = 1
    while True:
        name = title(result.contract) + (f" ({number})" if number > 1 else "")
        block = example_block(program, result.contract, result.trace, name)
        if block is None:
            return None
        if name not in titles or block in text:
            return _Test(name, block)
        number += 1


def _bytes(path: Path) -> bytes:
    try:
        return read_file(path, MAX_BYTES)
    except OSError as problem:
        cannot_write(path, reason(problem))


def _append(path: Path, before: bytes, blocks: Sequence[str]) -> None:
    """Append blocks to the file, with the same kind of line breaks."""
    added = "".join(f"\n{block}" for block in blocks)
    if before and not before.endswith(b"\n"):
        added = f"\n{added}"
    if b"\r\n" in before:
        added = added.replace("\n", "\r\n")
    write_whole(path, before + added.encode())
