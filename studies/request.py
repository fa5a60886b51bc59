"""The translation of a user's request into an experiment: the list, the building, and the switches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from colony.nav.maps.building import load_building
from colony.nav.pose.tracker import PoseSource
from colony.runs.navigation import CEILING_CAMERA, FRONT_CAMERA, SIDE_CAMERA
from colony.sim.hazards.hazards import Hazards
from studies.catalog import CUSTOM, STUDIES, Study
from studies.conduct import HAZARD_NAMES, Experiment
from studies.lists import PUBLISHED_MAP, ListedRun, csv_list, floors_list, random_list, selected_runs
from studies.variants import VariantName

RANDOM = "random"
FLOORS = "floors"
PAIRS = {RANDOM: 200, FLOORS: 100}
"""Lists of random pairs of rooms, and their default numbers of pairs."""


class MisuseError(Exception):
    """The request is invalid."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentRequest:
    """The request for an experiment.

    Attributes:
        runs: the name of a study or of a list of random pairs, or the path of a CSV file.
        map_path: the building, if the list has none of its own.
        seeds: number of seeds per run; None for the list's default.
        chosen: the numbers of the runs, such as "1-5,22"; None for all.
        pairs, seed: number of random pairs (None for the list's default), and the seed that determines them.
        variant: the variant of navigation.
        hazards, no_hazard: True to simulate hazards, and the names of those to leave out.
        no_source: the names of the sources to leave out of the pose estimate.
        side_camera: True to give the robot a camera for door plates.
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
    """Return the study and the experiment of a request.

    Raises:
        MisuseError: the request is invalid.
        RunListError: the list, or the selection from it, is invalid.
        DiagnosticError: the map is invalid.
    """
    study = STUDIES.get(request.runs, CUSTOM)
    runs, name, map_path = _listed(study, request)
    runs = runs if request.chosen is None else selected_runs(runs, request.chosen)
    rides = any(run.has_ride for run in runs)  # a camera that looks ahead finds the markers of elevators
    experiment = Experiment(
        name=name,
        map_path=map_path.resolve(),
        runs=runs,
        seeds=tuple(range(1, (request.seeds or study.seeds) + 1)),
        variant=request.variant,
        hazards=_hazards(request),
        cameras=frozenset({CEILING_CAMERA, *([FRONT_CAMERA] if rides else [])}),
    )
    return study, _with_sources(experiment, study, request)


def _listed(study: Study[Any], request: ExperimentRequest) -> tuple[tuple[ListedRun, ...], str, Path]:
    """Return the runs, the name of their list, and the map."""
    runs, map_path = request.runs, request.map_path
    if request.pairs is not None and runs not in PAIRS:
        raise MisuseError(
            f"--pairs requires the list {' or '.join(f'`{name}`' for name in PAIRS)}; found `{runs}`"
        )
    if study is not CUSTOM:
        if map_path is not None:
            raise MisuseError("the published runs have their own map; leave out --map")
        return study.runs(), study.name, PUBLISHED_MAP
    if runs not in PAIRS and Path(runs).suffix.lower() != ".csv":
        names = ", ".join([*STUDIES, *PAIRS])
        raise MisuseError(f"unknown list `{runs}`; expected {names} or a file that ends in .csv")
    if map_path is None and runs != FLOORS:
        raise MisuseError("no building: give --map MAP, such as `--map loop`")
    path = Path(map_path) if map_path is not None else PUBLISHED_MAP
    building = load_building(path)
    floor = building.maps[0]
    if runs in PAIRS:
        count, seed = request.pairs or PAIRS[runs], request.seed
        listed = random_list(floor, count, seed) if runs == RANDOM else floors_list(building, count, seed)
        return listed, f"{runs} {count} pairs, seed {seed}, {floor.name}", path
    listed = csv_list(Path(runs), building)
    digest = sha256(repr([(run.origin, run.goal) for run in listed]).encode()).hexdigest()[:8]
    return listed, f"{Path(runs).stem} {digest}, {floor.name}", path


def _hazards(request: ExperimentRequest) -> Hazards:
    for name in request.no_hazard:
        if name not in HAZARD_NAMES:
            raise MisuseError(f"unknown hazard `{name}`; expected {', '.join(HAZARD_NAMES)}")
    if not request.hazards:
        return Hazards.none()
    return Hazards().without(*(HAZARD_NAMES[name] for name in request.no_hazard))


def _with_sources(experiment: Experiment, study: Study[Any], request: ExperimentRequest) -> Experiment:
    if not request.no_source and not request.side_camera:
        return experiment
    if request.variant != "ours" or study.has_own_variant:
        own = ", ".join(name for name, study in STUDIES.items() if study.has_own_variant)
        raise MisuseError(
            f"--no-source and --side-camera require the variant `ours`, and exclude the lists {own}"
        )
    names = {source.value: source for source in PoseSource}
    for name in request.no_source:
        if name not in names:
            raise MisuseError(f"unknown source `{name}`; expected {', '.join(names)}")
    sources = experiment.sources - {names[name] for name in request.no_source}
    cameras = experiment.cameras | {SIDE_CAMERA} if request.side_camera else experiment.cameras
    return replace(experiment, sources=sources, cameras=cameras)
