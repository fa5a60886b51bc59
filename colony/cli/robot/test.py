"""`colony robot test`: an acceptance test of a robot, with its verdict."""

from __future__ import annotations

import json
import os
import shutil
from contextlib import closing, suppress
from pathlib import Path
from tempfile import gettempdir, mkdtemp
from typing import TYPE_CHECKING, Any

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED
from colony.cli.outputs import BEHAVIOR, check_output, map_option
from colony.cli.reporting import say
from colony.cli.robot_choice import chosen_robot, robot_and_description_argument
from colony.cli.robot_options import reporting_connection_errors
from colony.cli.run.options import OptionError, duration_ns, parsed, seed_option
from colony.extras import expect_extras
from colony.shipped import Shipped

if TYPE_CHECKING:
    from colony.cli.robot.acceptance.findings import AcceptanceFindings
    from colony.cli.robot.acceptance.trial import AcceptanceRequest
    from colony.cli.serve.processes import ServeSpec
    from colony.dsl.descriptions import RobotChoice

RUN_DIRECTORY = "COLONY_RUN_DIR"
"""The variable of the environment that names the run directory."""

MAP = "loop"
"""The map of a robot whose devices are all simulated."""

LONGEST_TEMPORARY = 30
"""Maximum number of characters of the folder in which the test makes its own."""

DRIVES = "the robot will drive and be stopped hard, again and again: give it room"
"""The warning before a test of real devices."""


@click.command("test", short_help="kill, freeze and stop a robot, and print a verdict")
@robot_and_description_argument()
@click.option(
    "--behavior",
    "file",
    metavar="FILE",
    type=BEHAVIOR,
    default="wander",
    show_default=True,
    help=f"What drives the robot: {BEHAVIOR.description}.",
)
@map_option
@click.option("--hardware", is_flag=True, help="Test real devices, by the drivers that the body names.")
@click.option("--port", metavar="PORT", help="Test real devices at this port, as for `colony serve`.")
@click.option("--isolate", is_flag=True, help="Give each server a process of its own, as `colony serve all`.")
@click.option(
    "--duration",
    "length_ns",
    metavar="TIME",
    default="60",
    show_default=True,
    callback=parsed(duration_ns),
    help="The length of the test, 90s or 2min.",
)
@seed_option
@click.option(
    "--scenario",
    metavar="FILE",
    type=click.Path(exists=True, dir_okay=False),
    help="What the behavior reads and nobody simulates, over time, as for `colony run`.",
)
@click.option("-o", "output", metavar="PATH", help="Keep the recording of the run in this file, *.mcap.")
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def test_command(robot: str, format_: str, **options: Any) -> None:
    """Serve a robot, drive it by a behavior, and meanwhile stop it, and kill and freeze its processes.

    ROBOT is NAME[=DESCRIPTION], as for `colony serve`. It is simulated, by default on the map `loop`. With
    --hardware its devices are real (with --map besides, those without a driver are simulated): the robot
    drives, and is stopped hard. The test has a run directory of its own: robots that run stay as they are.

    From the seed, emergency stops come in turn with SIGKILL and SIGSTOP to the processes of servers and
    clients, singly and together, also while the robot is stopped. The leader of the run is frozen, too.

    The robot passes if every stop was acknowledged, took effect within 0.5 s, and was held until its
    release; if after each fault every server and client was back within 20 s; if the base braked within 1 s
    when its server or the Clock died, which a simulated base shows; if nothing died by itself, and no process
    grew; if all contracts held, and the interpreter decides what was recorded.

    Each failure has its second of the recording: `colony explain` and `colony watch` show it. If the robot
    fails, logs and recording are kept. Ctrl-C ends the test with what was found so far.

    Exit code: 0 if the robot passes, 1 if it fails, 2 for misuse, 130 after Ctrl-C.

    \b
    Example:
      colony robot test amr
      colony robot test amr --duration 10min --seed 7 -o test.mcap
      colony robot test t1=robots/tugger/tugger.colony --behavior tow.colony --map office
      colony robot test rome --format json
    """
    from colony.cli.run.running import reporting_failures
    from colony.runs.spec import RunAbortedError

    with reporting_failures(), reporting_connection_errors():
        folder, is_kept = Path(mkdtemp(prefix="colony-test-", dir=_temporary())), False
        try:
            request = _request(robot, folder, **options)
            findings = _tested(robot, request)
            is_kept = bool(findings.failures())
        except RunAbortedError:
            is_kept = True
            say(f"{robot}: the logs are in {folder}")
            raise
        finally:
            if not is_kept:
                shutil.rmtree(folder, ignore_errors=True)
    recording = request.recording if options["output"] or is_kept else None
    if format_ == "json":
        click.echo(json.dumps(findings.as_json() | {"recording": recording}, indent=2))
    else:
        _print(findings, recording, folder if is_kept else None)
    if findings.interrupted:
        raise click.exceptions.Exit(EXIT_INTERRUPTED)
    if is_kept:
        raise click.exceptions.Exit(EXIT_ERRORS)


