"""`colony trace`: recorded frames in, decisions out."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NoReturn

import click

from colony.cli.exit_codes import EXIT_MISUSE
from colony.cli.outputs import check_output, write_whole
from colony.cli.reporting import load_program, refuse, say
from colony.files import bounded_lines, open_regular, reason

if TYPE_CHECKING:
    from colony.ir.frame import Executor, Frame
    from colony.ir.program import Program


@click.command("trace", short_help="decide recorded frames, with any of the executors")
@click.argument("file", metavar="FILE")
@click.option(
    "--input", "input_", required=True, metavar="FRAMES", help="A file of frames, or - for standard input."
)
@click.option(
    "--backend",
    type=click.Choice(["network", "clients", "python"]),
    default="network",
    show_default=True,
    help="The reference interpreter, the client list, or the generated Python.",
)
@click.option("-o", "--output", type=click.Path(dir_okay=False, path_type=Path), help="Write there instead.")
def command(file: str, input_: str, backend: str, output: Path | None) -> None:
    """Run a behavior over recorded frames and print what it decides, one line a frame.

    A frame is a JSON object a line: "t" in seconds, sensors in declared units, an absent sensor is missing.
    A recording that `colony run --record` wrote is valid input, as JSON lines or as MCAP (*.mcap). A bad line
    is an error with its place, exit code 2, and nothing is printed.

    \b
    Example:
      colony run behaviors/wander.colony --map maps/loop.stickrep --record run.jsonl
      colony trace behaviors/wander.colony --input run.jsonl
      echo '{"t": 0, "bumper": true}' | colony trace behaviors/wander.colony --input -
    """
    if output is not None:
        check_output(output, [file, input_])
    program = load_program(file)
    from colony.diagnostics import Failure
    from colony.runtime.recordings.replay import outcome_line

    lines = io.StringIO()
    name = "<stdin>" if input_ == "-" else input_
    with _open(input_) as frames, redirect_stdout(sys.stderr):  # for what modules in Python print
        executor = _executor(program, backend)
        try:
            for frame, restart in _read(frames, name, program):
                executor = _executor(program, backend) if restart else executor
                lines.write(outcome_line(program, frame.t_ns, executor.step(frame)) + "\n")
        except Failure as failure:
            refuse(failure.diagnostics)
        except OSError as problem:
            _unreadable(name, reason(problem))
    if output is None:
        click.echo(lines.getvalue(), nl=False)
    else:
        write_whole(output, lines.getvalue())


def _read(frames: BinaryIO, name: str, program: Program) -> Iterator[tuple[Frame, bool]]:
    """Every frame, and whether all memory begins anew with it."""
    from colony.cli.recordings import is_mcap, read_recording

    if not is_mcap(name):
        from colony.runtime.recordings.replay import LINE_BYTES, read_rows

        rows = read_rows(bounded_lines(frames, LINE_BYTES), name, program)
        return ((row.frame, row.values.get("@restart") is True) for row in rows)

    return ((recorded.frame, recorded.restart) for recorded in read_recording(frames, name).frames(program))


def _open(name: str) -> BinaryIO:
    if name == "-":
        if sys.stdin is None:
            _unreadable("<stdin>", "standard input is closed")
        return sys.stdin.buffer
    try:
        return open_regular(name)
    except OSError as problem:
        _unreadable(name, reason(problem))


def _unreadable(name: str, why: str) -> NoReturn:
    say(f"{name}:1:1: error[F008]: cannot read the frames: {why}")
    raise click.exceptions.Exit(EXIT_MISUSE)


def _executor(program: Program, backend: str) -> Executor:
    if backend == "network":
        from colony.verify.interpreter import Interpreter

        return Interpreter(program)
    from colony.compile.pipeline import compile_program

    clients = compile_program(program).clients
    if backend == "clients":
        from colony.compile.executor import ClientListExecutor

        return ClientListExecutor(program, clients)
    from colony.compile.backends.python import generate, load

    return load(generate(program, clients))
