"""The design of an experiment: one behavior, or two, run many times with inputs that are drawn from seeds.

Run number N has the seed `first seed + N - 1`. Whatever varies is drawn from this seed, each input from a
random stream of its own: a further input leaves the others as they are, and both behaviors of a comparison
get the same inputs.
"""

from __future__ import annotations

import math
import os
import re
import sys
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import numpy as np

from colony.dsl.descriptions import RobotChoice
from colony.dsl.load import load_file
from colony.dsl.site import SiteParams
from colony.dsl.site_reading import params_from_values
from colony.execute.compiled import Compiled
from colony.experiment.results import RunKey
from colony.ir.program import Program
from colony.nav.maps.free_space import FreeSpace
from colony.nav.maps.world_map import WorldMap
from colony.runs.compiled import compiled_with_sources
from colony.runs.described import DescribedRobot, described_robot
from colony.runs.spec import MisuseError, RunSpec

# --- programs ------------------------------------------------------------------------------------------
#
# The behaviors of an experiment, loaded and compiled; nothing here needs the simulator.


class ProgramChoice(NamedTuple):
    """A behavior: its name in results, its file, the description of its robot, and the params of a site.

    `sources` is the digest of its source files in this experiment; "" for any.
    """

    label: str
    file: str
    robot: RobotChoice | None
    site: SiteParams | None
    sources: str = ""


class ExperimentProgram(NamedTuple):
    """A program, compiled, and its robot."""

    program: Program
    compiled: Compiled
    described: DescribedRobot


@lru_cache(maxsize=4)
def compiled_of(choice: ProgramChoice, params: tuple[tuple[str, str], ...] = ()) -> ExperimentProgram:
    """Load and compile a behavior with values of params, which replace those of its site.

    Raises:
        DiagnosticError: the program has errors, or does not fit its robot.
        MisuseError: its source files changed since the experiment began.
    """
    folder = str(Path(choice.file).resolve().parent)
    sys.path += [path for path in (folder, os.curdir) if path not in sys.path]  # of modules in Python
    program = load_file(choice.file, robot=choice.robot, params=_with_values(choice.site, params))
    compiled = compiled_with_sources(program, lambda warning: None).compiled
    if choice.sources not in ("", sources_digest(compiled)):
        raise MisuseError(f"{choice.file} has changed since the experiment began; run the command again")
    return ExperimentProgram(program, compiled, described_robot(program.robot))


def sources_digest(compiled: Compiled) -> str:
    """Return a digest of the source files of a program."""
    return sha256(repr(compiled.sources).encode()).hexdigest()


def _with_values(site: SiteParams | None, params: tuple[tuple[str, str], ...]) -> SiteParams | None:
    if not params:
        return site
    drawn = params_from_values(dict(params), "<drawn params>")
    if site is None:
        return drawn
    kept = (value for value in site.values if value.name not in dict(params))
    return replace(site, values=(*kept, *drawn.values))


# --- design --------------------------------------------------------------------------------------------


START_CLEARANCE_MM = 50.0
"""Distance between the hull of a robot at a drawn start and the nearest wall, at least."""

_START, _MOVERS, _PARAMS = 0, 1, 2
"""Random streams."""

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"({_NUMBER})\s*([^\d.\s][^.]*?)?\s*\.\.\s*({_NUMBER})\s*(\S.*)?")


class SweptRange(NamedTuple):
    """The values from `low` to `high`, both in `unit`; whole numbers if both ends are written as such."""

    low: float
    high: float
    unit: str
    is_whole: bool

    def draw(self, rng: np.random.Generator) -> float:
        """Draw a value; all values are equally probable."""
        if self.is_whole:
            return float(rng.integers(int(self.low), int(self.high), endpoint=True))
        value = rng.uniform(self.low, self.high)
        size, width = max(abs(self.low), abs(self.high)), self.high - self.low
        digits = 4 + max(0, int(math.log10(size / width)))  # as many as tell values of a narrow range apart
        return min(max(float(f"{value:.{digits}g}"), self.low), self.high)

    def text(self, value: float) -> str:
        """Return a value as the language writes it."""
        return f"{value:.15g} {self.unit}".strip() if not self.is_whole else f"{value:.0f}"


