"""The process that analyzes, or that proves: jobs on its standard input, answers on its standard output.

What is printed meanwhile, such as by modules in Python, goes to standard error.
"""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from colony.editing.analysis import Analyzer
from colony.editing.index import Declaration, Index
from colony.editing.server.jobs import (
    AnalyzeAnswer,
    AnalyzeJob,
    Answer,
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
                case ProveJob():
                    from colony.editing.server.proving import verdicts  # loads the prover

                    yield from verdicts(job, self._analyzer)
        except Exception:
            failed = traceback.format_exc()
            if isinstance(job, AnalyzeJob):
                yield AnalyzeAnswer(job.number, Index(), failed)
            elif isinstance(job, UsesJob):
                yield UsesAnswer(job.number, "", "", [], {}, "a bug in colony: " + failed.splitlines()[-1])
            else:
                yield ProveAnswer(job.number, failed=failed)

    def _analyze(self, program: OpenProgram) -> Index:
        return self._analyzer.analyze(program.path, program.texts, program.robot).index

    def _uses(self, job: UsesJob) -> UsesAnswer:
        """Return every use of a name: in its program, and in those that import the file that declares it."""
        index = self._analyze(job.program)
        use = index.use_at(index.root, job.offset) if index.files else None
        if use is None:
            return UsesAnswer(job.number, "", "", [], {}, "no name of the program stands here")
        declared = index.declarations[use[2]]
        home = index.files[declared.file]
        found: dict[tuple[str, int, int], None] = {}
        texts: dict[str, str] = {}
        programs = [index]
        for path in _files_with(declared.name, job.folders, {f.path for f in index.files}, job.program.texts):
            other = self._analyze(OpenProgram(path, job.program.texts, job.program.robot))
            if other.file(home.path) is not None:
                programs.append(other)
        for program in programs:
            for file in program.files:
                texts[file.path] = file.text
                for start, end, number in file.uses:
                    if _is(program, program.declarations[number], declared, home.path):
                        found[file.path, start, end] = None
        return UsesAnswer(job.number, declared.kind, declared.name, list(found), texts)


def _is(program: Index, other: Declaration, declared: Declaration, home: str) -> bool:
    """Return True if a declaration of another program is the same piece of text."""
    return (
        other.start == declared.start
        and other.kind == declared.kind
        and other.name == declared.name
        and program.files[other.file].path == home
    )


def _files_with(name: str, folders: list[str], known: set[str], texts: dict[str, str]) -> Iterator[str]:
    """Yield the files of folders, and the open ones, that have a word and are not known."""
    word = re.compile(rf"\b{re.escape(name)}\b")
    for path in dict.fromkeys((*texts, *behavior_files(folders))):
        if path in known:
            continue
        try:
            text = texts.get(path) or Path(path).read_text(encoding="utf-8", errors="replace")
        except OSError:
            continue
        if word.search(text):
            yield path


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
