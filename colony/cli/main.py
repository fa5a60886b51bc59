"""`colony`: finds the command, runs it, and turns what goes wrong into one line and an exit code.

Exit codes: 0 good (warnings included), 1 errors found, 2 misuse, 130 interrupted.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module

import click

from colony import __version__

COMMANDS = {
    "new": "write a first behavior file",
    "check": "find what is wrong in behavior files",
    "compile": "show the prioritized clients that a behavior compiles to",
    "graph": "draw the network as SVG or DOT",
    "test": "run the tests that behavior files contain",
    "trace": "decide recorded frames, with any of the executors",
    "run": "drive the simulated robot through a building",
    "map": "draw a building",
}
"""Every command and what it is for; `colony/cli/NAME.py` has it as `command`."""


class Commands(click.Group):
    """A group that imports a command only when it is asked for, so that `colony --help` is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(f"colony.cli.{cmd_name}").command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if name not in COMMANDS and not name.startswith("-"):
            from difflib import get_close_matches

            close = get_close_matches(name, COMMANDS, n=1)
            hint = f"did you mean `{close[0]}`?" if close else f"the commands are {', '.join(COMMANDS)}"
            raise click.UsageError(f"no command `{name}`; {hint}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="colony")
def colony() -> None:
    """Reactive robot behavior: modules wired through suppressors and inhibitors, compiled, and run.

    \b
    Example:
      colony new patrol.colony
      colony test patrol.colony
      colony run patrol.colony --map maps/loop.stickrep
    """


def _report_failure(problem: Exception) -> int:
    """What a stage found wrong is reported as it stands; anything else is a bug, and raised."""
    from colony.cli.reporting import EXIT_ERRORS, report
    from colony.diagnostics import Failure

    if not isinstance(problem, Failure):
        raise problem
    report(problem.diagnostics)
    return EXIT_ERRORS


def main() -> None:
    """The console script."""
    try:
        code = colony.main(standalone_mode=False, prog_name="colony")
    except click.UsageError as problem:
        path = problem.ctx.command_path if problem.ctx else "colony"
        message = problem.format_message().replace("\n", " ").rstrip(".")
        click.echo(f"{path}: error: {message} (see `{path} --help`)", err=True)
        code = 2
    except click.ClickException as problem:
        click.echo(f"colony: error: {problem.format_message()}", err=True)
        code = 2
    except (click.Abort, KeyboardInterrupt):
        click.echo("colony: interrupted", err=True)
        code = 130
    except BrokenPipeError:  # whoever read our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except Exception as problem:
        code = _report_failure(problem)
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
