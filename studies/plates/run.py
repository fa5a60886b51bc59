"""A run in which several plate finders look at the same images, without correcting the pose.

The finders are that of the thesis as printed, ours, and ours with the map. The pose is estimated from all
sources but plates, so that no finder influences the path, and all three see the same images.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from colony.nav.maps.signs import plates_of
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.tracker import PoseSource
from colony.runs.navigation import SIDE_CAMERA
from colony.runtime.kit.script import Script
from colony.vision.plates.finder import plate_finder
from colony.vision.plates.observations import FoundPlate
from studies.plates.judging import Sighting, judge_sightings, true_position
from studies.plates.naming import sighting_namer
from studies.plates.passed import PassMonitor
from studies.plates.record import FINDERS, Finder, Outcome, PlateResult
from studies.runs import Run, StudyRun, building_at, run_to_end
from studies.thesis.plate_finder import thesis_plate_finder
from studies.true_path import TruePath


class PlateRun:
    """A run with its finders. Mutable.

    Raises:
        NoPlanError, DiagnosticError: see `runs.plan_of`.
    """

    def __init__(self, spec: StudyRun) -> None:
        run_spec = replace(
            spec, sources=spec.sources - {PoseSource.PLATES}, cameras=spec.cameras | {SIDE_CAMERA}
        )
        self.found_plates: Mapping[Finder, list[FoundPlate]] = {finder: [] for finder in FINDERS}
        self.run = Run(run_spec, extra_scripts=self._finders(run_spec))
        self.floor = self.run.building.maps[0]
        self.plates = plates_of(self.floor)
        self.path = TruePath()
        self.passed = PassMonitor(self.plates, self.run.scenery.walls)
        self._people: dict[int, list[list[float]]] = {}

    def _finders(self, spec: StudyRun) -> Mapping[str, Script]:
        """Return the finders by name; the one with the map replaces the variant's own."""
        floors = {floor.name: plates_of(floor) for floor in building_at(spec.map_path).maps}
        return {
            "plates": plate_finder(floors, camera=SIDE_CAMERA, on_plate=self.found_plates["map"].append),
            "plates without map": plate_finder(camera=SIDE_CAMERA, on_plate=self.found_plates["ours"].append),
            "plates as printed": thesis_plate_finder(
                camera=SIDE_CAMERA, on_plate=self.found_plates["thesis"].append
            ),
        }

    def step(self) -> bool:
        """Drive one frame; return False when the run is over."""
        run = self.run
        pose = run.world.true_pose(0)
        self.path.add(run.loop.now_ns, pose)
        self.passed.update(run.loop.now_ns, pose)
        self._people[run.loop.now_ns] = run.world.people.tolist()
        return run.step()

    def close(self) -> None:
        """Stop the robot and end all scripts."""
        self.run.close()

    def result(self) -> PlateResult:
        """Return the result so far."""
        run = self.run
        return PlateResult(
            key=run.spec.key,
            origin=run.plan.origin,
            goal=run.plan.goal,
            failure=run.failure or "",
            time_s=run.loop.now_ns / 1e9,
            outcomes={finder: self._outcomes(finder) for finder in FINDERS},
        )

    def _outcomes(self, finder: Finder) -> tuple[Outcome, ...]:
        name_sighting = sighting_namer(self.floor, self.run.scenery, lambda t_ns: self._people.get(t_ns, ()))
        sightings = [self.sighting(plate) for plate in self.found_plates[finder]]
        return judge_sightings(sightings, self.plates, self.passed.passes, name_sighting)

    def sighting(self, plate: FoundPlate) -> Sighting:
        """Return a reported sighting at its true position."""
        position = true_position(Point(*plate.place), Pose(*plate.robot), self.path.at(plate.t_ns))
        return Sighting(plate.t_ns, position, plate.text, plate.door)


def run_with_finders(spec: StudyRun) -> PlateResult:
    """Drive a run to its end, and return the finders' results."""
    return run_to_end(PlateRun(spec))
