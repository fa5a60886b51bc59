"""Open recordings, and the programs in them, rebuilt from their sources."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO, Literal

from colony.dsl.check.program import check_program
from colony.dsl.check.site_values import with_site_labels
from colony.dsl.descriptions import RobotChoice
from colony.dsl.files import SHIPPED, SourceTree, load_tree, real_path
from colony.dsl.robot_import import ProgramContext
from colony.dsl.site import SiteParams
from colony.dsl.site_reading import params_of
from colony.execute.compiled import SourceFile, is_source_path
from colony.files import naming
from colony.ir.program import Program
from colony.ir.site import Site
from colony.runtime.recordings.opening import open_recording, read_recording, recorded_site
from colony.runtime.recordings.recorded import RecordingReader
from colony.text.diagnostics import Diagnostic, DiagnosticError, error, has_errors, headline
from colony.text.source import Source, Span


class OpenRecording:
    """A recording whose file is open. Mutable: its readers share the file, and each begins anew.

    Args:
        stream: the file, which is closed with the recording.
        name: its name in messages.
        read: makes a reader; `read_frames` also reads frames that no run recorded.

    Raises:
        DiagnosticError: as by `read`.

    Attributes:
        reader: the newest reader.
        run: the recorded run; None if the format contains no information about it.
        params: the params that a site set for the run; None if it set none, or the file is a pipe.
    """

    def __init__(
        self,
        stream: BinaryIO,
        name: str,
        read: Callable[[BinaryIO, str], RecordingReader] = read_recording,
    ) -> None:
        self.name, self.stream, self._read = name, stream, read
        with ExitStack() as resources:
            resources.callback(stream.close)
            self.reader = read(stream, name)
            self.run = self.reader.run
            self.params = params_of(recorded_site(self.reader, stream)) if stream.seekable() else None
            self._resources = resources.pop_all()

    @classmethod
    def at(cls, path: str | PathLike[str]) -> OpenRecording:
        """Open the recording at a path.

        Raises:
            DiagnosticError: as by `open_recording` and `read_recording`.
        """
        return cls(open_recording(str(path)), str(path))

    def again(self) -> RecordingReader:
        """Return a reader of the frames, after which the ones before are of no use."""
        self.stream.seek(0)
        self.reader = self._read(self.stream, self.name)
        return self.reader

    def program(self, params: SiteParams | None = None) -> Program:
        """Return the program in the recording, whose files exist until the recording is closed.

        Args:
            params: params of a site; by default those in the recording.

        Raises:
            DiagnosticError: as by `recorded_program`; A005 also for JSON lines.
        """
        return self._resources.enter_context(recorded_program(self.reader, self.name, params))

    def __enter__(self) -> OpenRecording:
        """Return the recording."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Close the file, and delete the files of the program."""
        self._resources.close()


@contextmanager
def recorded_program(
    reader: RecordingReader, name: str, params: SiteParams | None = None
) -> Iterator[Program]:
    """Rebuild the program that a reader has; see `unpacked_program`.

    Raises:
        DiagnosticError: A005, the recording does not have the whole program, or the program has errors; A006,
            a file of it is damaged; or the errors that `params` make in a good program.
    """
    run = reader.run
    if run is None:
        raise DiagnosticError([unusable(name, "a recording as JSON lines does not contain its program")])
    if run.program_damage:
        raise DiagnosticError([unusable(name, f"its program is damaged ({run.program_damage})", code="A006")])
    with unpacked_program(run.program, run.sources, run.site, name, params) as program:
        yield program


MAX_DESCRIPTIONS = 20
"""Maximum number of files of a recording that are tried as the description of the robot."""


@contextmanager
def unpacked_program(
    root: str,
    sources: Iterable[SourceFile],
    site: Site | None,
    name: str,
    params: SiteParams | None = None,
) -> Iterator[Program]:
    """Rebuild a program from its sources, which are unpacked as long as the context lasts.

    The robot's body is unpacked beside its interface, where `find_body` finds it. No Python module is run.

    Args:
        root: path in `sources` of the behavior.
        sources: the source files.
        site: the params that a site set.
        name: the name of the recording or robot in messages.
        params: params of a site in place of `site`.

    Raises:
        DiagnosticError: A005, the sources are not the whole program, or it has errors; or the errors that
            `params` make in a good program.
    """
    files = tuple(sources)
    if not any(s.path == root and s.kind == "behavior" for s in files):
        raise DiagnosticError([unusable(name, "the recording does not contain its program")])
    for source in files:
        if not is_source_path(source.path):
            raise DiagnosticError([unusable(name, f"its program has a file outside it: {source.path!r}")])
    with TemporaryDirectory(prefix="colony-recorded-") as folder:
        try:
            for source in files:
                path = Path(folder, "python" if source.kind == "python" else "behavior", source.path)
                path.parent.mkdir(parents=True, exist_ok=True)
                with naming(path):
                    path.write_bytes(source.data)
        except (OSError, ValueError) as problem:
            raise DiagnosticError([unusable(name, f"its program cannot be unpacked: {problem}")]) from None
        behaviors = [s.path for s in files if s.kind == "behavior"]
        tree = _tree(Path(folder, "behavior"), root, behaviors)
        program, diagnostics = check_program(tree, params=params or params_of(site))
        if program is None:
            if params is not None and (own := check_program(tree))[0] is not None:
                raise DiagnosticError(with_site_labels(diagnostics, own[1], params))
            first = next(d for d in diagnostics if has_errors([d]))
            raise DiagnosticError([unusable(name, f"its program has errors: {headline(first)}")])
        yield program


def _tree(folder: Path, root: str, behaviors: list[str]) -> SourceTree:
    """Return the files of a recorded program in a folder.

    One that is not imported by path, from the main file on, can only be the robot's description, which is
    the one of `import robot`, or a file that the description imports.
    """
    tree = _loaded(folder, root, None)
    if not any(d.code == "E320" for d in tree.diagnostics):
        return tree
    recorded = {real_path(folder / path): folder / path for path in behaviors}
    others = [key for key in recorded if key not in {file.key for file in tree.files}]
    for key in others[:MAX_DESCRIPTIONS]:
        choice = RobotChoice(text=str(recorded[key].absolute()), origin="the recording")
        found = _loaded(folder, root, choice)
        if recorded.keys() <= {file.key for file in found.files}:
            return found
    return tree


def _loaded(folder: Path, root: str, choice: RobotChoice | None) -> SourceTree:
    path, context = folder / root, ProgramContext(choice=choice)
    return load_tree(path, root, shipped=path.parent / SHIPPED, context=context, within=folder)


def unusable(name: str, message: str, *, code: Literal["A005", "A006"] = "A005") -> Diagnostic:
    """Return the reason why the program of the recording `name` cannot be used."""
    return error(code, Span(Source(name, ""), 0, 0), message, "give the behavior that was run as FILE")
