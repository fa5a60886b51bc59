"""The behaviors of an experiment, loaded and compiled; nothing here needs the simulator."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

from colony.dsl.descriptions import RobotChoice
from colony.dsl.load import load_file
from colony.dsl.site import SiteParams
from colony.dsl.site_reading import params_from_values
from colony.execute.compiled import Compiled
from colony.ir.program import Program
from colony.robots.compiled_program import compiled_with_sources
from colony.robots.described import DescribedRobot, described_robot
from colony.robots.request import MisuseError


class ProgramChoice(NamedTuple):
    """A behavior: its name in results, its file, the description of its robot, and the params of a site.

    `sources` is the digest of its source files in this experiment; "" for any.
    """

    label: str
    file: str
    robot: RobotChoice | None
    site: SiteParams | None
    sources: str = ""


class CompiledProgram(NamedTuple):
    """A program, compiled, and its robot."""

    program: Program
    compiled: Compiled
    described: DescribedRobot


@lru_cache(maxsize=4)
def compiled_of(choice: ProgramChoice, params: tuple[tuple[str, str], ...] = ()) -> CompiledProgram:
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
    return CompiledProgram(program, compiled, described_robot(program.robot))


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
