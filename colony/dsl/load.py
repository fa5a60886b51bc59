"""The entry points of the front end, from a file or text to a typed program."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from colony.dsl.check.program import check_program
from colony.dsl.check.site_values import with_site_labels
from colony.dsl.descriptions import RobotChoice
from colony.dsl.files import SourceTree, load_tree, relative_sources
from colony.dsl.robot_import import ProgramContext, context_of_file
from colony.dsl.site import SiteParams
from colony.ir.program import Program
from colony.text.diagnostics import Diagnostic, DiagnosticError


class Checked(NamedTuple):
    """The result of a check: the program if there are no errors, all findings, and the files."""

    program: Program | None
    diagnostics: tuple[Diagnostic, ...]
    tree: SourceTree


def _check_tree(tree: SourceTree, path: Path, params: SiteParams | None) -> Checked:
    program, diagnostics = check_program(tree, params=params)
    if params is not None and program is None:
        diagnostics = with_site_labels(diagnostics, check_program(tree)[1], params)
    if program is not None:
        program = replace(program, files=relative_sources(tree, path))
    return Checked(program, diagnostics, tree)


def check_file(
    path: str | Path, *, robot: RobotChoice | str | None = None, params: SiteParams | None = None
) -> Checked:
    """Check the file at `path` with all its imports; errors become diagnostics, never exceptions.

    `robot` is the description that `import robot` brings in; by default, the project of the file says it.
    The values of `params` stand in for those in the text.
    """
    context = context_of_file(Path(path), _choice(robot))
    return _check_tree(load_tree(Path(path), str(path), context=context), Path(path), params)


def check_text(
    text: str,
    name: str = "<text>",
    directory: str | Path = ".",
    *,
    robot: RobotChoice | str | None = None,
    params: SiteParams | None = None,
) -> Checked:
    """Check a text; imports are relative to `directory`. `robot` and `params` are as in `check_file`."""
    path = Path(directory) / (Path(name).name or "<text>")
    return _check_tree(
        load_tree(path, name, text, context=ProgramContext(choice=_choice(robot))), path, params
    )


def load_file(
    path: str | Path, *, robot: RobotChoice | str | None = None, params: SiteParams | None = None
) -> Program:
    """Return the program of a file; `robot` and `params` are as in `check_file`.

    Raises:
        DiagnosticError: there is an error; it holds all errors and warnings.
    """
    return _program(check_file(path, robot=robot, params=params))


def load_text(
    text: str,
    name: str = "<text>",
    directory: str | Path = ".",
    *,
    robot: RobotChoice | str | None = None,
    params: SiteParams | None = None,
) -> Program:
    """Return the program of a text; `directory`, `robot` and `params` are as in `check_text`.

    Raises:
        DiagnosticError: there is an error; it holds all errors and warnings.
    """
    return _program(check_text(text, name, directory, robot=robot, params=params))


def _choice(robot: RobotChoice | str | None) -> RobotChoice | None:
    return RobotChoice(text=robot, origin=f"`robot={robot!r}`") if isinstance(robot, str) else robot


def _program(checked: Checked) -> Program:
    if checked.program is None:
        raise DiagnosticError(checked.diagnostics)
    return checked.program
