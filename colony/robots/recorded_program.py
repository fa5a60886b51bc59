"""The sources of a program for its recording, and the program of a recording from these."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from colony.dsl.check.program import check_program
from colony.dsl.files import SourceTree, load_tree
from colony.execute.compiled import SourceFile
from colony.ir.program import Program, PythonModule
from colony.os_errors import naming
from colony.robots.python_sources import python_sources
from colony.runtime.recordings.recorded import RunInfo
from colony.text.diagnostics import Diagnostic, Failure, error, has_errors, headline
from colony.text.source import Source, Span


def program_sources(
    path: str, program: Program, tree: SourceTree, report: Callable[[str], None] = lambda text: None
) -> tuple[str, tuple[SourceFile, ...]]:
    """Return the place of the file at `path`, and all files that `program` was made of.

    Places are relative to the folder that has all of them. `report` is told of modules in Python that cannot
    be read, which are left out.
    """
    places = _places(path, tree)
    base = os.path.commonpath([os.path.dirname(place) for place in places.values()]) if places else "."
    root, sources = "", []
    for file in tree.files:
        place = Path(os.path.relpath(places[file.key], base)).as_posix()
        root = place if file.is_root else root
        sources.append(SourceFile(kind="behavior", place=place, data=file.source.text.encode()))
    modules = (m.module_path for m in program.modules if isinstance(m, PythonModule))
    return root, (*sources, *python_sources(modules, report))


def _places(path: str, tree: SourceTree) -> dict[str, str]:
    """Where each file must be so that imports find it, by its key; importers stand after what they import."""
    places: dict[str, str] = {}
    for file in reversed(tree.files):
        place = places.setdefault(file.key, os.path.abspath(path))
        for one in file.imports:
            target = os.path.join(os.path.dirname(place), one.declaration.path)
            places.setdefault(one.target, os.path.normpath(target))
    return {file.key: places[file.key] for file in tree.files}


def recorded_program(run: RunInfo, name: str, folder: Path) -> Program:
    """The program of a recording, whose sources are put into `folder`: `behavior` and `python` in it.

    `name` is what messages call the recording. Nothing in Python is run.

    Raises:
        Failure: A005, the recording does not have the whole program, or there are errors in it.
    """
    if not any(s.place == run.program and s.kind == "behavior" for s in run.sources):
        raise Failure([unusable(name, "the recording does not hold its program")])
    try:
        for source in run.sources:
            path = folder / source.kind / source.place
            path.parent.mkdir(parents=True, exist_ok=True)
            with naming(path):
                path.write_bytes(source.data)
    except (OSError, ValueError) as problem:
        raise Failure([unusable(name, f"its program cannot be unpacked: {problem}")]) from None
    root = folder / "behavior" / run.program
    tree = load_tree(root, run.program)
    inside = os.path.realpath(folder / "behavior")
    strangers = [f.key for f in tree.files if not Path(f.key).is_relative_to(inside)]
    if strangers:
        raise Failure([unusable(name, f"its program imports `{strangers[0]}`, which is not in it")])
    program, diagnostics = check_program(tree)
    if program is None:
        first = next(d for d in diagnostics if has_errors([d]))
        raise Failure([unusable(name, f"its program does not check: {headline(first)}")])
    return program


def unusable(name: str, message: str) -> Diagnostic:
    """A005: why the program of the recording `name` cannot be used."""
    return error("A005", Span(Source(name, ""), 0, 0), message, "name the behavior that was run as FILE")
