"""The tests without a mutant: how long each takes, and which lines of the mutated modules it runs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tools.mutants.scope import ROOT, digest

ARGUMENTS = (
    *("--tb=native", "--capture=sys", "-qq", "--no-header", "-p", "no:benchmark"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # hypothesis is imported ahead
    *("-m", ""),  # those that take long, too
)


@dataclass(frozen=True, slots=True)
class Baseline:
    """`seconds` by test, in the order of the suite (with coverage on, so about thrice what it takes else).

    `by_line` gives for each module, and each line that ran, the tests that ran it; `imports` the lines that
    ran while modules were imported and tests collected.
    """

    seconds: dict[str, float]
    by_line: dict[str, dict[int, set[str]]]
    imports: dict[str, set[int]]

    def tests(self, path: str, first: int, last: int) -> set[str]:
        """The tests that run any of these lines."""
        lines = self.by_line[path]
        return set[str]().union(*(lines.get(line, ()) for line in range(first, last + 1)))

    def tests_of(self, path: str) -> set[str]:
        """The tests that run anything of a module; all tests where none does."""
        return set[str]().union(*self.by_line[path].values()) or set(self.seconds)

    def runs_at_import(self, path: str, first: int, last: int) -> bool:
        """Whether any of these lines runs before the first test."""
        return any(first <= line <= last for line in self.imports[path])


def measured(files: list[str], modules: list[str], kept: Path) -> Baseline:
    """Of these files of tests; what is in `kept` already is not measured again, unless a file has changed.

    Raises:
        SystemExit: a test fails, or the tests cannot be run.
    """
    known = json.loads(kept.read_text()) if kept.exists() else {}
    stale = [path for path in files if known.get(path, {}).get("digest") != digest(ROOT / path)]
    if stale:
        print(f"{len(stale)} files of tests without a mutant ...", flush=True)
        child = os.fork()
        if not child:
            os._exit(_measure(stale, modules, known, kept))
        if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]):
            raise SystemExit("the tests do not pass without a mutant: mend them first")
        known = json.loads(kept.read_text())
    return _merged([known[path] for path in files], modules)


def _merged(of: list[dict[str, Any]], modules: list[str]) -> Baseline:
    seconds: dict[str, float] = {}
    tests: dict[str, dict[int, set[str]]] = {module: {} for module in modules}
    imports: dict[str, set[int]] = {module: set() for module in modules}
    for one in of:
        seconds |= one["seconds"]
        names = list(one["seconds"])
        for module, lines in one["lines"].items():
            for line, numbers in lines.items():
                tests[module].setdefault(int(line), set()).update(names[number] for number in numbers)
        for module, at_import in one["imports"].items():
            imports[module].update(at_import)
    return Baseline(seconds, tests, imports)


def _measure(files: list[str], modules: list[str], known: dict[str, Any], kept: Path) -> int:
    import coverage

    watch = coverage.Coverage(
        data_file=None, config_file=False, include=[str(ROOT / module) for module in modules]
    )
    watch.start()
    timing = _Timing(watch)
    code = pytest.main([*ARGUMENTS, *files], plugins=[timing])
    watch.stop()
    for name in timing.failed:
        print(f"fails without a mutant: {name}", flush=True)
    if code or timing.failed:
        return 1
    contexts = {module: watch.get_data().contexts_by_lineno(str(ROOT / module)) for module in modules}
    imports = {module: sorted(line for line, by in of.items() if "" in by) for module, of in contexts.items()}
    for file in files:
        seconds = {name: s for name, s in timing.seconds.items() if name.partition("::")[0] == file}
        numbers = {name: at for at, name in enumerate(seconds)}
        lines = {
            module: {line: sorted(numbers[c] for c in by if c in numbers) for line, by in of.items()}
            for module, of in contexts.items()
        }
        known[file] = {"digest": digest(ROOT / file), "seconds": seconds, "lines": lines, "imports": imports}
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(known))
    return 0


class _Timing:
    """Mutable: what each test took, and which failed."""

    def __init__(self, watch: object) -> None:
        self.seconds: dict[str, float] = {}
        self.failed: list[str] = []
        self._watch = watch

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._watch.switch_context(item.nodeid)  # type: ignore[attr-defined]
        try:
            return (yield)
        finally:
            self._watch.switch_context("")  # type: ignore[attr-defined]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration
        if report.failed:
            self.failed.append(report.nodeid)
