"""Studies: the measurements that experiments make, such as arrival at the goal or the detection of lights.

A study has a list of runs, a function that runs one and returns its result, a table in the file of results,
and Markdown tables. `python -m studies NAME` carries it out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any, Generic

from colony.experiment.results import R, ResultTable
from studies.confidence.tables import event_table, path_table
from studies.figures import Target, targets
from studies.lights.results import LIGHT_TABLE, LightResult, light_tables, light_targets
from studies.lights.run import run_with_light_probe
from studies.lists import PUBLISHED, ListedRun, plate_list, published_list
from studies.plates.figures import plate_targets
from studies.plates.record import PLATE_TABLE, PlateResult
from studies.plates.run import run_with_finders
from studies.plates.tables import plate_tables
from studies.record import RUN_TABLE, RunResult
from studies.runs import StudyRun, run
from studies.sources.results import SOURCE_TABLE, SourceOutcome, SourceResult, source_tables, source_targets
from studies.sources.run import run_with_sources, source_list
from studies.tables import failure_table, table, target_table


@dataclass(frozen=True, slots=True, kw_only=True)
class Study(Generic[R]):
    """A study.

    Attributes:
        name: name of the study, and of its list.
        runs: function that returns the list of runs.
        seeds: default number of seeds.
        work: the function that runs a run.
        table: the table of its results.
        targets: function that compares results with the promised values.
        tables: function that returns all tables, for a terminal and for pages.
        as_json: function that converts a result to a JSON object.
        has_own_variant: True if its runs have a fixed variant, and are neither plotted nor audited.
    """

    name: str
    runs: Callable[[], tuple[ListedRun, ...]]
    seeds: int
    work: Callable[[StudyRun], R]
    table: ResultTable[R]
    targets: Callable[[Sequence[R]], tuple[Target, ...]]
    tables: Callable[[Sequence[ListedRun], Sequence[R]], list[str]]
    as_json: Callable[[R], dict[str, object]]
    has_own_variant: bool = True


def _json(result: PlateResult | LightResult | SourceResult, **results: object) -> dict[str, object]:
    """Return a JSON object: the run, its origin and goal, and the results."""
    other = {"key", "origin", "goal"}
    rest = {name: value for name, value in asdict(result).items() if name not in other}
    return {**result.key._asdict(), "from": result.origin, "to": result.goal, **rest, **results}


def _plates_json(result: PlateResult) -> dict[str, object]:
    outcomes = {
        finder: [sighting._asdict() for sighting in sightings]
        for finder, sightings in result.outcomes.items()
    }
    return _json(result, outcomes=outcomes)


def _lights_json(result: LightResult) -> dict[str, object]:
    counts = result.counts
    in_json = {"passed": counts.passed, "detected": counts.detected, "in_view": counts.in_view}
    in_json |= {"in_view_told": counts.in_view_reported, "told": counts.reported, "false": counts.false}
    return _json(result, counts=in_json)


def _sources_json(result: SourceResult) -> dict[str, object]:
    outcomes = {name: _source_outcome_json(outcome) for name, outcome in result.outcomes.items()}
    return _json(result, outcomes=outcomes)


def _source_outcome_json(outcome: SourceOutcome) -> dict[str, object]:
    errors = outcome.errors
    return {
        "failure": outcome.failure,
        "off_mm": outcome.goal_error_mm,
        "contact_mm_s": outcome.contact_mm_s,
        "errors": {
            "looks": errors.comparisons,
            "square_mm2": errors.square_mm2,
            "square_deg2": errors.square_deg2,
            "worst_mm": errors.worst_mm,
            "inside": errors.inside,
        },
    }


def _run_tables(runs: Sequence[ListedRun], results: Sequence[RunResult]) -> list[str]:
    if not results:
        return []
    published = any(run.published is not None for run in runs)
    tables = [table(runs, results), target_table(results, published=published)]
    if failures := failure_table(results):
        tables.append(failures)
    return [*tables, event_table(results), path_table(results)] if published else tables


def _run_json(result: RunResult) -> dict[str, object]:
    return {
        **result.key._asdict(),
        "from": result.origin,
        "to": result.goal,
        "reached": result.reached,
        "failure": result.failure,
        "failed_mode": result.failed_mode,
        "remark": result.remark,
        "along_mm": result.overshoot_mm,
        "off_mm": result.goal_error_mm,
        "distance_mm": result.distance_mm,
        "travelled_mm": result.travelled_mm,
        "time_s": result.time_s,
        "top_mm_s": result.top_mm_s,
        "modes": {name: mode._asdict() for name, mode in zip("LCD", result.mode_counts, strict=True)},
        "lights": result.lights._asdict(),
        "contacts": result.contacts._asdict(),
        "hazards": result.hazards,
    }


THESIS = Study(
    name=PUBLISHED,
    runs=published_list,
    seeds=25,
    work=run,
    table=RUN_TABLE,
    targets=partial(targets, published=True),
    tables=_run_tables,
    as_json=_run_json,
    has_own_variant=False,
)
"""The forty published runs: arrival at the goal, accuracy and speed."""

CUSTOM = replace(THESIS, name="own", seeds=1, targets=partial(targets, published=False))
"""The same measurements for any other list of runs."""

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
    work=run_with_light_probe,
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
"""The contribution of each source of the pose estimate, along some of the published runs."""

STUDIES: Mapping[str, Study[Any]] = {study.name: study for study in (THESIS, PLATES, LIGHTS, SOURCES)}
