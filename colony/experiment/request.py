"""The translation of a user's request to an experiment: the list, the building, and the switches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from colony.experiment.conduct import HAZARD_NAMES, Experiment
from colony.experiment.lists import (
    PUBLISHED_MAP,
    ListedRun,
    chosen,
    floors_list,
    own_list,
    random_list,
)
from colony.experiment.studies import OWN, STUDIES, Study
from colony.nav.maps.building import load_building
from colony.nav.pose.tracker import Source
from colony.robots.variants import CEILING_CAMERA, FRONT_CAMERA, SIDE_CAMERA, VariantName
from colony.sim.hazards.hazards import Hazards

RANDOM = "random"
FLOORS = "floors"
PAIRS = {RANDOM: 200, FLOORS: 100}
"""Lists of random pairs of rooms, and their default numbers of pairs."""


class MisuseError(Exception):
    """The request makes no sense."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentRequest:
    """The request of an experiment.

    Attributes:
        runs: a study, a list of random pairs, or the path of a CSV file.
        map_path: the building, if the list has none of its own.
        seeds: number of seeds a run; None for the list's default.
        chosen: the numbers of the runs, as "1-5,22"; None for all.
        pairs, seed: number of random pairs, None for the list's default, and the seed that draws them.
        variant: the program that drives.
        hazards, no_hazard: True with hazards, and the names of those that are switched off.
        no_source: the names of sources that the pose is not estimated from.
        side_camera: True if the robot looks for door plates.
    """

    runs: str
    map_path: str | None
    seeds: int | None
    chosen: str | None
    pairs: int | None
    seed: int
    variant: VariantName
    hazards: bool
    no_hazard: tuple[str, ...]
    no_source: tuple[str, ...]
    side_camera: bool


def experiment_of(request: ExperimentRequest) -> tuple[Study[Any], Experiment]:
    """Return what counts the results, and the experiment.

    Raises:
        MisuseError: what is asked for makes no sense.
        RunListError: the list, or what is chosen of it, is no good.
        DiagnosticError: the map is bad.
    """
    study = STUDIES.get(request.runs, OWN)
    runs, name, map_path = _listed(study, request)
    runs = runs if request.chosen is None else chosen(runs, request.chosen)
    rides = any(run.rides for run in runs)  # elevators have markers for a camera that looks ahead
    asked = Experiment(
        name=name,
        map_path=map_path.resolve(),
        runs=runs,
        seeds=tuple(range(1, (request.seeds or study.seeds) + 1)),
        variant=request.variant,
        hazards=_hazards(request),
        cameras=frozenset({CEILING_CAMERA, *([FRONT_CAMERA] if rides else [])}),
    )
    return study, _with_sources(asked, study, request)


def _listed(study: Study[Any], request: ExperimentRequest) -> tuple[tuple[ListedRun, ...], str, Path]:
    """Return the runs, the name of their list, and the map."""
    runs, map_path = request.runs, request.map_path
    if request.pairs is not None and runs not in PAIRS:
        raise MisuseError(
            f"--pairs goes with {' and '.join(f'`{name}`' for name in PAIRS)}, not with `{runs}`"
        )
    if study is not OWN:
        if map_path is not None:
            raise MisuseError("the published runs have a map of their own; leave out --map")
        return study.runs(), study.name, PUBLISHED_MAP
    if runs not in PAIRS and Path(runs).suffix.lower() != ".csv":
        known = ", ".join([*STUDIES, *PAIRS])
        raise MisuseError(f"there is no list `{runs}`; expected {known} or a file that ends in .csv")
    if map_path is None and runs != FLOORS:
        raise MisuseError("which building? give --map MAP, such as `loop`")
    path = Path(map_path) if map_path is not None else PUBLISHED_MAP
    building = load_building(path)
    floor = building.maps[0]
    if runs in PAIRS:
        count, seed = request.pairs or PAIRS[runs], request.seed
        listed = random_list(floor, count, seed) if runs == RANDOM else floors_list(building, count, seed)
        return listed, f"{runs} {count} pairs, seed {seed}, {floor.name}", path
    listed = own_list(Path(runs), building)
    digest = sha256(repr([(run.origin, run.goal) for run in listed]).encode()).hexdigest()[:8]
    return listed, f"{Path(runs).stem} {digest}, {floor.name}", path


def _hazards(request: ExperimentRequest) -> Hazards:
    for name in request.no_hazard:
        if name not in HAZARD_NAMES:
            raise MisuseError(f"there is no hazard `{name}`; expected {', '.join(HAZARD_NAMES)}")
    if not request.hazards:
        return Hazards.none()
    return Hazards().without(*(HAZARD_NAMES[name] for name in request.no_hazard))


def _with_sources(asked: Experiment, study: Study[Any], request: ExperimentRequest) -> Experiment:
    if not request.no_source and not request.side_camera:
        return asked
    if request.variant != "ours" or study.has_own_variant:
        own = ", ".join(name for name, study in STUDIES.items() if study.has_own_variant)
        raise MisuseError(f"--no-source and --side-camera are for the variant `ours`, and not for {own}")
    names = {source.value: source for source in Source}
    for name in request.no_source:
        if name not in names:
            raise MisuseError(f"there is no source `{name}`; expected {', '.join(names)}")
    sources = asked.sources - {names[name] for name in request.no_source}
    cameras = asked.cameras | {SIDE_CAMERA} if request.side_camera else asked.cameras
    return replace(asked, sources=sources, cameras=cameras)
