"""The program of a recording, rebuilt from the sources in it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from colony.dsl.check.program import check_program
from colony.dsl.check.site_labels import with_site_labels
from colony.dsl.descriptions import RobotChoice
from colony.dsl.files import SHIPPED, SourceTree, load_tree, real_path
from colony.dsl.robot_import import ProgramContext
from colony.dsl.site import SiteParams
from colony.dsl.site_reading import params_of
from colony.execute.compiled import is_source_path
from colony.ir.program import Program
from colony.os_errors import naming
from colony.runtime.recordings.recorded import RunInfo
from colony.text.diagnostics import Diagnostic, DiagnosticError, error, has_errors, headline
from colony.text.source import Source, Span

MAX_DESCRIPTIONS = 20
"""Maximum number of files of a recording that are tried as the description of the robot."""


def recorded_program(run: RunInfo, name: str, folder: Path, params: SiteParams | None = None) -> Program:
    """Return the program of a recording; its sources are unpacked into `behavior` and `python` in `folder`.

    The robot's body is unpacked beside its interface, where `find_body` finds it.

    `name` is the name of the recording in messages. The params of a site are `params`, by default
    those in the recording. No Python module is run.

    Raises:
        DiagnosticError: A005, the recording does not have the whole program, or the program has errors; A006,
            a file of it is damaged; or the errors that `params` make in a good program.
    """
    if run.program_damage:
        raise DiagnosticError([unusable(name, f"its program is damaged ({run.program_damage})", code="A006")])
    if not any(s.path == run.program and s.kind == "behavior" for s in run.sources):
        raise DiagnosticError([unusable(name, "the recording does not contain its program")])
    for source in run.sources:
        if not is_source_path(source.path):
            raise DiagnosticError([unusable(name, f"its program has a file outside it: {source.path!r}")])
    try:
        for source in run.sources:
            path = folder / ("python" if source.kind == "python" else "behavior") / source.path
            path.parent.mkdir(parents=True, exist_ok=True)
            with naming(path):
                path.write_bytes(source.data)
    except (OSError, ValueError) as problem:
        raise DiagnosticError([unusable(name, f"its program cannot be unpacked: {problem}")]) from None
    tree = _tree(folder / "behavior" / run.program, run)
    program, diagnostics = check_program(tree, params=params or params_of(run.site))
    if program is None:
        if params is not None and (own := check_program(tree))[0] is not None:
            raise DiagnosticError(with_site_labels(diagnostics, own[1], params))
        first = next(d for d in diagnostics if has_errors([d]))
        raise DiagnosticError([unusable(name, f"its program has errors: {headline(first)}")])
    return program


def _tree(root: Path, run: RunInfo) -> SourceTree:
    """Return the files of a recorded program.

    One that is not imported by path, from the main file on, can only be the robot's description, which is
    the one of `import robot`, or a file that the description imports.
    """
    tree, folder = _loaded(root, run, None), root.parents[len(Path(run.program).parts) - 1]
    if not any(d.code == "E320" for d in tree.diagnostics):
        return tree
    recorded = {real_path(folder / s.path): folder / s.path for s in run.sources if s.kind == "behavior"}
    others = [key for key in recorded if key not in {file.key for file in tree.files}]
    for key in others[:MAX_DESCRIPTIONS]:
        choice = RobotChoice(text=str(recorded[key].absolute()), origin="the recording")
        found = _loaded(root, run, choice)
        if recorded.keys() <= {file.key for file in found.files}:
            return found
    return tree


def _loaded(root: Path, run: RunInfo, choice: RobotChoice | None) -> SourceTree:
    context = ProgramContext(choice=choice)
    return load_tree(
        root,
        run.program,
        shipped=root.parent / SHIPPED,
        context=context,
        within=root.parents[len(Path(run.program).parts) - 1],
    )


def unusable(name: str, message: str, *, code: Literal["A005", "A006"] = "A005") -> Diagnostic:
    """Return the reason why the program of the recording `name` cannot be used."""
    return error(code, Span(Source(name, ""), 0, 0), message, "give the behavior that was run as FILE")
