"""`colony trace`: recorded frames in, decisions out."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import BufferedReader
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple, NoReturn

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_MISUSE
from colony.cli.outputs import check_output, write_whole
from colony.cli.reporting import load_program, one_line, refuse, say
from colony.files import bounded_lines, open_regular, reason

if TYPE_CHECKING:
    from colony.ir.frame import Executor, Frame, Outcome
    from colony.ir.program import Program
    from colony.runtime.observe.monitor import Keyframe


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
    A recording that `colony run --record` wrote is valid input, as JSON lines or as MCAP. A bad line
    is an error with its place, exit code 2, and nothing is printed. Where a recording is damaged its whole
    frames are decided, it is said from when to when, and the exit code is 1. After the damage the backend
    network goes on from the memory that the recording holds, others where all memory begins anew.

    \b
    Example:
      colony run behaviors/wander.colony --map maps/loop.stickrep --record run.jsonl
      colony trace behaviors/wander.colony --input run.jsonl
      echo '{"t": 0, "bumper": true}' | colony trace behaviors/wander.colony --input -
    """
    if output is not None:
        check_output(output, [file, input_])
    program = load_program(file)
    from colony.runtime.recordings.replay import outcome_line
    from colony.text.diagnostics import Failure

    lines = io.StringIO()
    name = "<stdin>" if input_ == "-" else input_
    with _open(input_) as frames, redirect_stdout(sys.stderr):  # for what modules in Python print
        decider = _Decider(program, backend)
        try:
            for recorded in _read(frames, name, program, decider):
                outcome = decider.step(recorded)
                if outcome is not None:
                    lines.write(outcome_line(program, recorded.frame.t_ns, outcome) + "\n")
        except Failure as failure:
            if failure.diagnostics[0].code == "A006":
                say(one_line(failure.diagnostics[0]))
                raise click.exceptions.Exit(EXIT_ERRORS) from None
            refuse(failure.diagnostics)
        except OSError as problem:
            _unreadable(name, reason(problem))
    if output is None:
        click.echo(lines.getvalue(), nl=False)
    else:
        write_whole(output, lines.getvalue())
    if decider.cut:
        say(f"{name}: {decider.cut}; decided as far as it goes")
    for text in decider.damage:
        say(f"{name}: error: {text}")
    if decider.undecided:
        say(f"{name}: frames that are not decided, as memory is not known: {decider.undecided}")
    if decider.damage:
        raise click.exceptions.Exit(EXIT_ERRORS)


class _Recorded(NamedTuple):
    """A frame; whether all memory begins anew with it; whether frames before it were not observed, so that
    memory is not known; the memory before it, where the recording holds that; and whether something before it
    is damaged."""

    frame: Frame
    restart: bool
    memory_unknown: bool
    keyframe: Keyframe | None
    damaged: bool


def _read(frames: BinaryIO, name: str, program: Program, decider: _Decider) -> Iterator[_Recorded]:
    """Every frame; tells `decider` how the recording ends."""
    from colony.runtime.recordings.reader import BREAKS_OFF, MAGIC

    if isinstance(frames, BufferedReader) and frames.peek(len(MAGIC)).startswith(MAGIC):
        from colony.runtime.recordings.opening import read_recording

        reader = read_recording(frames, name)
        for whole in reader.frames(program):
            unknown = whole.memory_unknown
            yield _Recorded(whole.frame, whole.restart, unknown, whole.keyframe, whole.damaged)
        decider.ends(damaged=reader.damaged, cut=reader.cut)
        return
    from colony.runtime.recordings.keyframes import read_keyframe
    from colony.runtime.recordings.replay import LINE_BYTES, Rows

    rows = Rows(bounded_lines(frames, LINE_BYTES), name, program)
    for row in rows:
        restart, skipped = row.values.get("@restart") is True, row.values.get("@skipped") is not None
        yield _Recorded(row.frame, restart, skipped, read_keyframe(row.values.get("@keyframe")), row.damaged)
    decider.ends(damaged=rows.damaged, cut=BREAKS_OFF if rows.broken_off else None)


class _Decider:
    """Decides frames with the executor that was asked for, and goes on after damage where that can. Mutable:
    the executor, what was damaged, and how many frames were not decided."""

    def __init__(self, program: Program, backend: str) -> None:
        from colony.verify.audit.resuming import Resuming

        self._program = program
        self._backend = backend
        self._resuming = Resuming(program)
        self._executor: Executor | None = _executor(program, backend)
        self._last_ns: int | None = None
        self.damage: list[str] = []
        self.undecided = 0
        self.cut: str | None = None

    def step(self, recorded: _Recorded) -> Outcome | None:
        """Decide a frame; None where memory is not known."""
        if recorded.damaged:
            self._executor = None
            self._tell(f"to {recorded.frame.t_ns / 1e9:.10g} s")
        self._last_ns = recorded.frame.t_ns
        if recorded.restart:
            self._executor = _executor(self._program, self._backend)
        elif recorded.memory_unknown:
            self._executor = None
        elif self._executor is None and recorded.keyframe is not None:
            self._executor = self._resumed(recorded.keyframe)
        if self._executor is None:
            self.undecided += 1
            return None
        return self._executor.step(recorded.frame)

    def ends(self, *, damaged: bool, cut: str | None) -> None:
        """Note whether what comes after the last frame is damaged, and how the recording breaks off."""
        self.cut = cut
        if damaged:
            self._tell("to its end")

    def _resumed(self, keyframe: Keyframe) -> Executor | None:
        if self._backend != "network" or keyframe.memory is None:
            return None
        try:
            return self._resuming.interpreter(keyframe.memory)
        except ValueError:
            return None

    def _tell(self, end: str) -> None:
        start = "" if self._last_ns is None else f" from {self._last_ns / 1e9:.10g} s"
        self.damage.append(f"damaged{start} {end}")


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


def _executor(program: Program, backend: str) -> Executor:
    if backend == "network":
        from colony.verify.reference.interpreter import Interpreter

        return Interpreter(program)
    from colony.compile.pipeline import compile_program

    compiled = compile_program(program).compiled
    if backend == "clients":
        from colony.execute.executor import ProgramExecutor

        return ProgramExecutor(compiled)
    from colony.compile.backends.python.generate import generate, load

    return load(generate(compiled))
