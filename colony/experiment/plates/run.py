"""A run in which several plate finders look at the same images of the side camera, and none of them steers.

They are the finder as printed, ours, and ours with the map. The robot is driven by all sources but plates, so
that what one of them believes does not change the way, and all three see the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from colony.experiment.plates.judged import Sighting, judged, true_place
from colony.experiment.plates.named import names_in
from colony.experiment.plates.passed import PassWatch
from colony.experiment.plates.record import FINDERS, Finder, Outcome, PlateResult
from colony.experiment.runs import Run, RunSpec, building_at, finished
from colony.experiment.true_path import TruePath
from colony.nav.maps.signs import plates_of
from colony.nav.maps.stickrep.geometry import Point
from colony.nav.maps.stickrep.model import Pose
from colony.nav.pose.tracker import Source
from colony.robots.variants import SIDE_CAMERA
from colony.runtime.kit.script import Script
from colony.vision.plates.finder import plate_finder
from colony.vision.plates.sights import PlateSight


class PlateRun:
    """A run with its finders. Mutable: all of it.

    Raises:
        NoPlanError, DiagnosticError: see `runs.plan_of`.
    """

    def __init__(self, spec: RunSpec) -> None:
        steered = replace(spec, sources=spec.sources - {Source.PLATES}, cameras=spec.cameras | {SIDE_CAMERA})
        self.sights: Mapping[Finder, list[PlateSight]] = {finder: [] for finder in FINDERS}
        self.run = Run(steered, more=self._finders(steered))
        self.floor = self.run.building.maps[0]
        self.plates = plates_of(self.floor)
        self.path = TruePath()
        self.passed = PassWatch(self.plates, self.run.scenery.walls)
        self._people: dict[int, list[list[float]]] = {}

    def _finders(self, spec: RunSpec) -> Mapping[str, Script]:
        """Return the finders by name; the one with the map replaces the variant's own."""
        floors = {floor.name: plates_of(floor) for floor in building_at(spec.map_path).maps}
        return {
            "plates": plate_finder(floors, camera=SIDE_CAMERA, on_plate=self.sights["map"].append),
            "plates without map": plate_finder(camera=SIDE_CAMERA, on_plate=self.sights["ours"].append),
            "plates as printed": plate_finder(
                camera=SIDE_CAMERA, thesis=True, on_plate=self.sights["thesis"].append
            ),
        }

    def step(self) -> bool:
        """Drive one frame; False when the run is over."""
        run = self.run
        pose = run.world.true_pose(0)
        self.path.add(run.loop.now_ns, pose)
        self.passed.look(run.loop.now_ns, pose)
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
        named = names_in(self.floor, self.run.scenery, lambda t_ns: self._people.get(t_ns, ()))
        sightings = [self.sighting(sight) for sight in self.sights[finder]]
        return judged(sightings, self.plates, self.passed.passes, named)

    def sighting(self, sight: PlateSight) -> Sighting:
        """Return a reported sighting, at its true place."""
        place = true_place(Point(*sight.place), Pose(*sight.robot), self.path.at(sight.t_ns))
        return Sighting(sight.t_ns, place, sight.text, sight.door)


def run_with_finders(spec: RunSpec) -> PlateResult:
    """Drive a run to its end, and see what the finders made of it."""
    return finished(PlateRun(spec))
