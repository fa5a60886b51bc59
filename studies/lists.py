"""Lists of runs: the published runs, those of a CSV file, and random pairs of rooms."""

from __future__ import annotations

import csv
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

from colony.files import read_file, reason
from colony.nav.maps.building import Building
from colony.nav.maps.stickrep.model import EdgeKind, Map
from colony.nav.plan.route import JAMB_SUFFIXES, NoPlanError, plan
from colony.shipped import Shipped
from studies.confidence.published_plates import PUBLISHED_WALKS
from studies.confidence.published_runs import PUBLISHED_RUNS, PublishedRun

PUBLISHED = "thesis"
"""Name of the list of the published runs."""

PUBLISHED_MAP = Shipped.MAP.path("msu_engineering_3")

LIST_BYTES = 1024 * 1024
"""Size limit in bytes of a CSV file."""

_MAX_TRIES_PER_PAIR = 200
"""Maximum number of random pairs to draw for each requested one."""


class RunListError(Exception):
    """A list of runs is invalid; the message has the location, what was found and what was expected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ListedRun:
    """A run of a list.

    It has its number in the list, from 1; the maps through which its path leads (empty if that is only the
    first map of the building); and its published result, if any.
    """

    number: int
    origin: str
    goal: str
    floors: tuple[str, ...] = ()
    published: PublishedRun | None = None

    @property
    def has_ride(self) -> bool:
        """True if its path takes an elevator."""
        return len(self.floors) > 1


def published_list() -> tuple[ListedRun, ...]:
    """Return the forty runs of the thesis: 1 to 27 in the old wing, 28 to 40 in the new one."""
    return tuple(
        ListedRun(number=number, origin=run.origin, goal=run.goal, published=run)
        for number, run in enumerate(PUBLISHED_RUNS, 1)
    )


def plate_list() -> tuple[ListedRun, ...]:
    """Return the eleven walks of the thesis past door plates (Table 6.3)."""
    return tuple(
        ListedRun(number=number, origin=walk.origin, goal=walk.goal)
        for number, walk in enumerate(PUBLISHED_WALKS, 1)
    )


def csv_list(path: Path, building: Building) -> tuple[ListedRun, ...]:
    """Return the runs of a CSV file with two columns, from and to, and an optional header.

    Raises:
        RunListError: the file cannot be read, or a line is not a run in this building; the message names
            the first such line.
    """
    try:
        lines = StringIO(read_file(path, LIST_BYTES).decode("utf-8"), newline="")
        rows = [(number, row) for number, row in enumerate(csv.reader(lines), 1) if any(map(str.strip, row))]
    except (OSError, UnicodeDecodeError, csv.Error) as problem:
        raise RunListError(f"{path}: cannot be read: {reason(problem)}") from None
    if rows and [word.strip().lower() for word in rows[0][1]] == ["from", "to"]:
        del rows[0]
    if not rows:
        raise RunListError(f"{path}: no runs; expected lines such as 350R,376L")
    runs: list[ListedRun] = []
    for line, row in rows:
        if len(row) != 2:
            raise RunListError(
                f"{path}:{line}: {len(row)} fields; expected 2, from and to, such as 350R,376L"
            )
        origin, goal = (word.strip() for word in row)
        try:
            runs.append(_run(building, len(runs) + 1, origin, goal))
        except NoPlanError as problem:
            raise RunListError(f"{path}:{line}: {problem}") from None
    return tuple(runs)


def random_list(floor: Map, pairs: int, seed: int) -> tuple[ListedRun, ...]:
    """Draw random pairs of doors that a path connects.

    Raises:
        RunListError: there are no such pairs, or too few.
    """
    doors = rooms_of(floor)
    if len(doors) < 2:
        raise RunListError(f"map `{floor.name}` has {len(doors)} doors; expected at least 2")
    rng = random.Random(seed)
    return _draw_runs(floor, pairs, lambda: tuple(rng.sample(doors, 2)))


def floors_list(building: Building, pairs: int, seed: int) -> tuple[ListedRun, ...]:
    """Draw random pairs of doors on different floors, in either direction, that a path connects.

    Raises:
        RunListError: there are no such pairs, or too few.
    """
    doors_by_floor = [[f"{floor.name}:{door}" for door in rooms_of(floor)] for floor in building.maps]
    floors = [doors for doors in doors_by_floor if doors]
    if len(floors) < 2:
        found = f"map `{building.maps[0].name}` and its elevators lead to {len(floors)} floors with doors"
        raise RunListError(f"{found}; expected at least 2")
    rng = random.Random(seed)
    return _draw_runs(building, pairs, lambda: tuple(map(rng.choice, rng.sample(floors, 2))))


def _draw_runs(
    source: Map | Building, pairs: int, draw: Callable[[], tuple[str, ...]]
) -> tuple[ListedRun, ...]:
    """Draw until there are enough pairs that a path connects."""
    runs: list[ListedRun] = []
    for _ in range(_MAX_TRIES_PER_PAIR * pairs):
        if len(runs) == pairs:
            break
        origin, goal = draw()
        try:
            runs.append(_run(source, len(runs) + 1, origin, goal))
        except NoPlanError:
            continue
    if len(runs) < pairs:
        name = source.name if isinstance(source, Map) else source.maps[0].name
        raise RunListError(f"map `{name}`: paths connect hardly any doors; see `colony map`")
    return tuple(runs)


def _run(source: Map | Building, number: int, origin: str, goal: str) -> ListedRun:
    """Return a run from `origin` to `goal`.

    Raises:
        NoPlanError: no path leads there.
    """
    floors = plan(source, origin, goal).floors
    return ListedRun(number=number, origin=origin, goal=goal, floors=floors)


def rooms_of(floor: Map) -> tuple[str, ...]:
    """Return the names of the nodes where doors begin, one per room, in the order of the map."""
    names: dict[str, str] = {}
    for ring in floor.rings:
        for node, edge in zip(ring.nodes, ring.edges, strict=True):
            if edge.kind is EdgeKind.DOOR:
                names.setdefault(_room(node.name), node.name)
    return tuple(names.values())


def selected_runs(runs: Sequence[ListedRun], text: str) -> tuple[ListedRun, ...]:
    """Return the runs that a text names: "1-5,22".

    Raises:
        RunListError: the text names no runs, or unknown ones.
    """
    last_number = max(run.number for run in runs)
    wanted: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise RunListError(f"`{part.strip()}` is not a range of runs; expected numbers such as 1-5,22")
        if int(last or first) > last_number:
            raise RunListError(f"no run {last or first}; expected numbers from 1 to {last_number}")
        wanted |= set(range(int(first), int(last or first) + 1))
    known = {run.number for run in runs}
    unknown = sorted(wanted - known)
    if unknown or not wanted:
        shown = ", ".join(map(str, unknown[:5])) or text
        raise RunListError(f"no run {shown}; expected numbers from 1 to {last_number}")
    return tuple(run for run in runs if run.number in wanted)


def _room(node: str) -> str:
    for jamb in sorted(JAMB_SUFFIXES, key=len, reverse=True):
        if node.endswith(jamb) and len(node) > len(jamb):
            return node.removesuffix(jamb)
    return node
