"""The tables: what came of the mutants of each module, and which survived."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from tools.mutants.mutation import Mutant
from tools.mutants.results import Results


@dataclass(frozen=True, slots=True)
class Row:
    """What came of the mutants of a module."""

    path: str
    killed: int
    timeout: int
    survived: int
    untried: int

    @property
    def mutants(self) -> int:
        return self.killed + self.timeout + self.survived + self.untried

    @property
    def rate(self) -> float:
        """The share of those tried that tests notice; a mutant that never ends is noticed."""
        tried = self.mutants - self.untried
        return 1.0 if not tried else (self.killed + self.timeout) / tried

    @property
    def cells(self) -> tuple[str, ...]:
        numbers = (self.mutants, self.killed, self.timeout, self.survived)
        return (self.path, *(f"{number:,}" for number in numbers), f"{100 * self.rate:.1f} %")


HEADER = ("module", "mutants", "killed", "without end", "survived", "rate")


def rows(mutants: dict[str, list[Mutant]], results: Results) -> list[Row]:
    """A row a module, and one for all."""
    found = []
    for path, several in mutants.items():
        counts = Counter(verdict.status if (verdict := results.of(m)) else "untried" for m in several)
        survived = counts["survived"] + counts["untested"]
        found.append(Row(path, counts["killed"], counts["timeout"], survived, counts["untried"]))
    whole = (
        sum(getattr(row, name) for row in found) for name in ("killed", "timeout", "survived", "untried")
    )
    return [*found, Row("all", *whole)]


def survivors(mutants: dict[str, list[Mutant]], results: Results) -> list[Mutant]:
    """Those that no test noticed, in the order of the text."""
    return [
        mutant
        for several in mutants.values()
        for mutant in several
        if (verdict := results.of(mutant)) and verdict.status in ("survived", "untested")
    ]


def plain(header: tuple[str, ...], lines: list[tuple[str, ...]]) -> str:
    """Return a table: the first column to the left, all others to the right."""
    widths = [max(map(len, column)) for column in zip(header, *lines, strict=True)]
    aligned = (
        [cell.rjust(width) if at else cell.ljust(width) for at, (cell, width) in enumerate(pairs)]
        for pairs in (zip(line, widths, strict=True) for line in (header, *lines))
    )
    return "\n".join("  ".join(cells).rstrip() for cells in aligned)
