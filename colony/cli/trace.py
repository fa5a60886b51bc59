"""`colony trace`: the decisions of a behavior for recorded frames."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NoReturn

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.frame_picture import check_picture, draw_frame, expect_bearings, frame_title, refuse_frame
from colony.cli.outputs import BEHAVIOR, check_output, output_option, write_whole
from colony.cli.params_choice import params_option
from colony.cli.recorded import program_for
from colony.cli.reporting import one_line, refuse, say
from colony.cli.robot_choice import description_option
from colony.extras import expect_extras
from colony.files import open_regular, reason
from colony.text.wording import time_text

if TYPE_CHECKING:
    from colony.analysis.follower import Backend, DamagedSpan
    from colony.ir.frame import Outcome
    from colony.ir.program import Program
    from colony.runtime.frames.run_frame import RunFrame
    from colony.runtime.recordings.recorded import RecordingReader


@click.command("trace", short_help="replay recorded frames through any executor")
@click.argument("file", metavar="[FILE]", required=False, type=BEHAVIOR)
@description_option()
@params_option()
@click.option(
    "--input", "input_", required=True, metavar="FRAMES", help="A file of frames, or - for standard input."
)
@click.option(
    "--backend",
    type=click.Choice(["network", "clients", "python", "c"]),
    default="network",
    show_default=True,
    help="The executor: the reference interpreter, the client list, generated Python, or C.",
)
@click.option(
    "--frame",
    "frame_number",
    type=click.IntRange(min=0),
    metavar="N",
    help="Print only the decision of the frame with this number, as `colony audit` counts them.",
)
@click.option(
    "--picture",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PATH",
    help="Draw the frame of --frame, by default the last one, PNG or SVG: the arrays with bearings around "
    "the robot, and the decisions.",
)
@output_option
def command(
    file: str | None,
    input_: str,
    backend: Backend,
    frame_number: int | None,
    picture: Path | None,
    output: Path | None,
) -> None:
    """Run a behavior over recorded frames and print its decisions, one line per frame.

    A frame is a JSON object on one line: "t" in seconds, and sensors in declared units; an absent sensor is
    missing. Recordings of `colony run --record`, as JSON lines or MCAP, are valid input. An MCAP recording
    contains its program, so that FILE may be left out, unless it has modules in Python. If a line is invalid,
    an error is reported, nothing is printed, and the exit code is 2.

    The params of a site are taken from the recording, or from --params if it is given (which a recording that
    comes through a pipe needs).

    In a damaged recording the undamaged frames are decided, the damaged time span is reported, and the exit
    code is 1. After the damage the backend `network` continues from the recorded memory, the others from the
    next epoch.

    \b
    Example:
      colony run wander --map loop --record run.mcap
      colony trace --input run.mcap
      colony trace --input run.mcap --frame 120 --picture scan.png
      echo '{"t": 0, "bumper": true}' | colony trace wander --input -
    """
    if backend == "c":
        expect_extras("native")
    inputs = [path for path in (file, input_) if path is not None]
    if output is not None:
        check_output(output, inputs)
    if picture is not None:
        check_picture(picture, [*inputs, *([str(output)] if output is not None else [])])
    from colony.analysis.recording import OpenRecording
    from colony.runtime.recordings.opening import read_frames
    from colony.text.diagnostics import DiagnosticError

    name = "<stdin>" if input_ == "-" else input_
    with ExitStack() as resources:
        resources.enter_context(redirect_stdout(sys.stderr))  # for prints of Python modules
        try:
            recording = resources.enter_context(OpenRecording(_open(input_), name, read_frames))
            program, reader = program_for(recording, file), recording.reader
            if file is None:
                _expect_no_modules(program, name)
            if picture is not None:
                expect_bearings(program, file or name)
            decided = _decide(program, reader, _available(backend, program), frame_number)
        except DiagnosticError as failure:
            if failure.diagnostics[0].code == "P001":  # an error of the behavior, not of the frames
                raise
            if failure.diagnostics[0].code == "A006":
                say(one_line(failure.diagnostics[0]))
                raise click.exceptions.Exit(EXIT_ERRORS) from None
            refuse(failure.diagnostics)
        except OSError as problem:
            _unreadable(name, reason(problem))
    if frame_number is not None and not decided.is_found:
        refuse_frame(name, frame_number, decided.first, decided.last)
    if output is None:
        click.echo("".join(decided.lines), nl=False)
    else:
        write_whole(output, "".join(decided.lines))
    if picture is not None:
        subject = Path(file or (reader.run.program if reader.run else name)).name
        _draw(picture, program, subject, decided, name)
    _report(name, reader, decided)


def _available(backend: Backend, program: Program) -> Backend:
    """Return the backend, or generated Python in the place of C that cannot be compiled, which is printed."""
    if backend != "c":
        return backend
    from colony.compile.backends.c.native import NoCompilerError, load_c
    from colony.compile.pipeline import compile_program

    try:
        load_c(compile_program(program).compiled)  # is in the cache then
    except NoCompilerError as problem:
        say(f"note: {problem}: generated Python decides instead")
        return "python"
    return backend


class _Decided:
    """The decisions of a trace. Stateful: grows with the frames.

    Attributes:
        lines: a line for each decision that is printed.
        first: the number of the first frame, and `last` that of the last one; there are none if it is below.
        is_found: True if the frame of `--frame` was found.
        shown: the last frame of which the decision is printed, if there is one; `active` are its modules.
        damaged: the damaged sections.
        undecided: the number of frames whose memory is not known.
    """

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.first, self.last = 0, -1
        self.is_found = False
        self.shown: tuple[RunFrame, Outcome] | None = None
        self.active: tuple[str, ...] | None = None
        self.damaged: Sequence[DamagedSpan] = ()
        self.undecided = 0


def _decide(program: Program, reader: RecordingReader, backend: Backend, number: int | None) -> _Decided:
    """Decide all frames, or those up to the one with a number, of which alone the decision is a line."""
    from colony.analysis.follower import BackendExecutors, Follower, UnknownMemory
    from colony.runtime.recordings.replay import outcome_line
    from colony.verify.reference.interpreter import Interpreter

    follower, decided = Follower(BackendExecutors(program, backend)), _Decided()
    for recorded in reader.frames(program):
        executor, k = follower.feed(recorded), recorded.tick.k
        decided.first, decided.last = (k if decided.last < 0 else decided.first), k
        decided.is_found = number is None or k == number
        if isinstance(executor, UnknownMemory):
            decided.undecided += 1
        else:
            outcome = executor.step(recorded.frame)
            if decided.is_found:
                decided.lines.append(outcome_line(program, recorded.frame.t_ns, outcome) + "\n")
                decided.shown = recorded, outcome
        if decided.is_found and number is not None:
            break
    follower.end(damaged=reader.damaged)
    decided.damaged = follower.damaged
    if decided.shown and isinstance(follower.executor, Interpreter):
        decided.active = follower.executor.active_modules()
    return decided


def _expect_no_modules(program: Program, name: str) -> None:
    """Refuse a program in a recording that has modules in Python, which are not run from there."""
    from colony.analysis.recording import unusable
    from colony.ir.program import PythonModule
    from colony.text.diagnostics import DiagnosticError

    if any(isinstance(m, PythonModule) for m in program.modules):
        raise DiagnosticError([unusable(name, "the modules in Python of a recording are not run")])


def _draw(picture: Path, program: Program, subject: str, decided: _Decided, name: str) -> None:
    if decided.shown is None:
        say(f"{name}: error: --picture: found no frame that is decided")
        raise click.exceptions.Exit(EXIT_ERRORS)
    recorded, outcome = decided.shown
    title = frame_title(subject, recorded.tick.k, recorded.frame.t_ns)
    draw_frame(picture, program, title, recorded.frame, outcome, decided.active)


def _report(name: str, reader: RecordingReader, decided: _Decided) -> None:
    """Report what of the recording was not decided, and why; exit with 1 if it is damaged."""
    if reader.truncation:
        say(f"{name}: {reader.truncation}; decided as far as it goes")
    for text in reader.remarks:
        say(f"{name}: {text}")
    for span in decided.damaged:
        start = "" if span.after_ns is None else f" from {time_text(span.after_ns)}"
        end = "its end" if span.before_ns is None else time_text(span.before_ns)
        say(f"{name}: error: damaged{start} to {end}")
    if decided.undecided:
        say(f"{name}: frames not decided because the memory is unknown: {decided.undecided}")
    if decided.damaged:
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
