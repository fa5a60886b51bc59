"""The entry point of `colony`: find the command, run it, and turn an error into one line and an exit code.

Exit codes: 0 success (warnings included), 1 errors found, 2 misuse, 3 undecided (`diff`), 130 interrupted.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from io import BufferedWriter, FileIO, TextIOWrapper
from typing import TYPE_CHECKING, TextIO

import click

from colony import __version__
from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED, EXIT_MISUSE
from colony.extras import naming_missing_extras
from colony.text.wording import did_you_mean

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

COMMANDS = {
    "new": "start a project",
    "check": "find errors in behavior files",
    "fmt": "format behavior files in the one style",
    "compile": "compile a behavior to prioritized clients",
    "graph": "draw the network, or what a change does to it",
    "test": "run the tests that behavior files contain",
    "coverage": "show which parts of a behavior its tests, or recordings, exercise",
    "verify": "prove contracts, and find modules that can never act",
    "diff": "prove two behaviors equivalent, or show where they differ",
    "lsp": "serve an editor: findings, completion and proofs while you type",
    "trace": "replay recorded frames through any executor",
    "run": "run a behavior on a simulated robot",
    "serve": "run the servers of a robot",
    "drive": "run a behavior on a robot that is served",
    "shadow": "show what a behavior would do on a robot that is served",
    "watch": "watch a recording or a running robot in the browser",
    "teleop": "drive a robot by hand, with a gamepad or keys",
    "ps": "show the running robots and their state",
    "stop": "stop robots immediately, in an emergency",
    "data": "list, read, set and delete shared variables",
    "params": "list and change tunable params while a robot runs",
    "explain": "explain why the robot did what it did, or did not",
    "export": "write a recording for Foxglove",
    "audit": "compare a recorded run with the reference interpreter",
    "map": "draw a map",
    "experiment": "simulate many runs of a behavior, and report statistics",
    "plan": "plan a path from room to room",
    "sim": "inspect the simulated building",
    "robot": "check, draw and start descriptions of robots",
    "vision": "show what the detectors see in a picture",
    "help": "explain an error code or a command",
}
"""The commands with their descriptions; `colony/cli/NAME.py` defines each as `command`."""


class _StandardOutput(FileIO):
    """A standard output whose errors say that it is the standard output."""

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError as problem:
            problem.filename = "standard output: cannot write"
            raise


class Commands(click.Group):
    """A group that imports a command only on use, so that `colony --help` is fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, in their order of presentation."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command, None for an unknown name."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(f"colony.cli.{cmd_name}").command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command that the arguments name; suggest a similar name for an unknown one."""
        name = args[0]
        if name not in COMMANDS and not name.startswith("-"):
            hint = did_you_mean(name, COMMANDS) or f"the commands are {', '.join(COMMANDS)}"
            raise click.UsageError(f"no command `{name}`; {hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=Commands,
    invoke_without_command=True,
    subcommand_metavar="COMMAND [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(__version__, prog_name="colony")
@click.pass_context
def colony(context: click.Context) -> None:
    """Reactive robot behavior: modules wired through suppressors and inhibitors, compiled, and run.

    \b
    Example:
      colony new patrol.colony
      colony test patrol.colony
      colony run patrol.colony --map loop
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help(), err=True)
        raise click.exceptions.Exit(EXIT_MISUSE)


def _prepare_streams() -> None:
    """Replace the standard streams with ones whose errors name the stream.

    Characters that an encoding lacks become escapes. If a stream is closed, output fails and messages are
    dropped.
    """
    for descriptor in range(3):  # otherwise the next opened file would get the descriptor
        if not _is_open(descriptor):
            os.open(os.devnull, os.O_WRONLY if descriptor == 2 else os.O_RDONLY)
    original = sys.__stdout__
    if sys.stdout is original:  # unless the caller of `main` has replaced it
        sys.stdout = TextIOWrapper(
            BufferedWriter(_StandardOutput(1, "wb", closefd=False)),
            encoding="utf-8" if original is None else original.encoding,
            errors="strict" if original is None else original.errors,
            line_buffering=original is not None and original.line_buffering,
            write_through=original is not None and original.write_through,
        )
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)


def _is_open(descriptor: int) -> bool:
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


def _discard_output(stream: TextIO | None = None) -> None:
    """Discard pending output, whose flush would fail again at the end of the process."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), (stream or sys.stdout).fileno())


def _flush_stderr() -> None:
    """Flush stderr; a failed flush must not change the exit code, as it would at the end of the process."""
    try:
        sys.stderr.flush()
    except (OSError, ValueError):
        _discard_output(sys.stderr)


def _say(text: str) -> None:
    with suppress(OSError):
        click.echo("".join(c if c.isprintable() else " " for c in text), err=True)


def _report_failure(problem: Exception) -> int:
    """Report the diagnostics, or an error of the operating system in one line; return the exit code.

    Raises:
        Exception: any other error, which is a bug.
    """
    from colony.cli.reporting import report
    from colony.extras import MissingExtraError
    from colony.files import describe, is_out_of_memory
    from colony.text.diagnostics import DiagnosticError

    if is_out_of_memory(problem):
        _say("colony: error: out of memory")
        _discard_output()
        return EXIT_ERRORS
    if isinstance(problem, OSError):
        _say(f"colony: error: {describe(problem)}")
        _discard_output()
        return EXIT_MISUSE
    if isinstance(problem, MissingExtraError):
        _say(f"colony: error: {problem}")
        return EXIT_MISUSE
    if not isinstance(problem, DiagnosticError):
        raise problem
    report(problem.diagnostics)
    return EXIT_ERRORS


def _command_path(arguments: Sequence[str]) -> str:
    """Return the command that arguments name, for errors that click raises without a context."""
    command: click.Command = colony
    path, context = "colony", click.Context(colony)
    for argument in arguments:
        found = command.get_command(context, argument) if isinstance(command, click.Group) else None
        if found is None:
            break
        path, command = f"{path} {argument}", found
    return path


def _run() -> int:
    """Run the command, and return the exit code.

    `colony.main` would exit on its own when the reader of a pipe closes it.
    """
    try:
        with colony.make_context("colony", sys.argv[1:]) as context, naming_missing_extras():
            colony.invoke(context)
        sys.stdout.flush()
    except click.exceptions.Exit as done:
        return done.exit_code
    except click.UsageError as problem:
        path = problem.ctx.command_path if problem.ctx else _command_path(sys.argv[1:])
        _say(f"{path}: error: {problem.format_message().rstrip('.')} (see `{path} --help`)")
        return EXIT_MISUSE
    except click.ClickException as problem:
        _say(f"colony: error: {problem.format_message()}")
        return EXIT_MISUSE
    except (click.Abort, KeyboardInterrupt):
        _say("colony: interrupted")
        return EXIT_INTERRUPTED
    except SystemExit as problem:  # click does not raise it here, so a Python module did
        _say(f"colony: error: a module in Python ended the process: SystemExit: {problem.code}")
        return EXIT_ERRORS
    except BrokenPipeError:  # the reader of the output has closed it
        _discard_output()
    except Exception as problem:
        return _report_failure(problem)
    return 0


def main() -> None:
    """Run the console script."""
    _prepare_streams()
    code = _run()
    _flush_stderr()
    sys.exit(code)


if __name__ == "__main__":
    main()