def _temporary() -> str:
    """Return the folder for temporary files, /tmp if its name is too long for the sockets of a robot."""
    folder = gettempdir()
    return folder if len(folder) <= LONGEST_TEMPORARY else "/tmp"


def _request(
    robot: str,
    folder: Path,
    *,
    file: str,
    length_ns: int,
    scenario: str | None,
    output: str | None,
    seed: int,
    **options: Any,
) -> AcceptanceRequest:
    """Return the test that the options request; exit with 2, or with 1 for errors of the behavior."""
    from colony.cli.programs import compile_for_run
    from colony.cli.robot.acceptance.trial import AcceptanceRequest

    if output is not None:
        if Path(output).suffix != ".mcap":
            raise OptionError(f"-o: found `{output}`; expected *.mcap, which has the program for the audit")
        check_output(output, [file])
    choice = chosen_robot()
    assert choice is not None
    served = _served(robot, choice, folder / "state", seed=seed, **options)
    described = robot if choice.is_name else f"{robot}={choice.text}"
    given = () if scenario is None else ("--scenario", scenario)
    compiled = compile_for_run(file)[0].compiled
    return AcceptanceRequest(
        served=served,
        arguments=(file, "--robot", described, "--seed", str(seed), *given),
        actuators=frozenset(actuator.name for actuator in compiled.robot.actuators),
        recording=output or str(folder / "run.mcap"),
        seed=seed,
        seconds=length_ns / 1e9,
        folder=folder,
    )


def _served(
    robot: str, choice: RobotChoice, state: Path, *, map_path: str | None, hardware: bool, **options: Any
) -> ServeSpec:
    """Return what is served; exit with 2 if the robot does not exist, or is not one for these options."""
    from colony.cli.serve.main import ALL, objection, serve_spec
    from colony.dsl.descriptions import find_in_project, suggestion
    from colony.runtime.kit.discovery import running_robots

    hardware = hardware or options["port"] is not None
    if find_in_project(choice.text, Path()) is None:
        raise OptionError(f"there is no description `{choice.text}` ({suggestion(choice.text, Path())})")
    if hardware and (running := running_robots().get(robot)):
        raise OptionError(f"--hardware: `{robot}` is served already: end {', '.join(running)} first")
    if not hardware or map_path is not None:
        expect_extras("sim")
    world = map_path or (None if hardware else Shipped.MAP.find(MAP))
    spec = serve_spec({**options, "map_path": world, "hardware": hardware, "state": state})
    if (reason := objection(ALL, spec)) is not None:
        raise OptionError(reason)
    if hardware:
        say(f"{robot}: {DRIVES}")
    return spec


def _tested(robot: str, request: AcceptanceRequest) -> AcceptanceFindings:
    """Execute the test and audit its recording; return what was found, also after an interruption."""
    from colony.cli.audit import audited
    from colony.cli.interruption import interruptible
    from colony.cli.progress import RunProgress
    from colony.cli.robot.acceptance.findings import AcceptanceFindings
    from colony.cli.robot.acceptance.trial import InterruptedTestError, RobotTrial
    from colony.runtime.transport.live.robot_address import local
    from colony.sim.compiling import COMPILING
    from colony.text.diagnostics import DiagnosticError

    findings = AcceptanceFindings(robot=robot, actuators=len(request.actuators))
    progress = RunProgress(round(request.seconds * 1e9))

    def show(seconds: float, doing: str) -> None:
        progress.show(round(min(seconds, request.seconds) * 1e9), lambda: doing)

    os.environ[RUN_DIRECTORY] = str(request.folder / "r")  # also of the processes that are started
    with (
        closing(progress),
        interruptible("ending the robot") as interrupted,
        (request.folder / "served.log").open("w", encoding="utf-8") as log,
    ):

        def report(text: str) -> None:
            print(text, file=log, flush=True)
            if text == COMPILING:
                say(text)

        try:
            trial = RobotTrial(local(robot, os.environ), request, findings, interrupted, show)
            trial.run(report)
        except InterruptedTestError:
            findings.interrupted = True
        with suppress(DiagnosticError):  # there is no frame to compare
            findings.audit = audited(request.recording)[2]
    return findings


def _print(findings: AcceptanceFindings, recording: str | None, kept: Path | None) -> None:
    """Print the table, the failures and the verdict."""
    for line in findings.lines():
        click.echo(line)
    failures = findings.failures()
    for failure in failures:
        click.echo(str(failure))
    so_far = f" so far: interrupted after {findings.seconds:.1f} s" if findings.interrupted else ""
    click.echo(f"{findings.robot} {'FAILS' if failures else 'passes'}{so_far}")
    if kept is not None:
        click.echo(f"the recording is {recording}; the logs are in {kept}")
