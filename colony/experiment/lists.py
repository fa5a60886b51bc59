"""Lists of runs: the published ones, a user's own, and random pairs of rooms."""

from __future__ import annotations

import csv
import random
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from colony.nav.published_runs import PUBLISHED_RUNS, PublishedRun
from colony.nav.route import JAMBS, NoPlan, plan
from colony.nav.stickrep import EdgeKind, Map

PUBLISHED = "thesis"
"""What the list of the published runs is called."""

PUBLISHED_MAP = Path(__file__).parents[2] / "maps" / "msu_engineering_3.stickrep"

_TRIES = 200
"""How many random pairs are drawn for each that is wanted, before it is given up."""


class ListProblem(Exception):
    """A list of runs is no good; the message tells where, what was found and what was expected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedRun:
    """A run of a list: its number there, from 1, and what was published of it, if anything."""

    number: int
    origin: str
    goal: str
    published: PublishedRun | None = None


def published_list() -> tuple[ListedRun, ...]:
    """The forty runs of the thesis: 1 to 27 in the old wing, 28 to 40 in the new one."""
    return tuple(
        ListedRun(number=number, origin=run.origin, goal=run.goal, published=run)
        for number, run in enumerate(PUBLISHED_RUNS, 1)
    )


def own_list(path: Path, floor: Map) -> tuple[ListedRun, ...]:
    """The runs of a CSV file: two columns, from and to, which its first line may name.

    Raises:
        ListProblem: it cannot be read, or a line is no run in this map; the first such line is told.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [
                (number, row) for number, row in enumerate(csv.reader(file), 1) if any(map(str.strip, row))
            ]
    except (OSError, UnicodeDecodeError, csv.Error) as problem:
        raise ListProblem(f"{path}: cannot be read: {problem}") from None
    if rows and [word.strip().lower() for word in rows[0][1]] == ["from", "to"]:
        del rows[0]
    if not rows:
        raise ListProblem(f"{path}: no runs; expected lines such as 350R,376L")
    runs: list[ListedRun] = []
    for line, row in rows:
        if len(row) != 2:
            raise ListProblem(f"{path}:{line}: {len(row)} fields; expected 2, from and to, such as 350R,376L")
        origin, goal = (word.strip() for word in row)
        try:
            plan(floor, origin, goal)
        except NoPlan as problem:
            raise ListProblem(f"{path}:{line}: {problem}") from None
        runs.append(ListedRun(number=len(runs) + 1, origin=origin, goal=goal))
    return tuple(runs)


def random_list(floor: Map, pairs: int, seed: int) -> tuple[ListedRun, ...]:
    """Random pairs of doors between which a path leads.

    Raises:
        ListProblem: there are no such pairs, or next to none.
    """
    doors = rooms_of(floor)
    if len(doors) < 2:
        raise ListProblem(f"map `{floor.name}` has {len(doors)} doors; expected at least 2 to go between")
    chance = random.Random(seed)
    runs: list[ListedRun] = []
    for _ in range(_TRIES * pairs):
        if len(runs) == pairs:
            break
        origin, goal = chance.sample(doors, 2)
        try:
            plan(floor, origin, goal)
        except NoPlan:
            continue
        runs.append(ListedRun(number=len(runs) + 1, origin=origin, goal=goal))
    if len(runs) < pairs:
        raise ListProblem(f"map `{floor.name}`: paths lead between next to no doors; see `colony map`")
    return tuple(runs)


def rooms_of(floor: Map) -> tuple[str, ...]:
    """The names of the nodes where doors begin, in the order of the map; one a room."""
    names: dict[str, str] = {}
    for ring in floor.rings:
        for node, edge in zip(ring.nodes, ring.edges, strict=True):
            if edge.kind is EdgeKind.DOOR:
                names.setdefault(_room(node.name), node.name)
    return tuple(names.values())


def chosen(runs: Sequence[ListedRun], text: str) -> tuple[ListedRun, ...]:
    """Those that a text names: "1-5,22".

    Raises:
        ListProblem: it names none, or others.
    """
    wanted: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise ListProblem(f"`{part.strip()}` names no runs; expected numbers such as 1-5,22")
        wanted |= set(range(int(first), int(last or first) + 1))
    known = {run.number for run in runs}
    strange = sorted(wanted - known)
    if strange or not wanted:
        shown = ", ".join(map(str, strange[:5])) or text
        raise ListProblem(f"there is no run {shown}; expected numbers from 1 to {max(known)}")
    return tuple(run for run in runs if run.number in wanted)


def _room(node: str) -> str:
    for jamb in sorted(JAMBS, key=len, reverse=True):
        if node.endswith(jamb) and len(node) > len(jamb):
            return node.removesuffix(jamb)
    return node
