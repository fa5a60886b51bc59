"""The process that analyzes, or that proves: jobs on its standard input, answers on its standard output.

What is printed meanwhile, such as by modules in Python, goes to standard error.
"""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from colony.editing.analysis import Analyzer
from colony.editing.features.renaming import renaming_problem
from colony.editing.formatting import formatted
from colony.editing.index import Declaration, Index, IndexedFile
from colony.editing.server.jobs import (
    AnalyzeAnswer,
    AnalyzeJob,
    Answer,
    FormatAnswer,
    FormatJob,
    Job,
    OpenProgram,
    ProveAnswer,
    ProveJob,
    Unpacking,
    UsesAnswer,
    UsesJob,
    packed,
)
from colony.shipped import Shipped
from colony.text.diagnostics import DiagnosticError

MAX_FILES = 500
"""Maximum number of files of a workspace that are searched for uses of a name."""

_CHUNK = 1 << 16


class Worker:
    """Does jobs, one after the other. Stateful: keeps what networks of programs were."""

    def __init__(self) -> None:
        self._analyzer = Analyzer()

    def answers(self, job: Job) -> Iterator[Answer]:
        """Yield the answers to a job; a bug becomes an answer, too."""
        try:
            match job:
                case AnalyzeJob(number=number, program=program):
                    yield AnalyzeAnswer(number, self._analyze(program))
                case UsesJob():
                    yield self._uses(job)
                case FormatJob():
                    yield _formatted(job)
                case ProveJob():
                    from colony.editing.server.proving import verdicts  # loads the prover

                    yield from verdicts(job, self._analyzer)
        except Exception:
            failed = traceback.format_exc()
            in_short = "a bug in colony: " + failed.splitlines()[-1]
            if isinstance(job, AnalyzeJob):
                yield AnalyzeAnswer(job.number, Index(), failed)
            elif isinstance(job, UsesJob):
                yield UsesAnswer(job.number, "", "", [], {}, in_short)
            elif isinstance(job, FormatJob):
                yield FormatAnswer(job.number, "", in_short)
            else:
                yield ProveAnswer(job.number, failed=failed)

    def _analyze(self, program: OpenProgram) -> Index:
        return self._analyzer.analyze(program.path, program.texts, program.robot).index

    def _uses(self, job: UsesJob) -> UsesAnswer:
        """Return every use of a name: in its program, and in those that import the file that declares it.

        A new name may clash in any of these programs, so that all of them are read for one.
        """
        index = self._analyze(job.program)
        use = index.use_at(index.root, job.offset) if index.files else None
        if use is None:
            return UsesAnswer(job.number, "", "", [], {}, "no name of the program stands here")
        declared = index.declarations[use[2]]
        home = index.files[declared.file]
        found: dict[tuple[str, int, int], None] = {}
        texts: dict[str, str] = {}
        programs, unread = [index], ""
        word = re.compile(rf"\b{re.escape(declared.name)}\b")
        candidates = _texts(job)
        for path in _importers(home, candidates):
            has_word = word.search(candidates[path])
            if index.file(path) is not None or not (has_word or job.new_name):
                continue
            other = self._analyze(OpenProgram(path, job.program.texts, job.program.robot))
            if other.file(home.path) is not None:
                programs.append(other)
            elif has_word and not other.files:
                unread = f"`{declared.name}` stands in `{path}`, which cannot be read"
        for program in programs:
            for file in program.files:
                texts[file.path] = file.text
                for start, end, number in file.uses:
                    if _is(program, program.declarations[number], declared, home.path):
                        found[file.path, start, end] = None
        answer = UsesAnswer(job.number, declared.kind, declared.name, list(found), texts)
        if job.new_name:
            analyzer = Analyzer()  # which forgets the networks of what is only tried

            def tried(path: str, renamed: Mapping[str, str]) -> Index:
                return analyzer.analyze(path, {**job.program.texts, **renamed}, job.program.robot).index

            answer.refusal = unread or renaming_problem(answer, job.new_name, programs, tried)
        return answer


def _is(program: Index, other: Declaration, declared: Declaration, home: str) -> bool:
    """Return True if a declaration of another program is the same piece of text."""
    return (
        other.start == declared.start
        and other.kind == declared.kind
        and other.name == declared.name
        and program.files[other.file].path == home
    )


def _texts(job: UsesJob) -> dict[str, str]:
    """Return the texts of all files of the folders of a job, and of the open ones, by path."""
    found = dict(job.program.texts)
    for path in behavior_files(job.folders):
        with suppress(OSError):
            found.setdefault(path, Path(path).read_text(encoding="utf-8", errors="replace"))
    return found


_IMPORT = re.compile(r'^[ \t]*import\s+(?:"([^"\r\n]*)"|robot\b)', re.MULTILINE)
_ROBOT = re.compile(r"^[ \t]*robot\s+\w", re.MULTILINE)


def _importers(home: IndexedFile, texts: Mapping[str, str]) -> list[str]:
    """Return the files that may import a file, directly or through others, by the names in their imports."""
    imports = {path: {Path(m[1] or "robot").stem for m in _IMPORT.finditer(t)} for path, t in texts.items()}
    found: dict[str, None] = {}
    names, added = set[str](), [(home.path, home.text)]
    while added:
        names |= {Path(path).stem for path, _ in added}
        names |= {"robot" for _, text in added if _ROBOT.search(text)}
        added = [(path, texts[path]) for path in imports if path not in found and imports[path] & names]
        found |= dict.fromkeys(path for path, _ in added)
    return [*found]


def _formatted(job: FormatJob) -> FormatAnswer:
    try:
        return FormatAnswer(job.number, formatted(job.text, job.path))
    except DiagnosticError:
        return FormatAnswer(job.number, job.text)


def behavior_files(folders: list[str]) -> Iterator[str]:
    """Yield the real paths of the behaviors in folders, at most `MAX_FILES`; hidden folders are left out."""
    count = 0
    for folder in folders:
        for place, inner, names in os.walk(folder):
            inner[:] = sorted(name for name in inner if not name.startswith(".") and name != "node_modules")
            for name in sorted(names):
                if name.endswith(Shipped.BEHAVIOR.suffix):
                    count += 1
                    if count > MAX_FILES:
                        return
                    yield os.path.realpath(os.path.join(place, name))


def main() -> None:
    """Do the jobs on standard input until it ends."""
    answers = os.dup(1)
    os.dup2(2, 1)
    os.nice(5)  # what is typed comes first
    worker, unpacking = Worker(), Unpacking()
    while data := os.read(0, _CHUNK):
        jobs: Iterator[Job] = unpacking.feed(data, Job)  # type: ignore[arg-type]
        with suppress(BrokenPipeError):  # the server is gone
            for job in jobs:
                for found in worker.answers(job):
                    _write(answers, packed(found))
    sys.exit(0)


def _write(descriptor: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]


if __name__ == "__main__":
    main()
