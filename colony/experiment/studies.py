"""Studies: experiments that count something besides whether runs reached their goals.

Each has a list of runs in the published building, a run that gives a record of its own kind, a table of a
file of results in which these are kept, and tables of Markdown. `colony experiment NAME` carries one out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Generic

from colony.experiment.figures import Target
from colony.experiment.lights.results import LIGHT_TABLE, LightResult, light_tables, light_targets
from colony.experiment.lights.run import run_with_witness
from colony.experiment.lists import ListedRun, plate_list, published_list
from colony.experiment.plates.figures import plate_targets
from colony.experiment.plates.record import PLATE_TABLE, PlateResult
from colony.experiment.plates.run import run_with_finders
from colony.experiment.plates.tables import plate_tables
from colony.experiment.results import R, Table
from colony.experiment.runs import RunSpec
from colony.experiment.sources.results import SOURCE_TABLE, SourceResult, source_tables, source_targets
from colony.experiment.sources.run import run_with_sources, source_list


@dataclass(frozen=True, slots=True, kw_only=True)
class Study(Generic[R]):
    """What is counted, and how.

    Attributes:
        name: of the study, and of its list.
        runs: the list.
        seeds: how many, unless told.
        work: a run.
        table: how its records are kept.
        targets: what was promised.
        tables: all that there is to show, for a terminal and for pages.
        as_json: a record for programs.
    """

    name: str
    runs: Callable[[], tuple[ListedRun, ...]]
    seeds: int
    work: Callable[[RunSpec], R]
    table: Table[R]
    targets: Callable[[Sequence[R]], tuple[Target, ...]]
    tables: Callable[[Sequence[ListedRun], Sequence[R]], list[str]]
    as_json: Callable[[R], dict[str, object]]


def _json(result: PlateResult | LightResult | SourceResult, **found: object) -> dict[str, object]:
    """A record for programs: which run, from where to where, and what was found."""
    other = {"key", "origin", "goal"}
    rest = {name: value for name, value in asdict(result).items() if name not in other}
    return {**result.key._asdict(), "from": result.origin, "to": result.goal, **rest, **found}


def _plates_json(result: PlateResult) -> dict[str, object]:
    outcomes = {finder: [one._asdict() for one in told] for finder, told in result.outcomes.items()}
    return _json(result, outcomes=outcomes)


def _lights_json(result: LightResult) -> dict[str, object]:
    return _json(result, counts=result.counts._asdict())


def _sources_json(result: SourceResult) -> dict[str, object]:
    outcomes = {
        name: {**outcome._asdict(), "errors": outcome.errors._asdict()}
        for name, outcome in result.outcomes.items()
    }
    return _json(result, outcomes=outcomes)


PLATES = Study(
    name="plates",
    runs=plate_list,
    seeds=5,
    work=run_with_finders,
    table=PLATE_TABLE,
    targets=plate_targets,
    tables=plate_tables,
    as_json=_plates_json,
)
"""Door plates, along the walks of Table 6.3."""

LIGHTS = Study(
    name="lights",
    runs=published_list,
    seeds=2,
    work=run_with_witness,
    table=LIGHT_TABLE,
    targets=light_targets,
    tables=light_tables,
    as_json=_lights_json,
)
"""Ceiling lights, along the published runs of Tables 6.1 and 6.2."""

SOURCES = Study(
    name="sources",
    runs=source_list,
    seeds=1,
    work=run_with_sources,
    table=SOURCE_TABLE,
    targets=source_targets,
    tables=source_tables,
    as_json=_sources_json,
)
"""What each source of the pose is worth, along some of the published runs."""

STUDIES: Mapping[str, Study[Any]] = {study.name: study for study in (PLATES, LIGHTS, SOURCES)}
