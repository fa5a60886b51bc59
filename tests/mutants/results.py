"""What came of each mutant, kept in a file from run to run: a line a mutant, written as it comes.

A result holds as long as the module's text is what it was. A mutant that nothing killed is tried again when
tests have changed.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import get_args

from tests.mutants.mutation import Mutant
from tests.mutants.scope import ROOT, digest
from tests.mutants.trial import Status, Verdict

STATUSES: tuple[Status, ...] = get_args(Status)


class Results:
    """Of the modules and tests as they are now. Mutable: grows, and its file with it."""

    def __init__(self, file: Path, modules: list[str], tests: str, budget_s: float) -> None:
        self._file, self._tests, self._budget_s = file, tests, budget_s
        self._modules = {path: digest(ROOT / path) for path in modules}
        self._found: dict[tuple[str, str], Verdict] = {}
        self.reload()

    def reload(self) -> None:
        """Read the file (again)."""
        if not self._file.exists():
            return
        for line in self._file.read_text().splitlines():
            path, module, tests, budget_s, key, status, by = json.loads(line)
            same_tests = tests == self._tests and budget_s >= self._budget_s
            if self._modules.get(path) == module and (status in ("killed", "timeout") or same_tests):
                self._found[path, key] = Verdict(status, by)

    def has(self, mutant: Mutant) -> bool:
        return (mutant.path, mutant.key) in self._found

    def of(self, mutant: Mutant) -> Verdict | None:
        return self._found.get((mutant.path, mutant.key))

    def add(self, mutant: Mutant, verdict: Verdict) -> None:
        self._found[mutant.path, mutant.key] = verdict
        self._file.parent.mkdir(parents=True, exist_ok=True)
        whose = (mutant.path, self._modules[mutant.path], self._tests, self._budget_s, mutant.key)
        with self._file.open("a") as file:
            file.write(json.dumps([*whose, verdict.status, verdict.by]) + "\n")

    def counts(self, path: str) -> Counter[Status]:
        """How many mutants of a module came to what."""
        return Counter(verdict.status for (of, _), verdict in self._found.items() if of == path)
