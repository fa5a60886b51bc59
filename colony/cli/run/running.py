"""What the commands that run a behavior share: the program before the run, errors, and outputs after it."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, redirect_stdout
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED, EXIT_MISUSE
from colony.cli.outputs import check_output, write_whole
from colony.cli.params_choice import chosen_params
from colony.cli.reporting import refuse, report, say
from colony.cli.robot_choice import chosen_robot
from colony.cli.robot_options import reporting_connection_errors, robot_address_of
from colony.cli.run.options import OptionError, run_spec
from colony.execute.colonyc import is_compiled
from colony.runs.spec import MisuseError, RunAbortedError

if TYPE_CHECKING:
    from colony.dsl.site import SiteParams
    from colony.execute.compiled import Compiled
    from colony.runs.described import DescribedRobot
    from colony.runs.spec import RunReport, RunSpec, UserInterface
    from colony.runtime.transport.live.robot_address import RobotAddress


# --- the run of a robot that is served -----------------------------------------------------------


def run_on_served(
    run: Callable[[Compiled, DescribedRobot, RobotAddress, RunSpec, UserInterface], RunReport],
    interface: Callable[[Compiled, RunSpec], AbstractContextManager[UserInterface]],
    options: dict[str, Any],
) -> None:
    """Run a behavior on a robot that is already running, and print the summary.

    Args:
        run: function that runs it.
        interface: function that lends the user interface of the run.
        options: the options of the command.
    """
    compiled, described = load_for_run(options["file"], unproved=options["unproved"])
    with reporting_failures(), redirect_stdout(sys.stderr):  # for prints of Python modules
        spec = run_spec(compiled.robot, options)
        check_outputs(spec, None)
        with interface(compiled, spec) as ui, reporting_connection_errors():
            name = compiled.name if spec.robot is None else spec.robot
            address = robot_address_of(name, options["connect"], options["security"])
            _expect_running(address, described)
            result = named(run(compiled, described, address, spec, ui), spec)
    print_summary(result, spec.record, None, options["format_"])


def _expect_running(robot_address: RobotAddress, described: DescribedRobot) -> None:
    """Check that a robot on this machine has processes; one behind a gateway is not checked.

    Raises:
        MisuseError: it has none.
    """
    from colony.runtime.kit.discovery import running_robots
    from colony.runtime.transport.live.robot_address import Local

    if isinstance(robot_address, Local) and not robot_address.directory.running():
        robots = ", ".join(running_robots()) or "none"
        robot, kind = robot_address.robot, described.path and described.path.stem
        served = robot if kind in (None, robot) else f"{robot}={kind}"
        raise MisuseError(
            f"colony: error: no process of `{robot}` runs on this machine "
            f"(running robots: {robots}); "
            f"start it with `colony serve all --robot {served} --map MAP`, "
            "a real one with --hardware or --port PORT in place of the map"
        )


def named(result: RunReport, spec: RunSpec) -> RunReport:
    """Return a report with the name of the robot, if the user gave one."""
    if spec.robot is None:
        return result
    return result._replace(summary=replace(result.summary, robot=spec.robot))


# --- before the run ------------------------------------------------------------------------------


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


@contextmanager
def reporting_failures() -> Iterator[None]:
    """Report an error that prevents or ends a run, and exit with its code."""
    from colony.text.diagnostics import DiagnosticError

    try:
        yield
    except MisuseError as misuse:
        say(str(misuse))
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except RunAbortedError as problem:
        say(f"colony: error: {problem}")
        raise click.exceptions.Exit(EXIT_ERRORS) from None
    except DiagnosticError as failure:
        if failure.diagnostics[0].code.startswith("M"):
            refuse(failure.diagnostics)
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_ERRORS) from None


def check_outputs(spec: RunSpec, picture: str | None) -> None:
    """Refuse, before a long run, an output that cannot be written or would overwrite its input.

    Raises:
        OptionError: the picture has no format, or both outputs are the same file.
        DiagnosticError: the map is invalid.
        click.exceptions.Exit: a file cannot be written, which has been reported.
    """
    inputs, record = [spec.file], spec.record
    if spec.world.map_path is not None:
        from colony.nav.maps.world_map import load_world

        inputs += load_world(spec.world.map_path).files  # before the simulator is imported, which takes long
    if picture is not None:
        from colony.view.map_picture import picture_format

        try:
            picture_format(picture)
        except ValueError as problem:
            raise OptionError(f"--picture: {problem}") from None
        if record is not None and os.path.realpath(record) == os.path.realpath(picture):
            raise OptionError(f"--record and --picture: found `{picture}` for both; expected two files")
    for path in (record, picture):
        if path is not None:
            check_output(path, inputs)


# --- after the run -------------------------------------------------------------------------------


def draw(result: RunReport, robot: str, path: str) -> RunReport:
    """Draw each floor with the robots' paths: the first floor into `path`, each other one into a file beside
    it.

    The other files are named after their floors: run.png and run.msu_engineering_2.png. The returned result
    lists them. If a picture cannot be written, that has been reported, and the result lists it as unwritten.
    """
    import numpy as np

    from colony.view.map_picture import draw_world, encode_picture, picture_format

    target = Path(path)
    others: list[str] = []
    for number, floor in enumerate(result.floors):
        path_xy = np.array(result.paths.get(floor.name, ()), dtype=np.float64).reshape(-1, 2)
        paths = [path_xy, *(np.array(path, dtype=np.float64) for path in result.other_paths.values())]
        people = [np.array(path) for path in result.people.get(floor.name, ())]
        picture = draw_world(floor, paths, names=[robot, *result.other_paths], people=people)
        file = target if number == 0 else target.with_suffix(f".{floor.name}{target.suffix}")
        try:
            write_whole(file, encode_picture(picture, picture_format(path)))
        except click.exceptions.Exit:
            return result._replace(summary=replace(result.summary, unwritten=(path,)))
        others += [str(file)] if number else []
    if result.mission_result is None:
        return result
    return result._replace(mission_result=result.mission_result._replace(pictures=tuple(others)))


def print_summary(result: RunReport, record: str | None, picture: str | None, format_: str) -> None:
    """Print the summary of a run, and exit with its code."""
    summary, mission_result = result.summary, result.mission_result
    if format_ == "json":
        outputs: dict[str, object] = {"recording": record, "picture": picture}
        if mission_result is not None:
            outputs["arrival"] = mission_result._asdict()
        if result.controller is not None:
            outputs["controller"] = result.controller.as_json()
        click.echo(json.dumps(summary.as_json() | outputs, indent=2))
    else:
        from colony.runtime.observe.summary import render

        click.echo(render(summary))
        if result.controller is not None:
            from colony.runtime.observe.comparison import render_comparison

            click.echo(render_comparison(result.controller))
        for path in (record, picture, *(() if mission_result is None else mission_result.pictures)):
            if path is not None and path not in summary.unwritten:
                click.echo(f"  wrote {path}")
        if mission_result is not None:
            click.echo(f"  {mission_result.text}")
    if mission_result is not None and not mission_result.arrived and not summary.interrupted:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if not summary.succeeded:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if summary.interrupted:
        raise click.exceptions.Exit(EXIT_INTERRUPTED)
    if summary.unwritten:
        raise click.exceptions.Exit(EXIT_MISUSE)
