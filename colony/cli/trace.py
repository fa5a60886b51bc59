"""`colony trace`: the decisions of a behavior for recorded frames."""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NoReturn

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.outputs import check_output, output_option, write_whole
from colony.cli.params_choice import choose_params, params_option
from colony.cli.reporting import load_program, one_line, refuse, say
from colony.cli.robot_choice import description_option
from colony.cli.shipped_files import BEHAVIOR
from colony.files import open_regular, reason

if TYPE_CHECKING:
    from colony.verify.audit.deciding import Backend


@click.command("trace", short_help="replay recorded frames through any executor")
@click.argument("file", metavar="FILE", type=BEHAVIOR)
@description_option()
@params_option()
@click.option(
    "--input", "input_", required=True, metavar="FRAMES", help="A file of frames, or - for standard input."
)
@click.option(
    "--backend",
    type=click.Choice(["network", "clients", "python"]),
    default="network",
    show_default=True,
    help="The executor: the reference interpreter, the client list, or the generated Python.",
)
@output_option
def command(file: str, input_: str, backend: Backend, output: Path | None) -> None:
    """Run a behavior over recorded frames and print its decisions, one line per frame.

    A frame is a JSON object on one line: "t" in seconds, and sensors in declared units; an absent sensor is
    missing. Recordings of `colony run --record`, as JSON lines or MCAP, are valid input. If a line is
    invalid, an error is reported, nothing is printed, and the exit code is 2.

    Params that a site set are those in the recording, unless --params gives others. Give --params for a
    recording that comes by a pipe.

    In a damaged recording the undamaged frames are decided, the damaged time span is reported, and the exit
    code is 1. After the damage the backend `network` continues from the recorded memory, the others from the
    next epoch.

    \b
    Example:
      colony run wander --map loop --record run.jsonl
      colony trace wander --input run.jsonl
      echo '{"t": 0, "bumper": true}' | colony trace wander --input -
    """
    if output is not None:
        check_output(output, [file, input_])
    from colony.runtime.recordings.opening import read_frames, recorded_site

    if input_ != "-":
        from colony.dsl.site_reading import params_of

        choose_params(params_of(recorded_site(input_)))
    program = load_program(file)
    from colony.runtime.recordings.replay import outcome_line
    from colony.text.diagnostics import DiagnosticError
    from colony.verify.audit.deciding import Decider

    lines = io.StringIO()
    name = "<stdin>" if input_ == "-" else input_
    with _open(input_) as frames, redirect_stdout(sys.stderr):  # for prints of Python modules
        decider = Decider(program, backend)
        try:
            reader = read_frames(frames, name)
            for recorded in reader.frames(program):
                outcome = decider.step(recorded)
                if outcome is not None:
                    lines.write(outcome_line(program, recorded.frame.t_ns, outcome) + "\n")
        except DiagnosticError as failure:
            if failure.diagnostics[0].code == "A006":
                say(one_line(failure.diagnostics[0]))
                raise click.exceptions.Exit(EXIT_ERRORS) from None
            refuse(failure.diagnostics)
        except OSError as problem:
            _unreadable(name, reason(problem))
    decider.end(damaged=reader.damaged)
    if output is None:
        click.echo(lines.getvalue(), nl=False)
    else:
        write_whole(output, lines.getvalue())
    if reader.truncation:
        say(f"{name}: {reader.truncation}; decided as far as it goes")
    for text in decider.damage:
        say(f"{name}: error: {text}")
    if decider.undecided:
        say(f"{name}: frames not decided because the memory is unknown: {decider.undecided}")
    if decider.damage:
        raise click.exceptions.Exit(EXIT_ERRORS)


def _open(name: str) -> BinaryIO:
    if name == "-":
        if sys.stdin is None:
            _unreadable("<stdin>", "standard input is closed")
        return sys.stdin.buffer
    try:
        return open_regular(name)
    except OSError as problem:
        streams = Path(name).is_fifo() or Path(name).is_char_device()
        hint = "; use `--input -` for a pipe or a device" if streams else ""
        _unreadable(name, f"{reason(problem)}{hint}")


def _unreadable(name: str, why: str) -> NoReturn:
    say(f"{name}:1:1: error[F008]: cannot read the frames: {why}")
    raise click.exceptions.Exit(EXIT_MISUSE)
