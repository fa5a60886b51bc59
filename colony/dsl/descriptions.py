"""Descriptions of robots, for `import robot`: which one a program is for, and where it is.

A description is a file that declares a robot. It is given by its path, or by its name if it comes with colony
or is in the folder `robots` of the project: `robots/NAME/NAME.colony`, with the robot's body beside it, or
`robots/NAME.colony`, a description without a body.

The project of a behavior is the nearest folder from its own upwards with a `colony.toml`, or a
`pyproject.toml` that has a table `[tool.colony]`; there, `robot = "NAME"` is the robot of all behaviors of
which nothing else says so.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from colony.files import read_file, reason
from colony.ir.program import Robot
from colony.record import Record, record
from colony.shipped import Shipped
from colony.text.diagnostics import Diagnostic, note
from colony.text.wording import did_you_mean

ROBOTS = "robots"
"""The folder of a project's own descriptions."""

MAX_PROJECT_BYTES = 1024 * 1024
"""Byte limit of a project's file."""


@record
class RobotChoice(Record):
    """The chosen description.

    Attributes:
        text: its name or path, as given.
        origin: what gave it, for messages: `--robot amr`.
        is_name: True if `text` is first of all the name of a running robot. It may then be no description at
            all, and a program that declares another robot keeps its own.
    """

    text: str
    origin: str
    is_name: bool = False


@record
class Project(Record):
    """A project's folder, its file, and the description that the file names, if any.

    `problem` says why the file cannot be used, if it cannot.
    """

    folder: Path
    file: Path
    robot: str | None = None
    problem: str | None = None


class _ProjectError(ValueError):
    """A project's file cannot be used; the message gives the file and the reason."""


def find_project(folder: Path) -> Project | None:
    """Return the project of a folder: that of the nearest project file, upwards.

    The file may be one that cannot be read, is not TOML, or whose `robot` is not a text.
    """
    start = Path(os.path.abspath(folder))
    for place in (start, *start.parents):
        for name in ("colony.toml", "pyproject.toml"):
            file = place / name
            if not os.path.lexists(file):
                continue
            try:
                table = _table(file)
                if table is not None:
                    return Project(folder=place, file=file, robot=_robot_of(file, table))
            except _ProjectError as problem:
                return Project(folder=place, file=file, problem=str(problem))
    return None


def _table(path: Path) -> dict[str, object] | None:
    """Return what a project's file says about colony; None for a `pyproject.toml` without `[tool.colony]`."""
    found = _read(path)
    if path.name == "colony.toml":
        return found
    tool = found.get("tool")
    table = tool.get("colony") if isinstance(tool, dict) else None
    return table if isinstance(table, dict) else None


def _read(path: Path) -> dict[str, object]:
    from colony.text.toml_places import tables_of  # only programs with `import robot` have a project

    try:
        return tables_of(read_file(path, MAX_PROJECT_BYTES).decode("utf-8-sig"))
    except OSError as problem:
        raise _ProjectError(f"cannot read `{shown(path)}`: {reason(problem)}") from None
    except ValueError as problem:  # not UTF-8, or not TOML
        raise _ProjectError(f"`{shown(path)}` is not TOML: {problem}") from None


def _robot_of(path: Path, table: dict[str, object]) -> str | None:
    robot = table.get("robot")
    if robot is None or (isinstance(robot, str) and robot):
        return robot
    raise _ProjectError(
        f"`robot` in `{shown(path)}` is {robot!r}; expected the name or path of a description"
    )


def find_description(text: str, folder: Path, project: Path | None) -> Path | None:
    """Return the file of a description; None if there is none.

    Args:
        text: its name or path.
        folder: where relative paths begin.
        project: the folder of the project, whose own descriptions come before those of colony.
    """
    if is_path(text):
        return _file_at(folder / text)
    for place in dict.fromkeys((project or folder, folder)):
        found = _file_at(place / ROBOTS / text)
        if found is not None:
            return found
    return Shipped.ROBOT.file_named(text)


