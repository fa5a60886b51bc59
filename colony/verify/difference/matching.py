"""The correspondence between the modules of two programs, as reports show it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from colony.ir.program import Program
from colony.text.wording import duration_text
from colony.verify.difference.compatible import Pair
from colony.verify.difference.content import contents
from colony.verify.difference.declarations import changed_declarations
from colony.verify.difference.results import Matching


def matching(a: Program, b: Program, compared: Sequence[Pair]) -> Matching:
    """Return the pairs of modules with equal contents, equal names first, and the modules without a match."""
    names_a, names_b = _contents(a, b)
    unmatched_b = dict(names_b)
    same: dict[str, str] = {}
    for by_name in (True, False):
        for name, content in names_a.items():
            if name in same:
                continue
            candidates = [n for n, c in unmatched_b.items() if c == content and (n == name or not by_name)]
            if candidates:
                same[name] = candidates[0]
                del unmatched_b[candidates[0]]
    changed = tuple(n for n in names_a if n not in same and n in unmatched_b)
    return Matching(
        same=tuple((n, same[n]) for n in names_a if n in same),
        changed=changed,
        only_a=tuple(n for n in names_a if n not in same and n not in changed),
        only_b=tuple(n for n in unmatched_b if n not in changed),
        declarations=changed_declarations(a, b),
        notes=tuple(_notes(a, b, compared)),
    )


def _contents(a: Program, b: Program) -> tuple[dict[str, tuple[str, int]], dict[str, tuple[str, int]]]:
    """Return the content of each module and the actuator that it commands."""
    of_a, of_b = contents(a, b)
    return (
        {m.name: (m.actuator or "", of_a.module(m)) for m in a.modules},
        {m.name: (m.actuator or "", of_b.module(m)) for m in b.modules},
    )


def _notes(a: Program, b: Program, compared: Sequence[Pair]) -> Iterator[str]:
    """Yield notes on what was not compared."""
    compared_a, compared_b = {p.a.name for p in compared}, {p.b.name for p in compared}
    for title, program, other, compared_names in (("A", a, b, compared_a), ("B", b, a, compared_b)):
        other_names = {x.name for x in other.robot.actuators}
        for actuator in program.robot.actuators:
            if actuator.name not in compared_names and actuator.name not in other_names:
                yield f"only {title} has the actuator `{actuator.name}`: it is not compared"
    if a.robot.frame_ns != b.robot.frame_ns:
        periods = f"{duration_text(a.robot.frame_ns)} in A and {duration_text(b.robot.frame_ns)} in B"
        yield f"the frame period is {periods}: they are compared on the same frames"
