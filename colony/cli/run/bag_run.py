"""A run of a program in the shadow of a robot whose topics are in a bag, from options to the summary."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from colony.cli.run.interface import TERMINAL_INTERFACE
from colony.cli.run.options import run_spec
from colony.cli.run.running import check_outputs, load_for_run, named, print_summary, reporting_failures
from colony.extras import expect_extras

if TYPE_CHECKING:
    from colony.execute.compiled import Compiled


def run_with_bag(bag: Path, tolerance: float, options: dict[str, Any]) -> None:
    """Run a behavior in the shadow of the robot in a bag, and print the summary.

    Args:
        bag: the bag.
        tolerance: the tolerance of equal commands, in percent.
        options: the options of the command.
    """
    expect_extras("bags")
    from colony.cli.serve.processes import real_devices
    from colony.runs.bagged import BagSpec, run_in_bag

    compiled, described = load_for_run(options["file"], unproved=options["unproved"])
    with reporting_failures(), redirect_stdout(sys.stderr):  # for prints of Python modules
        spec = run_spec(compiled.robot, options)
        check_outputs(spec, None)
        bag_spec = BagSpec(bag, tolerance, partial(unjudged_contracts, compiled))
        devices = real_devices(described)
        result = named(run_in_bag(compiled, described, devices, spec, TERMINAL_INTERFACE, bag_spec), spec)
    print_summary(result, spec.record, None, options["format_"])


def unjudged_contracts(compiled: Compiled, actuators: tuple[str, ...]) -> dict[str, str]:
    """Return the contracts by which the commands of another controller cannot be judged, with the reasons.

    Raises:
        DiagnosticError: the program cannot be rebuilt from its source files.
    """
    from colony.analysis.recording import unpacked_program
    from colony.runtime.assembly.controller import unjudged

    if not compiled.contracts:
        return {}
    with unpacked_program(compiled.root, compiled.sources, compiled.site, compiled.name) as program:
        return unjudged(program, actuators)
