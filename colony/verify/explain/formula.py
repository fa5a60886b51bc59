"""Answers as formulas: conditions joined by "all of" and "any of", with their values in one frame.

Which conditions had to change for another outcome is computed, not guessed: the formula is evaluated with
them flipped. A condition that occurs twice is flipped in both places.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from colony.ir.expression import Expression
from colony.text.source import Span
from colony.verify.explain.causes import Cause, Subject

Key = tuple[str | int, ...]
"""The identity of a condition, within one program."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaf:
    """A condition without parts, and its value.

    `node` is the expression that it is about, if it is about one. A `fixed` condition cannot change. An
    `implied` one goes without saying: that a module which is not silent has what it reads. A `free` one is
    not known: what a module would decide if it were not silent.
    """

    holds: bool
    cause: Cause
    key: Key
    span: Span | None = None
    node: Expression | None = None
    fixed: bool = False
    implied: bool = False
    free: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """All or any of some conditions; `negated` if the opposite is meant.

    `subject` says what the group means, and `name` of what; None for a mere part of a condition.
    """

    relation: Literal["all", "any"]
    parts: tuple[Formula, ...]
    holds: bool
    negated: bool = False
    subject: Subject | None = None
    name: str = ""
    span: Span | None = None


Formula = Leaf | Group


def group(
    relation: Literal["all", "any"],
    parts: Collection[Formula],
    *,
    negated: bool = False,
    subject: Subject | None = None,
    name: str = "",
    span: Span | None = None,
) -> Group:
    """Return a group, whose value follows from those of its parts."""
    values = [part.holds for part in parts]
    holds = (all(values) if relation == "all" else any(values)) != negated
    return Group(
        relation=relation,
        parts=tuple(parts),
        holds=holds,
        negated=negated,
        subject=subject,
        name=name,
        span=span,
    )


def negation(part: Formula) -> Group:
    """Return the opposite of a condition."""
    return group("all", (part,), negated=True)


def deciding_parts(formula: Group) -> tuple[Formula, ...]:
    """Return the parts that give a group its value: those that had to change, or of which any would do."""
    holds = formula.holds != formula.negated
    if holds == (formula.relation == "all"):
        return formula.parts
    return tuple(part for part in formula.parts if part.holds == holds)


def leaves(formula: Formula) -> dict[Key, Leaf]:
    """Return the conditions of a formula that decide its value, in order."""
    found: dict[Key, Leaf] = {}
    seen: set[int] = set()
    work = [formula]
    while work:
        node = work.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, Leaf):
            found |= {} if node.implied or node.key in found else {node.key: node}
        else:
            work.extend(reversed(deciding_parts(node)))
    return found


def value_with(formula: Formula, flipped: Collection[Key]) -> bool:
    """Return the value of a formula in which some conditions have the opposite value."""
    values: dict[int, bool] = {}
    for node in _bottom_up(formula):
        if isinstance(node, Leaf):
            values[id(node)] = node.holds != (node.key in flipped)
        else:
            parts = [values[id(part)] for part in node.parts]
            values[id(node)] = (all(parts) if node.relation == "all" else any(parts)) != node.negated
    return values[id(formula)]


def _bottom_up(formula: Formula) -> Iterator[Formula]:
    """Yield every part once, each after its own parts; formulas may be deep."""
    done: set[int] = set()
    work: list[tuple[Formula, bool]] = [(formula, False)]
    while work:
        node, is_ready = work.pop()
        if id(node) in done:
            continue
        if is_ready or isinstance(node, Leaf):
            done.add(id(node))
            yield node
            continue
        work.append((node, True))
        work.extend((part, False) for part in node.parts)


MAX_SINGLES = 300
"""Maximum number of conditions that are tried one by one; of more, one set is found."""

MAX_CANDIDATES = 60
"""Maximum number of conditions that are tried in pairs."""

MAX_CHANGES = 8
"""Maximum number of sets of conditions that an answer names."""


@dataclass(frozen=True, slots=True)
class ConditionChange:
    """Conditions that had to change together for the opposite outcome; none of them can be left out.

    It is certain unless other conditions depend on one of them, too, or on a reading that is missing: then
    these had to change, and what would have come of it is not known.
    """

    leaves: tuple[Leaf, ...]
    is_certain: bool = True


Changes = tuple[ConditionChange, ...]


def changes(formula: Formula, entangled: Collection[Key] = ()) -> Changes:
    """Return the smallest sets of conditions that had to change for the opposite outcome.

    Sets of one if there are any; else pairs; else one set, from which nothing can be left out. None if no
    change of conditions that can change flips the outcome. `entangled` are those on which others depend.
    """
    candidates = [leaf for leaf in leaves(formula).values() if not leaf.fixed]
    found = _smallest(formula, candidates)
    return tuple(
        ConditionChange(s, not any(leaf.key in entangled for leaf in s)) for s in found[:MAX_CHANGES]
    )


def _smallest(formula: Formula, candidates: list[Leaf]) -> list[tuple[Leaf, ...]]:
    sizes = (1, 2)[: (len(candidates) <= MAX_SINGLES) + (len(candidates) <= MAX_CANDIDATES)]
    free = {node.key for node in _bottom_up(formula) if isinstance(node, Leaf) and node.free}
    for size in sizes:
        found = [
            chosen
            for chosen in combinations(candidates, size)
            if _may_flip(formula, {leaf.key for leaf in chosen}, free)
        ]
        if found:
            return found
    needed = _structural(formula, {leaf.key for leaf in candidates})
    return [] if needed is None else [needed]


def _may_flip(formula: Formula, flipped: set[Key], free: set[Key]) -> bool:
    """Return True if the outcome changes, or may change because a silent module gets what it reads."""
    if value_with(formula, flipped) != formula.holds:
        return True
    appears = free and any(key[0] == "present" for key in flipped)
    return bool(appears) and value_with(formula, flipped | free) != formula.holds


def _structural(formula: Formula, allowed: set[Key]) -> tuple[Leaf, ...] | None:
    """Return a set from which nothing can be left out, found from the structure; None if it finds none."""
    chosen = _chosen(formula, allowed)
    if chosen is None or value_with(formula, chosen.keys()) == formula.holds:
        return None
    for key in list(chosen) if len(chosen) <= MAX_SINGLES else ():
        rest = chosen.keys() - {key}
        if value_with(formula, rest) != formula.holds:
            del chosen[key]
    return tuple(chosen.values())


def _chosen(formula: Formula, allowed: set[Key]) -> dict[Key, Leaf] | None:
    """Return the fewest conditions whose change should change a formula, by its structure."""
    best: dict[int, dict[Key, Leaf] | None] = {}
    for node in _bottom_up(formula):
        if isinstance(node, Leaf):
            best[id(node)] = {node.key: node} if node.key in allowed else None
            continue
        deciding = [best[id(part)] for part in deciding_parts(node)]
        needs_all = (node.holds != node.negated) != (node.relation == "all")
        options = [option for option in deciding if option is not None]
        if needs_all:
            is_possible = len(options) == len(deciding)
            best[id(node)] = {k: v for o in options for k, v in o.items()} if is_possible else None
        else:
            best[id(node)] = min(options, key=len, default=None)
    return best[id(formula)]


def all_leaves(formula: Formula) -> dict[Key, Leaf]:
    """Return all conditions of a formula, whether or not they decide its value."""
    return {node.key: node for node in _bottom_up(formula) if isinstance(node, Leaf)}
