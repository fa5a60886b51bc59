"""The robot of `import robot`: the one that the program declares, or else the one that was chosen for it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

from colony.dsl import ast
from colony.dsl.descriptions import (
    Project,
    RobotChoice,
    find_description,
    find_project,
    is_path,
    listed_descriptions,
    shown,
    suggestion,
)
from colony.record import Record, record
from colony.shipped import Shipped
from colony.text.diagnostics import Diagnostic, error
from colony.text.source import Source, Span


@record
class ProgramContext(Record):
    """The data that decide which robot `import robot` brings into a program.

    Attributes:
        choice: the description that the caller chose, if any.
        folder: the folder in which the search for the project begins; None for a program given as text.
        is_shipped: True for a behavior that comes with colony: the project of the shipped behaviors is used
            if the current folder's names no robot.
    """

    choice: RobotChoice | None = None
    folder: Path | None = None
    is_shipped: bool = False


def context_of_file(path: Path, choice: RobotChoice | None) -> ProgramContext:
    """Return the context of a file; that of a behavior that comes with colony is the current folder."""
    try:
        real = Path(os.path.realpath(path))
        is_shipped = any(os.path.realpath(kind.path(real.stem)) == str(real) for kind in Shipped)
    except (OSError, ValueError):  # no path at all, as reading it reports
        is_shipped = False
    return ProgramContext(choice=choice, folder=Path() if is_shipped else path.parent, is_shipped=is_shipped)


class ProgramFile(NamedTuple):
    """A file of the program: its key, its text and its tree."""

    key: str
    source: Source
    tree: ast.File

    def span(self, node: ast.SyntaxNode) -> Span:
        """Return the span of a node of the file."""
        return Span(self.source, node.start, node.end)


def declaring_file(files: Iterable[ProgramFile]) -> tuple[ProgramFile, ast.RobotDecl] | None:
    """Return the first file that declares a robot, with the declaration."""
    for file in files:
        for node in file.tree.declarations:
            if isinstance(node, ast.RobotDecl):
                return file, node
    return None


def robot_import_span(files: Iterable[ProgramFile]) -> Span | None:
    """Return the span of the first `import robot`."""
    for file in files:
        for node in file.tree.declarations:
            if isinstance(node, ast.RobotImportDecl):
                return file.span(node)
    return None


def chosen_description(import_span: Span, context: ProgramContext) -> Path | Diagnostic:
    """Return the file of the description for a program that declares no robot, or the error."""
    project = _project(context)
    project_folder = Path() if project is None else project.folder
    choice = context.choice
    if choice is not None:
        found = find_description(choice.text, Path(), project_folder)
        if found is not None:
            return found
        if not choice.is_name:
            return _unknown(import_span, choice, project_folder)
    if project is not None and project.problem is not None:
        given = "NAME" if choice is None else f"{choice.text}=DESCRIPTION"
        hint = f'write `robot = "NAME"` there, or give --robot {given}'
        return error("E323", import_span, project.problem, hint)
    if project is not None and project.robot is not None:
        found = find_description(project.robot, project.folder, project.folder)
        if found is not None:
            return found
        named = RobotChoice(text=project.robot, origin=f"`{shown(project.file)}`")
        return _unknown(import_span, named, project.folder)
    return _none_chosen(import_span, context, project)


def _project(context: ProgramContext) -> Project | None:
    """Return the project that decides for a program, None if there is none."""
    project = None if context.folder is None else find_project(context.folder)
    if context.is_shipped and (project is None or (project.robot is None and project.problem is None)):
        return find_project(Shipped.BEHAVIOR.folder)
    return project


def _unknown(import_span: Span, choice: RobotChoice, folder: Path) -> Diagnostic:
    what = "there is no description" if is_path(choice.text) else "unknown description"
    message = f"{what} `{choice.text}`, which {choice.origin} names"
    return error("E321", import_span, message, suggestion(choice.text, folder))


def _none_chosen(import_span: Span, context: ProgramContext, project: Project | None) -> Diagnostic:
    folder = Path() if project is None else project.folder
    if context.folder is None:
        how = "give `robot=`"
    elif context.choice is not None:
        how = f"`{context.choice.text}` is no description: give --robot {context.choice.text}=DESCRIPTION"
    elif project is None:
        how = 'give --robot NAME, or write `robot = "NAME"` in colony.toml'
    else:
        how = f'give --robot NAME, or write `robot = "NAME"` in `{shown(project.file)}`'
    return error(
        "E320", import_span, "no robot is chosen for this program", f"{how}; {listed_descriptions(folder)}"
    )


def conflicting_choice(
    declared: tuple[ProgramFile, ast.RobotDecl], keys: Mapping[str, object], context: ProgramContext
) -> Diagnostic | None:
    """Return the error if another robot was chosen than the one that the program declares."""
    choice, (file, node) = context.choice, declared
    if choice is None or choice.is_name:
        return None
    project = _project(context)
    folder = Path() if project is None else project.folder
    found = find_description(choice.text, Path(), folder)
    if found is None:
        return _unknown(file.span(node.name), choice, folder)
    if os.path.realpath(found) in keys:
        return None
    name = node.name.text
    message = f"the program has its own robot, `{name}`: {choice.origin} cannot give it another description"
    hint = "write `import robot` in its place, and the description in a file of its own"
    return error("E322", file.span(node.name), message, hint)
