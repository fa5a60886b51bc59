"""The entry points of the front end, from a file or text to a typed program."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from colony.dsl.check.program import check_program
from colony.dsl.files import SourceTree, load_tree, relative_sources
from colony.ir.program import Program
from colony.text.diagnostics import Diagnostic, DiagnosticError


class Checked(NamedTuple):
    """The result of a check: the program if there are no errors, all findings, and the files."""

    program: Program | None
    diagnostics: tuple[Diagnostic, ...]
    tree: SourceTree


def _check_tree(tree: SourceTree, path: Path) -> Checked:
    program, diagnostics = check_program(tree)
    if program is not None:
        program = replace(program, files=relative_sources(tree, path))
    return Checked(program, diagnostics, tree)


def check_file(path: str | Path) -> Checked:
    """Check the file at `path` with all its imports; errors become diagnostics, never exceptions."""
    return _check_tree(load_tree(Path(path), str(path)), Path(path))


def check_text(text: str, name: str = "<text>", directory: str | Path = ".") -> Checked:
    """Check a text; imports are relative to `directory`."""
    path = Path(directory) / (Path(name).name or "<text>")
    return _check_tree(load_tree(path, name, text), path)


def load_file(path: str | Path) -> Program:
    """Return the program of a file.

    Raises:
        DiagnosticError: there is an error; it holds all errors and warnings.
    """
    return _program(check_file(path))


def load_text(text: str, name: str = "<text>", directory: str | Path = ".") -> Program:
    """Return the program of a text; imports are relative to `directory`.

    Raises:
        DiagnosticError: there is an error; it holds all errors and warnings.
    """
    return _program(check_text(text, name, directory))


def _program(checked: Checked) -> Program:
    if checked.program is None:
        raise DiagnosticError(checked.diagnostics)
    return checked.program
