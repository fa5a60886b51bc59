"""The program of `colony run` and its robot, with the params of a site if it may run with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.params_choice import chosen_params
from colony.cli.reporting import report, say
from colony.cli.robot_choice import chosen_robot
from colony.execute.colonyc import is_compiled

if TYPE_CHECKING:
    from colony.dsl.site import SiteParams
    from colony.execute.compiled import Compiled
    from colony.robots.described import DescribedRobot


def load_for_run(file: str, *, unproved: bool) -> tuple[Compiled, DescribedRobot]:
    """Return the compiled program of a file and its robot, for a run; params of a site are those it may have.

    Exits with 1 if the program has errors, does not fit its body, or if a contract is not proved any more
    with the params; with 2 if the file cannot be read or is damaged, if that cannot be proved here, or if the
    file was compiled, with other params or for a robot chosen before.
    """
    from colony.cli.programs import compile_for_run, described_for_run, load_compiled

    params = chosen_params()
    if is_compiled(file):
        robot = chosen_robot()
        if robot is not None and not robot.is_name:
            say(f"{file}: error: it was compiled with the description of its robot; give --robot NAME alone")
            raise click.exceptions.Exit(EXIT_MISUSE)
        compiled = _of_compiled(file, load_compiled(file), params, unproved=unproved)
        return compiled, described_for_run(compiled.robot, _own_body(compiled))
    if params is None and unproved:
        message = "--unproved requires --params, or a compiled program with params"
        raise click.UsageError(message, click.get_current_context())
    compilation, described = compile_for_run(file)
    if params is None or unproved:
        return compilation.compiled, described
    from colony.cli.site_proof import with_proof

    return with_proof(compilation, file, params, instead="--unproved"), described


def _own_body(compiled: Compiled) -> Path | None:
    """Return the body in a compiled program as a file for the time of the command; None without one."""
    body = next((source for source in compiled.sources if source.kind == "body"), None)
    if body is None:
        return None
    folder = click.get_current_context().with_resource(TemporaryDirectory(prefix="colony-body-"))
    path = Path(folder, Path(body.path).name)
    path.write_bytes(body.data)
    return path


def _of_compiled(file: str, compiled: Compiled, params: SiteParams | None, *, unproved: bool) -> Compiled:
    """Return a compiled program that may run; it has its params, and the proof that was made with them."""
    site = compiled.site
    if params is not None:
        if params.diagnostics:
            report(params.diagnostics)
            raise click.exceptions.Exit(EXIT_ERRORS)
        given = tuple(sorted((value.name, value.text or "") for value in params.values))
        if site is None or site.values != given:
            say(
                f"{file}: error: it was not compiled with the params of {params.file}; compile it again: "
                f"colony compile FILE --params {params.file} -o {file}"
            )
            raise click.exceptions.Exit(EXIT_MISUSE)
    if site is None:
        return compiled
    if unproved:
        return replace(compiled, site=replace(site, proved=None))
    if site.proved is None:
        say(
            f"{file}: error: it was compiled with the params of {site.file}, and without a proof of them; "
            "compile it again without --no-proof, or give --unproved"
        )
        raise click.exceptions.Exit(EXIT_MISUSE)
    return compiled