def range_of(text: str) -> SweptRange:
    """Return the range that a text such as `0.6..1.4m` or `600 mm..1.4 m` names.

    Both ends have the unit of the last one unless the first has its own, which must then be the same.

    Raises:
        ValueError: the text names no range.
    """
    found = _RANGE.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"found `{text}`; expected a range such as 0.6..1.4m")
    low, first_unit, high, unit = found.groups()
    first_unit, unit = (first_unit or "").strip(), (unit or "").strip()
    if first_unit and first_unit != unit:
        raise ValueError(f"found `{text}`, with two units; expected one, such as 0.6..1.4m")
    if not (float(low) < float(high) and math.isfinite(float(high) - float(low))):
        raise ValueError(f"found `{text}`; expected a lower end below the upper one")
    is_whole = not unit and low.lstrip("+-").isdigit() and high.lstrip("+-").isdigit()
    return SweptRange(float(low), float(high), unit, is_whole)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One run of an experiment, complete: it gives the same result in every process.

    Attributes:
        key: the key of its result.
        program: the behavior.
        spec: the run.
        drawn: the drawn values of params, by name, in the unit in which their range is written.
        params: the same as texts of the language.
        audited: True to have the reference interpreter decide every frame again.
    """

    key: RunKey
    program: ProgramChoice
    spec: RunSpec
    drawn: tuple[tuple[str, float], ...]
    params: tuple[tuple[str, str], ...]
    audited: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """An experiment.

    Attributes:
        name: its name, for people.
        programs: the behavior, and the one to compare it with, if any.
        spec: the run, with the first seed; what varies is replaced, hazards always.
        runs: the number of runs of each behavior.
        varies_start: True to start each run at a free place of the map.
        movers: the range of the number of people, None for that of the run.
        params: the ranges of params by name.
        audit: the part of the runs to audit, 0 to 1.
        digest: a digest of all that results depend on beside these fields: programs and maps.
    """

    name: str
    programs: tuple[ProgramChoice, ...]
    spec: RunSpec
    runs: int
    varies_start: bool
    movers: SweptRange | None
    params: tuple[tuple[str, SweptRange], ...]
    audit: float
    digest: str

    def fingerprint(self) -> str:
        """Return a digest of all that the results depend on."""
        spec = replace(self.spec, file="", scenario=None).with_world(map_path=None, seed=0)
        changes = self.spec.scenario.changes if self.spec.scenario is not None else ()
        shown = repr((spec, changes, self.varies_start, self.movers, self.params))
        return sha256(f"{self.digest} {shown}".encode()).hexdigest()

    def trials(self, floor: WorldMap, radius_mm: float, numbers: Iterable[int]) -> list[Trial]:
        """Return the runs with these numbers, those of both behaviors in turns.

        Args:
            floor: the map.
            radius_mm: the radius of the robot.
            numbers: the numbers, from 1.

        Raises:
            NoRoomError: the map has no free place for the robot.
        """
        space = FreeSpace(floor) if self.varies_start else None
        return [trial for number in numbers for trial in self._trials(number, floor, space, radius_mm)]

    def _trials(self, number: int, floor: WorldMap, space: FreeSpace | None, radius_mm: float) -> list[Trial]:
        seed = self.spec.world.seed + number - 1
        varied: dict[str, object] = {"seed": seed}
        if self.spec.world.hazards is not None:
            varied["hazards"] = seed
        if space is not None:
            rng, clearance = _stream(seed, _START), radius_mm + START_CLEARANCE_MM
            place = space.random_place(floor.start(radius_mm)[:2], clearance, rng)
            varied["start"] = (*place, float(rng.uniform(0.0, 360.0)))
        if self.movers is not None:
            varied["movers"] = int(self.movers.draw(_stream(seed, _MOVERS)))
        drawn = {name: values.draw(_stream(seed, _PARAMS, name)) for name, values in self.params}
        texts = tuple((name, values.text(drawn[name])) for name, values in self.params)
        return [
            Trial(
                key=RunKey(self.name, number, seed, program.label),
                program=program,
                spec=self.spec.with_world(**varied),
                drawn=tuple(drawn.items()),
                params=texts,
                audited=_is_audited(seed, self.audit),
            )
            for program in self.programs
        ]


def _stream(seed: int, kind: int, name: str = "") -> np.random.Generator:
    digest = int.from_bytes(sha256(name.encode()).digest()[:8], "big")
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(kind, digest)))


def _is_audited(seed: int, fraction: float) -> bool:
    """Return True for a fixed `fraction` of all seeds."""
    return (seed * 2_654_435_761 + 97) % 10_007 < fraction * 10_007
