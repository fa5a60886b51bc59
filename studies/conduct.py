"""An experiment: a list of runs, each with several seeds. Each is driven once, and its result is stored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

import colony
from colony.experiment.parallel import Engine
from colony.experiment.results import R, Results, RunKey
from colony.nav.pose.tracker import EVERY_SOURCE, PoseSource
from colony.runs.behavior import behavior_of
from colony.runs.navigation import CEILING_CAMERA, SIDE_CAMERA
from colony.sim.hazards.hazards import Hazard, Hazards
from studies.auditing import AuditedRun, audit, is_audited
from studies.lists import ListedRun
from studies.runs import StudyRun, building_at
from studies.variants import VARIANTS, VariantName

_SUFFIXES = (".py", ".npz")
"""Suffixes of the files on which results depend: programs, and the weights of the reader."""

_PARTS = ("experiment", "nav", "robots", "runtime", "sim", "vision")
_SOURCES = (Path(__file__).parent, *(Path(colony.__file__).parent / part for part in _PARTS))
"""Folders of the programs on which results depend."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """An experiment.

    Attributes:
        name: name of the list.
        map_path: the building.
        runs: the runs of the list, or a selection.
        seeds: the seeds of each run.
        variant: the variant of navigation.
        hazards: the hazards.
        sources: sources of the pose estimate; the variant of the thesis ignores them, as it has no estimate.
        cameras: cameras of the robot.
    """

    name: str
    map_path: Path
    runs: tuple[ListedRun, ...]
    seeds: tuple[int, ...]
    variant: VariantName
    hazards: Hazards
    sources: frozenset[PoseSource] = EVERY_SOURCE
    cameras: frozenset[str] = frozenset({CEILING_CAMERA})

    @property
    def label(self) -> str:
        """The variant with its deviations from the default: "ours/no-people,no-lights"."""
        disabled = [f"no-{name}" for name, hazard in HAZARD_NAMES.items() if hazard not in self.hazards.on]
        if len(disabled) == len(HAZARD_NAMES):
            disabled = ["no-hazards"]
        deviations = [
            *disabled,
            *(f"no-{source.value}" for source in PoseSource if source not in self.sources),
        ]
        if SIDE_CAMERA in self.cameras:
            deviations.append("side-camera")
        return "/".join([self.variant, *([",".join(deviations)] if deviations else [])])

    def specs(self) -> tuple[StudyRun, ...]:
        """Return all runs, seed by seed."""
        return tuple(
            StudyRun(
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

    def fingerprint(self) -> str:
        """Return a digest of everything that results depend on: program, map, hazards, and colony's code."""
        digest = sha256()
        digest.update(behavior_of(VARIANTS[self.variant].behavior).source.encode())
        digest.update(repr(replace(self.hazards, on=frozenset())).encode())
        digest.update(repr(building_at(self.map_path).maps).encode())
        for folder in _SOURCES:
            for path in sorted(folder.rglob("*")):
                if path.suffix in _SUFFIXES:
                    digest.update(path.read_bytes())
        return digest.hexdigest()


HAZARD_NAMES = {hazard.name.lower().replace("_", "-"): hazard for hazard in Hazard}
"""The hazards by their names on the command line."""


def conduct(
    experiment: Experiment,
    work: Callable[[StudyRun], R],
    results: Results[R],
    engine: Engine,
    *,
    on_progress: Callable[[int, int, R], None] = lambda done, total, result: None,
) -> None:
    """Run all runs without a stored result, and store each result as it arrives.

    Args:
        experiment: the experiment.
        work: the function that drives a run, such as `runs.run`.
        results: the file of results.
        engine: the engine that executes the work.
        on_progress: callback with the number of finished runs, the total, and the latest result.

    Raises:
        NoPlanError, DiagnosticError: a run cannot be planned, or the map or behavior is invalid.
        ResultsError: the results cannot be stored, or the file contains results of another program or map.
        WorkersLostError: a worker died.
    """
    results.expect(experiment.name, experiment.label, experiment.fingerprint())
    specs, stored = experiment.specs(), results.keys()
    missing = [spec for spec in specs if spec.key not in stored]
    for done, result in enumerate(engine.results(work, missing), len(specs) - len(missing) + 1):
        results.put(result)
        on_progress(done, len(specs), result)


OnAuditProgress = Callable[[int, int, AuditedRun], None]
"""Callback with the number of audited runs, the total, and the latest audited run."""


def conduct_audit(
    experiment: Experiment,
    engine: Engine,
    fraction: float,
    *,
    on_progress: OnAuditProgress = lambda done, total, run: None,
) -> tuple[AuditedRun, ...]:
    """Audit `fraction` of the runs, at least one; return them in order."""
    specs = experiment.specs()
    chosen = [spec for spec in specs if is_audited(spec, fraction)] or list(specs[:1])
    audited = []
    for done, run in enumerate(engine.results(audit, chosen), 1):
        audited.append(run)
        on_progress(done, len(chosen), run)
    return tuple(sorted(audited, key=lambda run: run.key))


def results_of(experiment: Experiment, results: Results[R]) -> tuple[R, ...]:
    """Return the stored results of the experiment's runs and seeds, by number and seed."""
    numbers, seeds = {run.number for run in experiment.runs}, set(experiment.seeds)
    stored = results.select(experiment.name, experiment.label)
    return tuple(r for r in stored if r.key.number in numbers and r.key.seed in seeds)
