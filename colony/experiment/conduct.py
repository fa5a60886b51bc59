"""An experiment: a list of runs, each with many seeds, run once and kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from colony.experiment.auditing import AuditedRun, audit, audited
from colony.experiment.behavior import behavior_of
from colony.experiment.lists import ListedRun
from colony.experiment.parallel import Engine
from colony.experiment.record import RunKey
from colony.experiment.results import R, Results
from colony.experiment.runs import RunSpec, building_at
from colony.nav.pose.tracker import ALL, Source
from colony.robots.variants import CEILING_CAMERA, SIDE_CAMERA, VARIANTS, VariantName
from colony.sim.hazards.hazards import Hazard, Hazards

_KINDS = (".py", ".npz")
"""Suffixes of the files on which results depend: programs, and the weights of the reader."""

_SOURCES = ("experiment", "nav", "robots", "runtime", "sim", "vision")


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """An experiment.

    Attributes:
        name: name of the list.
        map_path: the building.
        runs: the list, or the chosen runs of it.
        seeds: the seeds; each run is run with each of them.
        variant: the program that drives.
        hazards: the hazards.
        sources: sources of the pose estimate; not with the variant of the thesis, which has no estimate.
        cameras: cameras of the robot.
    """

    name: str
    map_path: Path
    runs: tuple[ListedRun, ...]
    seeds: tuple[int, ...]
    variant: VariantName
    hazards: Hazards
    sources: frozenset[Source] = ALL
    cameras: frozenset[str] = frozenset({CEILING_CAMERA})

    @property
    def label(self) -> str:
        """The variant with what is switched off or on: "ours/no-people,no-lights"."""
        off = [f"no-{name}" for name, hazard in HAZARD_NAMES.items() if hazard not in self.hazards.on]
        if len(off) == len(HAZARD_NAMES):
            off = ["no-hazards"]
        other = [*off, *(f"no-{source.value}" for source in Source if source not in self.sources)]
        if SIDE_CAMERA in self.cameras:
            other.append("side-camera")
        return "/".join([self.variant, *([",".join(other)] if other else [])])

    def specs(self) -> tuple[RunSpec, ...]:
        """Return all runs, seed by seed."""
        return tuple(
            RunSpec(
                key=RunKey(self.name, run.number, seed, self.label),
                map_path=self.map_path,
                origin=run.origin,
                goal=run.goal,
                hazards=self.hazards,
                sources=self.sources,
                cameras=self.cameras,
            )
            for seed in self.seeds
            for run in self.runs
        )

    def made_with(self) -> str:
        """Name all that results depend on besides their keys: program, map, hazards, and our own code."""
        digest = sha256()
        digest.update(behavior_of(VARIANTS[self.variant].behavior).source.encode())
        digest.update(repr(replace(self.hazards, on=frozenset())).encode())
        digest.update(repr(building_at(self.map_path).maps).encode())
        package = Path(__file__).parents[1]
        for folder in _SOURCES:
            for path in sorted((package / folder).rglob("*")):
                if path.suffix in _KINDS:
                    digest.update(path.read_bytes())
        return digest.hexdigest()


HAZARD_NAMES = {hazard.name.lower().replace("_", "-"): hazard for hazard in Hazard}
"""The hazards by the names that users give them."""


def conduct(
    experiment: Experiment,
    work: Callable[[RunSpec], R],
    results: Results[R],
    engine: Engine,
    *,
    tell: Callable[[int, int, R], None] = lambda done, of, result: None,
) -> None:
    """Run what has no result yet; each result is kept as it comes.

    Args:
        experiment: the experiment.
        work: a run, as `runs.run` or another one that gives a result of its own kind.
        results: the file of results.
        engine: runs the work.
        tell: called with the number of runs done, the number of all runs, and the newest result.

    Raises:
        NoPlanError, DiagnosticError: a run cannot be planned, or the map or behavior is bad.
        ResultsError: the results cannot be kept, or others are in their place.
        WorkersLostError: the work cannot be done where it should.
    """
    results.expect(experiment.name, experiment.label, experiment.made_with())
    specs, there = experiment.specs(), results.keys()
    missing = [spec for spec in specs if spec.key not in there]
    for done, result in enumerate(engine.results(work, missing), len(specs) - len(missing) + 1):
        results.put(result)
        tell(done, len(specs), result)


TellAudit = Callable[[int, int, AuditedRun], None]
"""Callback with the number of runs audited, the number of all runs to audit, and the newest one."""


def conduct_audit(
    experiment: Experiment,
    engine: Engine,
    part: float,
    *,
    tell: TellAudit = lambda done, of, run: None,
) -> tuple[AuditedRun, ...]:
    """Compare `part` of the runs, at least one, with the reference interpreter; in their order."""
    specs = experiment.specs()
    chosen = [spec for spec in specs if audited(spec, part)] or list(specs[:1])
    found = []
    for done, one in enumerate(engine.results(audit, chosen), 1):
        found.append(one)
        tell(done, len(chosen), one)
    return tuple(sorted(found, key=lambda one: one.key))


def of_experiment(experiment: Experiment, results: Results[R]) -> tuple[R, ...]:
    """Return the experiment's results, by number and seed: of the runs and seeds that it has."""
    numbers, seeds = {run.number for run in experiment.runs}, set(experiment.seeds)
    kept = results.of(experiment.name, experiment.label)
    return tuple(r for r in kept if r.key.number in numbers and r.key.seed in seeds)
