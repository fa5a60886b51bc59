"""The robot that a behavior is for, from the option `--robot NAME[=DESCRIPTION]`.

The description, by default the one called NAME, is what `import robot` brings in. The choice is kept in the
context of the command, where everything that reads a behavior finds it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

if TYPE_CHECKING:
    from colony.dsl.descriptions import RobotChoice
    from colony.ir.program import Robot

F = TypeVar("F", bound=Callable[..., object])

DESCRIPTION_FORM = "NAME[=DESCRIPTION]"

_HELP = (
    "The robot that `import robot` brings in: the name of a description that comes with colony or is in the "
    "folder robots of the project, or a path. [default: that of the project's colony.toml or pyproject.toml; "
    "rome for a behavior that comes with colony]"
)
_CHOICE = "colony.robot"


def description_option() -> Callable[[F], F]:
    """Return the option `--robot NAME[=DESCRIPTION]` of a command that reads behaviors."""
    return click.option(
        "--robot",
        multiple=True,
        metavar=DESCRIPTION_FORM,
        callback=_store_choice,
        expose_value=False,
        help=_HELP,
    )


def repeated_description_option() -> Callable[[F], F]:
    """Return the option `--robot NAME[=DESCRIPTION]`, which may be repeated, as `robots`: choices by name."""
    return click.option(
        "--robot",
        "robots",
        multiple=True,
        metavar=DESCRIPTION_FORM,
        callback=_choices_by_name,
        help=f"{_HELP} May be repeated, to check against each.",
    )


def robot_and_description_option(help: str, *, required: bool = False) -> Callable[[F], F]:
    """Return the option `--robot NAME[=DESCRIPTION]` of a command that addresses `robot` by its name.

    NAME need not be the name of a description; the project's description is then used.
    """
    return click.option(
        "--robot",
        multiple=True,
        required=required,
        metavar=DESCRIPTION_FORM,
        callback=_store_choice_and_return_name,
        help=help,
    )


def robot_and_description_argument() -> Callable[[F], F]:
    """Return the argument `ROBOT`, NAME[=DESCRIPTION], of a command that makes `robot` run itself."""

    def store(context: click.Context, argument: click.Parameter, text: str) -> str | None:
        return _store_choice_and_return_name(context, argument, (text,))

    return click.argument("robot", metavar="ROBOT", callback=store)


def chosen_robot() -> RobotChoice | None:
    """Return the description that the options of the current command choose, None if they choose none."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.meta.get(_CHOICE)


def say_whose_name(robot: Robot) -> None:
    """Say if a simulated robot is called like no description, or like another one: it may be a slip."""
    from colony.cli.reporting import say
    from colony.dsl.descriptions import find_in_project, known_descriptions
    from colony.text.wording import did_you_mean

    choice = chosen_robot()
    if choice is None or not choice.is_name or choice.text == robot.name:
        return
    found = find_in_project(choice.text, Path())
    if found is None:
        hint = did_you_mean(choice.text, known_descriptions(Path()))
        text = f"`{choice.text}` is no description, but the name of the robot, a {robot.name}"
        say(f"{text}; {hint}" if hint else text)
    elif found.resolve() != Path(robot.span.source.name).resolve():
        text = f"`{choice.text}` is only the name of the robot here: the behavior itself imports {robot.name}"
        say(f"{text}; with `import robot`, --robot chooses the description")


def _only(context: click.Context, option: click.Parameter, texts: tuple[str, ...]) -> str | None:
    """Return the text of an option that is given at most once."""
    if len(texts) > 1:
        message = f"given {len(texts)} times, but this is for one robot; `colony check` takes several"
        raise click.BadParameter(message, context, option)
    return texts[0] if texts else None


def _store_choice(context: click.Context, option: click.Parameter, texts: tuple[str, ...]) -> None:
    text = _only(context, option, texts)
    context.meta[_CHOICE] = None if text is None else _parse_choice(context, option, text)


def _choices_by_name(
    context: click.Context, option: click.Parameter, texts: tuple[str, ...]
) -> dict[str, RobotChoice]:
    found: dict[str, RobotChoice] = {}
    for text in texts:
        name = text.partition("=")[0]
        found[text if name in found else name] = _parse_choice(context, option, text)
    return found


def _parse_choice(context: click.Context, option: click.Parameter, text: str) -> RobotChoice:
    from colony.dsl.descriptions import RobotChoice

    name, has_description, description = text.partition("=")
    if not name or (has_description and not description):
        message = f"found `{text}`; expected {DESCRIPTION_FORM}, such as amr or lab=robots/amr.colony"
        raise click.BadParameter(message, context, option)
    return RobotChoice(text=description or name, origin=f"--robot {text}")


def _store_choice_and_return_name(
    context: click.Context, option: click.Parameter, texts: tuple[str, ...]
) -> str | None:
    text = _only(context, option, texts)
    if text is None:
        return None
    name = check_robot_name(context, option, text.partition("=")[0])
    choice = _parse_choice(context, option, text)
    context.meta[_CHOICE] = choice if "=" in text else replace(choice, is_name=True)
    return name


def check_robot_name(context: click.Context, option: click.Parameter, name: str | None) -> str | None:
    """Return the name of a robot as it is; report one that is invalid."""
    from colony.runtime.transport.live.run_directory import check_name

    try:
        return None if name is None else check_name("robot", name)
    except ValueError as problem:
        raise click.BadParameter(str(problem), context, option) from None