def _file_at(path: Path) -> Path | None:
    """Return the description in the folder `path` of a robot, else the file `path`; None if none exists."""
    found = Shipped.ROBOT.user_file(path / path.name) or Shipped.ROBOT.user_file(path)
    return None if found is None else Path(found)


def find_body(robot: Robot) -> Path | None:
    """Return the file of a robot's body; None if it has none.

    It stands beside the interface (`body_beside`). That of a compiled program, which knows the place of its
    interface no more, is the one of the description that is called like the robot.
    """
    declared = [*(s for s in robot.sensors if s.of_robot), *robot.actuators]
    place = Path(declared[0].span.source.name) if declared else None
    if place is None or not place.is_file():
        found = find_description(robot.name, Path(), None) if re.fullmatch(r"\w+", robot.name) else None
        place = found
    if place is None:
        return None
    body = body_beside(place, robot.name)
    return body if body.is_file() else None


def find_in_project(text: str, folder: Path) -> Path | None:
    """Return the path of the description that a text names in `folder`, or in the project around it."""
    project = find_project(folder)
    return find_description(text, folder, None if project is None else project.folder)


def existing_choice(choice: RobotChoice | None, folder: Path) -> RobotChoice | None:
    """Return the choice; if it is a robot's name and no description has it, that of the project, or None.

    Args:
        choice: the choice.
        folder: where relative paths begin.
    """
    if choice is None or not choice.is_name:
        return choice
    project = find_project(folder)
    if find_in_project(choice.text, folder) is not None:
        return choice
    if project is None or project.robot is None:
        return None
    found = find_description(project.robot, project.folder, project.folder)
    return None if found is None else RobotChoice(text=str(found), origin=choice.origin, is_name=True)


def body_beside(interface: Path, robot: str) -> Path:
    """Return the place of a robot's body: beside the file of its interface, called like the robot."""
    return interface.with_name(f"{robot}.toml")


def body_note(robot: Robot, when_run: str) -> Diagnostic:
    """Return the note for a robot without a body; `when_run` says what a simulated run of it does."""
    name, place = robot.name, os.path.basename(robot.span.source.name)
    message = f"`{name}` has no body, so its sensors and actuators are not checked against servers"
    hint = (
        f"write `{name}.toml` beside `{place}`, or begin with `colony robot new` (docs/robots.md); {when_run}"
    )
    return note("N003", robot.span, message, hint)


def is_path(text: str) -> bool:
    """Return True for the path of a description, False for its name."""
    return os.path.basename(text) != text or text.endswith(Shipped.ROBOT.suffix) or text in ("", ".", "..")


def known_descriptions(folder: Path) -> tuple[str, ...]:
    """Return the names of the descriptions in `robots` of this folder and of those that come with colony."""
    return tuple(sorted({*_own_descriptions(folder), *Shipped.ROBOT.names()}))


def _own_descriptions(folder: Path) -> list[str]:
    """Return the names of the descriptions in `robots` of this folder."""
    robots, suffix = folder / ROBOTS, Shipped.ROBOT.suffix
    own = {path.stem for path in robots.glob(f"*/*{suffix}") if path.stem == path.parent.name}
    return sorted(own | {path.stem for path in robots.glob(f"*{suffix}")})


def listed_descriptions(folder: Path) -> str:
    """Return a text with the names of all descriptions, for hints."""
    own = _own_descriptions(folder)
    texts = [f"robots that come with colony: {', '.join(Shipped.ROBOT.names())}"]
    if own:
        texts.append(f"in `{shown(folder / ROBOTS)}`: {', '.join(own)}")
    return "; ".join(texts)


def suggestion(text: str, folder: Path) -> str:
    """Return a hint for an unknown description."""
    close = None if is_path(text) else did_you_mean(text, known_descriptions(folder))
    return close or listed_descriptions(folder)


def shown(path: Path) -> str:
    """Return a path as messages show it: relative to the current folder if it is inside."""
    relative = os.path.relpath(path)
    return os.path.abspath(path) if relative.startswith(os.pardir) else relative
