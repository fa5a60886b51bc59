"""What came of each mutant, kept in a file from run to run: a line a mutant, written as it comes.

A result holds as long as the module's text is what it was. A mutant that nothing killed is tried again when
tests have changed, unless it is explained why it changes nothing.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

from tools.mutants.mutation import Mutant
from tools.mutants.reasons import Reasons
from tools.mutants.scope import ROOT, digest
from tools.mutants.trial import Status, Verdict

NOTICED: tuple[Status, ...] = ("killed", "timeout")


class Results:
    """Of the modules and tests as they are now. Mutable: grows, and its file with it."""

    def __init__(self, file: Path, modules: list[str], tests: str, budget_s: float, reasons: Reasons) -> None:
        self._file, self._tests, self._budget_s = file, tests, budget_s
        self._reasons = reasons
        self._modules = {path: digest(ROOT / path) for path in modules}
        self._found: dict[tuple[str, str], Verdict] = {}
        self._of_other_tests: set[tuple[str, str]] = set()
        self.reload()

    def reload(self) -> None:
        """Read the file (again)."""
        if not self._file.exists():
            return
        for line in self._file.read_text().splitlines():
            path, module, tests, budget_s, key, status, by = json.loads(line)
            known = self._found.get((path, key))
            if self._modules.get(path) != module or (known is not None and known.status in NOTICED):
                continue
            self._found[path, key] = Verdict(status, by)
            if status in NOTICED or (tests == self._tests and budget_s >= self._budget_s):
                self._of_other_tests.discard((path, key))
            else:
                self._of_other_tests.add((path, key))

    def has(self, mutant: Mutant) -> bool:
        """Whether it need not be tried (again)."""
        key = (mutant.path, mutant.key)
        if key not in self._found:
            return False
        return key not in self._of_other_tests or self._reasons.why(mutant) is not None

    def of(self, mutant: Mutant) -> Verdict | None:
        return self._found.get((mutant.path, mutant.key))

    def add(self, mutant: Mutant, verdict: Verdict) -> None:
        self._found[mutant.path, mutant.key] = verdict
        self._of_other_tests.discard((mutant.path, mutant.key))
        self._file.parent.mkdir(parents=True, exist_ok=True)
        whose = (mutant.path, self._modules[mutant.path], self._tests, self._budget_s, mutant.key)
        with self._file.open("a") as file:
            file.write(json.dumps([*whose, verdict.status, verdict.by]) + "\n")

    def counts(self, path: str) -> Counter[Status]:
        """How many mutants of a module came to what."""
        return Counter(verdict.status for (of, _), verdict in self._found.items() if of == path)
