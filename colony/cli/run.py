"""`colony run`: compile a program and run it on a simulated robot, frame by frame, by the real roles."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout

import click

from colony.cli.exit_codes import EXIT_ERRORS, EXIT_INTERRUPTED, EXIT_MISUSE
from colony.cli.reporting import load_program, refuse, report, say


@click.command(name="run", short_help="drive the simulated robot through a building")
@click.argument("file", metavar="FILE")
@click.option("--map", "map_path", required=True, metavar="MAP", help="The building, a StickRep map.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Of chance and of the sensors' noise.",
)
@click.option("--duration", default="60", show_default=True, metavar="TIME", help="As 60, 90s or 2min.")
@click.option("--realtime", is_flag=True, help="As fast as the wall clock, not as fast as possible.")
@click.option("--record", metavar="PATH", help="Write every frame there, one JSON object a line.")
@click.option(
    "--picture", default="run.png", show_default=True, metavar="PATH", help="PNG or SVG of the way."
)
@click.option("--no-picture", is_flag=True, help="Draw nothing.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="Hold a variable of DServer, as if an operator kept setting it. May be repeated.",
)
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(
    file: str,
    map_path: str,
    seed: int,
    duration: str,
    realtime: bool,
    record: str | None,
    picture: str,
    no_picture: bool,
    settings: tuple[str, ...],
    format_: str,
) -> None:
    """Run a behavior on a robot that is simulated in the building of a map.

    In the end it tells who drove how long, how far the robot came, what it bumped into, which contracts
    broke, and draws its way. The same seed gives the same run. Ctrl-C stops the robot, closes the
    recording and still tells what was run.

    Exit code 0 where all contracts held, 1 where one was broken or the program has errors, 2 for misuse, 130
    after Ctrl-C.

    \b
    Example:
      colony run behaviors/wander.colony --map maps/loop.stickrep --duration 2min --seed 1
      colony run behaviors/wander.colony --map maps/loop.stickrep --record run.jsonl
      colony run behaviors/teleop.colony --map maps/loop.stickrep --realtime --set TeleopVelocity=200
    """
    import json

    from colony.diagnostics import Failure

    program = load_program(file)
    from colony.cli.run_options import BadOption
    from colony.cli.run_progress import told_if_slow

    with told_if_slow("compiling the simulator: some seconds, once where the result can be kept"):
        from colony.cli.run_simulated import Misuse, Options, run
    from colony.runtime.summary import render

    drawn = None if no_picture else picture
    options = Options(
        file=file,
        map_path=map_path,
        seed=seed,
        duration=duration,
        realtime=realtime,
        record=record,
        picture=drawn,
        settings=settings,
    )
    try:
        with redirect_stdout(sys.stderr):  # for what modules in Python print
            summary = run(program, options)
    except BadOption as bad:
        raise click.UsageError(str(bad), click.get_current_context()) from None
    except Misuse as misuse:
        say(str(misuse))
        raise click.exceptions.Exit(EXIT_MISUSE) from None
    except Failure as failure:
        if failure.diagnostics[0].code.startswith("M"):
            refuse(failure.diagnostics)
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_ERRORS) from None
    if format_ == "json":
        click.echo(json.dumps(summary.as_json() | {"recording": record, "picture": drawn}, indent=2))
    else:
        click.echo(render(summary))
        for path in (record, drawn):
            if path is not None:
                click.echo(f"  wrote {path}")
    if not summary.sound:
        raise click.exceptions.Exit(EXIT_ERRORS)
    if summary.interrupted:
        raise click.exceptions.Exit(EXIT_INTERRUPTED)
