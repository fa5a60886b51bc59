"""The tables: what came of the mutants of each module, who survived and why, and of the seeded bugs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from tests.mutants.mutation import Mutant
from tests.mutants.reasons import Reasons
from tests.mutants.results import Results
from tests.mutants.scope import ROOT

PAGE = ROOT / "docs" / "mutants.md"
MARK = "<!-- results -->"


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


def bugs() -> Iterator[tuple[str, str]]:
    """Each seeded bug, planted, and what noticed it."""
    from tests.verify.testing import test_seeded_bugs as seeded

    for bug in seeded.BUGS:
        with pytest.MonkeyPatch.context() as patch:
            bug.plant(patch)
            seed = seeded.caught(bug.network, seeded.GENERATED if bug.generated else seeded.BY_CLIENTS)
        kind = "network" if bug.network else "program"
        yield bug.name, "not noticed" if seed is None else f"{kind} of seed {seed}"


def plain(header: tuple[str, ...], lines: list[tuple[str, ...]]) -> str:
    """A table for a terminal: the first column to the left, all others to the right."""
    widths = [max(map(len, column)) for column in zip(header, *lines, strict=True)]
    aligned = (
        [cell.rjust(width) if at else cell.ljust(width) for at, (cell, width) in enumerate(pairs)]
        for pairs in (zip(line, widths, strict=True) for line in (header, *lines))
    )
    return "\n".join("  ".join(cells).rstrip() for cells in aligned)


def markdown(header: tuple[str, ...], lines: list[tuple[str, ...]]) -> str:
    """The same for a page."""
    rule = ("---", *("---:" for _ in header[1:]))
    return "\n".join("| " + " | ".join(line) + " |" for line in (header, rule, *lines))


def listed(of: list[Mutant], reasons: Reasons) -> Iterator[str]:
    """The survivors of each module under the reasons why they change nothing, for the page."""
    for path in dict.fromkeys(mutant.path for mutant in of):
        yield f"\n### {path}\n"
        by_reason: dict[str, list[Mutant]] = {}
        for mutant in of:
            if mutant.path == path:
                by_reason.setdefault(
                    reasons.why(mutant)
                    or "Not noticed within the budget of tests, and not explained: a test is wanted.",
                    [],
                ).append(mutant)
        for why, several in by_reason.items():
            yield f"{why}\n"
            for mutant in several:
                yield f"- `{mutant.place}`, line {mutant.line}: {_code(mutant.was)} → {_code(mutant.now)}"
            yield ""


def _code(text: str) -> str:
    shown = re.sub(r"\s+", " ", text) or "(nothing)"
    fence = "``" if "`" in shown else "`"
    pad = " " if "`" in shown else ""
    return f"{fence}{pad}{shown}{pad}{fence}"


def write(
    table: list[Row], seeded: list[tuple[str, str]], of: list[Mutant], reasons: Reasons, how: str
) -> None:
    """Put the results behind the mark in docs/mutants.md."""
    head, mark, _ = PAGE.read_text().partition(MARK)
    assert mark, f"{PAGE} has no {MARK}"
    parts = [
        f"{head}{MARK}\n\n{how}\n\n## Mutants\n",
        markdown(HEADER, [row.cells for row in table]),
        "\n## Seeded bugs\n",
        markdown(("bug", "noticed with"), seeded),
        "\n## Survivors",
        *listed(of, reasons),
    ]
    PAGE.write_text("\n".join(parts).rstrip() + "\n")
