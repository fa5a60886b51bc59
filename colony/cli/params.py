"""`colony params`: the tunable params of a behavior, or of the program that a robot runs."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.outputs import write_whole
from colony.cli.reporting import say
from colony.cli.robot_choice import robot_and_description_option
from colony.cli.robot_options import asking, connect_option, running_robot_options, security_option

if TYPE_CHECKING:
    from colony.runtime.kit.connection import Connection
    from colony.runtime.library.clock import TunedParam
    from colony.runtime.protocol.deployment import Tunable

CLOCK = "Clock"


@click.group(name="params", short_help="list and change tunable params while a robot runs")
def command() -> None:
    """List and change the tunable params of the program that a robot runs (docs/params.md).

    A change is in force in the next frame, for all modules at once. Contracts are proved for all values of
    the interval, so none has to be proved again. Values end with the run unless they are saved.

    Exit code: 0 on success, 1 if a value is outside of its interval, 2 for other mistakes and if the robot
    cannot be reached.

    \b
    Example:
      colony params list wander.colony
      colony params list
      colony params set avoid.clearance="0.7 m"
      colony params reset
      colony params save site.toml
    """


@command.command(name="list", short_help="list tunable params with values and intervals")
@click.argument("file", required=False)
@robot_and_description_option("The robot; required if several run. With FILE, the robot that it is for.")
@connect_option()
@security_option()
def list_params(file: str | None, robot: str | None, connect: str | None, security: Path | None) -> None:
    """List the tunable params of FILE, or without one, of the program that runs.

    A `*` marks values that were changed during the run.
    """
    if file is not None:
        from colony.cli.programs import compile_file
        from colony.runtime.protocol.deployment import tunables_of

        rows = [(t, t.initial) for t in tunables_of(compile_file(file).compiled.robot)]
    else:
        with _clock(robot, connect, security) as clock:
            rows = [(param.tunable, param.value) for param in _tunables(clock)]
    width = max((len(tunable.name) for tunable, _ in rows), default=0)
    values = [_text(tunable, value) for tunable, value in rows]
    value_width = max(map(len, values), default=0)
    for (tunable, value), text in zip(rows, values, strict=True):
        mark = "*" if value != tunable.initial else " "
        interval = f"{tunable.low:.9g} .. {_text(tunable, tunable.high)}"
        click.echo(f"{mark} {tunable.name:{width}}  {text:{value_width}}  in {interval}")
    if not rows:
        say("no tunable params")


@command.command(short_help="show the value of a param")
@click.argument("name")
@running_robot_options
def get(name: str, robot: str | None, connect: str | None, security: Path | None) -> None:
    """Show the value of the param NAME."""
    with _clock(robot, connect, security) as clock:
        param = _named(_tunables(clock), name)
    click.echo(_text(param.tunable, param.value))


@command.command(name="set", short_help="change params, all in one frame")
@click.argument("values", metavar="NAME=VALUE...", nargs=-1, required=True)
@running_robot_options
def set_values(
    values: tuple[str, ...], robot: str | None, connect: str | None, security: Path | None
) -> None:
    """Change params, all with the same frame. VALUE is a number in the declared unit, or with a unit.

    \b
    Example:
      colony params set avoid.clearance="0.7 m" roaming=200
    """
    from colony.runtime.library import clock as library

    with _clock(robot, connect, security) as clock:
        known = _tunables(clock)
        wanted: dict[str, float | None] = {}
        for text in values:
            name, equals, value = text.partition("=")
            if not equals:
                raise click.UsageError(f"found `{text}`; expected NAME=VALUE")
            wanted[name.strip()] = _number(_named(known, name.strip()).tunable, value.strip())
        k = clock.do(library.tune(wanted))
    click.echo(f"in force from frame {k}")


@command.command(short_help="go back to the values at the start of the run")
@click.argument("names", metavar="[NAME...]", nargs=-1)
@running_robot_options
def reset(names: tuple[str, ...], robot: str | None, connect: str | None, security: Path | None) -> None:
    """Go back to the values at the start of the run, of all params or of those named."""
    from colony.runtime.library import clock as library

    with _clock(robot, connect, security) as clock:
        known = _tunables(clock)
        found = [_named(known, name) for name in names] or known
        k = clock.do(library.tune({param.tunable.name: None for param in found}))
    click.echo(f"in force from frame {k}")


@command.command(short_help="write the values into a site's file")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path))
@running_robot_options
def save(file: Path, robot: str | None, connect: str | None, security: Path | None) -> None:
    """Write the values of all params that were changed into FILE, TOML for --params.

    Other lines of FILE stay as they are.
    """
    from colony.dsl.site_reading import SavedParamsError, saved_params

    with _clock(robot, connect, security) as clock:
        changed = {
            param.tunable.name: _text(param.tunable, param.value)
            for param in _tunables(clock)
            if param.value != param.tunable.initial
        }
    if not changed:
        say(f"nothing was changed; {file} stays as it is")
        return
    try:
        write_whole(file, saved_params(file, changed))
    except (OSError, SavedParamsError) as problem:
        raise click.ClickException(f"cannot write {file}: {problem}") from None
    click.echo(f"wrote {', '.join(changed)} into {file}")


def _text(tunable: Tunable, value: float) -> str:
    number = repr(float(f"{value:.15g}")) if float(f"{value:.15g}") == value else repr(value)
    number = number.removesuffix(".0")
    return f"{number} {tunable.unit}" if tunable.unit else number


def _number(tunable: Tunable, text: str) -> float:
    """Return a number in the declared unit of a param."""
    from colony.runs.scenario import parse_number
    from colony.text.units import NUMBER, parse_unit

    unit = parse_unit(tunable.unit) if tunable.unit else None
    value = parse_number(
        text, NUMBER if unit is None else unit.dimension, 1.0 if unit is None else float(unit.factor)
    )
    if value is None:
        expected = f"a number in {tunable.unit}" if tunable.unit else "a number"
        raise click.ClickException(f"`{tunable.name}`: found `{text}`; expected {expected}")
    return value


def _named(params: Iterable[TunedParam], name: str) -> TunedParam:
    from colony.ir.fitting import name_hint

    known = {param.tunable.name: param for param in params}
    if name not in known:
        hint = name_hint(name, known) if known else "it has none"
        raise click.ClickException(f"the program has no tunable param `{name}`; {hint}")
    return known[name]


def _tunables(clock: Connection) -> tuple[TunedParam, ...]:
    from colony.runtime.library import clock as library

    return clock.do(library.tunables())


def _clock(
    robot: str | None, connect: str | None, security: Path | None
) -> AbstractContextManager[Connection]:
    return asking(robot, connect, security, CLOCK, name="colony params")
