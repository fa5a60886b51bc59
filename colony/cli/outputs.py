"""The output files of commands: written atomically, and never over a source or an input."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.reporting import say
from colony.files import reason
from colony.shipped import Shipped

# --- shipped files -------------------------------------------------------------------------------------
#
# Behaviors and maps on the command line: a path, or the name of a file shipped with colony.


class ShippedFile(click.ParamType):  # type: ignore[type-arg]
    """A parameter type for a file's path; `description` describes it in help texts."""

    def __init__(self, kind: Shipped, noun: str) -> None:
        self.name = kind.name.lower()
        self.description = f"{noun}, or the name of one that comes with colony"
        self._kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return an existing path as it is, or the path of the shipped file with this name."""
        return self._kind.find(os.fspath(value))


BEHAVIOR = ShippedFile(Shipped.BEHAVIOR, "a behavior")
MAP = ShippedFile(Shipped.MAP, "a StickRep map or an occupancy grid (*.yaml)")

map_option = click.option("--map", "map_path", metavar="MAP", type=MAP, help=f"The world: {MAP.description}.")
"""`--map MAP`, as `map_path`."""


# --- outputs -------------------------------------------------------------------------------------------


DESCRIPTORS = (Path("/dev"), Path("/dev/fd"), Path("/proc/self/fd"))
"""Folders of devices and of this process's open files. Pipes elsewhere may never get a reader."""

_STANDARD = {"/dev/stdout": "1", "/dev/stderr": "2"}

SOURCES = (".colony", ".stickrep", ".yaml")
"""Suffixes of source files, which no command overwrites."""

output_option = click.option(
    "-o",
    "--output",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="The output file. [default: standard output]",
)
"""`--output PATH` of commands that write text, as `output`."""


def cannot_write(path: str | Path, why: str) -> NoReturn:
    """Report in one line that a file cannot be written, and exit with 2."""
    say(f"{path}: error: cannot write: {why}")
    raise click.exceptions.Exit(EXIT_MISUSE)


def check_output(path: str | Path, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse an output that cannot or must not be written, before the work begins; exit with 2."""
    try:
        why = _reason_to_refuse(Path(path), inputs)
    except (OSError, RuntimeError, ValueError) as problem:
        why = reason(problem)
    if why is not None:
        cannot_write(path, why)


def _reason_to_refuse(path: Path, inputs: Iterable[str | Path]) -> str | None:
    if path.is_dir():
        return "Is a directory"
    if any(_is_same_file(path, Path(source)) for source in inputs):
        return "it is an input of this command"
    if path.exists():
        if path.suffix in SOURCES or path.resolve().suffix in SOURCES:
            return "it is a source file that already exists"
        if not os.access(path, os.W_OK):
            return "Permission denied"
        if not (path.is_file() or path.is_char_device() or path.absolute().parent in DESCRIPTORS):
            return "it is not a regular file"
        if _is_written_in_place(path):
            return None
    folder = path.resolve().parent
    if not folder.is_dir():
        return "the folder does not exist"
    return None if os.access(folder, os.W_OK | os.X_OK) else "Permission denied"


def _is_same_file(path: Path, other: Path) -> bool:
    try:
        return path.samefile(other)
    except (OSError, ValueError):
        return False


def _is_written_in_place(path: Path) -> bool:
    """Return True if a path is written in place: a file must not replace a device or a pipe."""
    return path.absolute().is_relative_to("/dev") or (path.exists() and not path.is_file())


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file atomically; exit with 2 if it cannot be written.

    The target of a symbolic link is replaced; devices, and pipes that are open already, are written in place.
    """
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    with write_to(path) as file:
        file.write(data)


@contextmanager
def write_to(path: Path) -> Iterator[BinaryIO]:
    """Lend a file that is written as by `write_whole` when the context ends without an exception."""
    try:
        in_place, target = _is_written_in_place(path), path.resolve()
    except (OSError, RuntimeError, ValueError) as problem:
        cannot_write(path, reason(problem))
    try:
        with _in_place(path) if in_place else _replacement(target) as file:
            yield file
    except BrokenPipeError:
        raise
    except OSError as problem:
        cannot_write(path, reason(problem))


def _in_place(path: Path) -> BinaryIO:
    """Open a device, or an open file of this process where it stands: opened anew, it would be cut off."""
    descriptor = _STANDARD.get(str(path), path.name if path.parent in DESCRIPTORS[1:] else "")
    return os.fdopen(os.dup(int(descriptor)), "wb") if descriptor.isdecimal() else path.open("wb")


@contextmanager
def _replacement(target: Path) -> Iterator[BinaryIO]:
    temporary = target.with_name(f".colony-{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            yield file
        if target.exists():
            shutil.copymode(target, temporary)
        temporary.replace(target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
