"""The params that a site sets, from the option `--params FILE`.

They are kept in the context of the command, where everything that reads a behavior finds them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import click

if TYPE_CHECKING:
    from colony.dsl.site import SiteParams

F = TypeVar("F", bound=Callable[..., object])

_CHOICE = "colony.params"


def params_option(more: str = "") -> Callable[[F], F]:
    """Return the option `--params FILE` of a command that reads behaviors; `more` is added to its help."""
    help = "Set params of the behavior to the values in this TOML file, in place of those in its text."
    return click.option(
        "--params",
        metavar="SITE.toml",
        callback=_choose,
        expose_value=False,
        help=f"{help} {more}".rstrip(),
    )


def chosen_params() -> SiteParams | None:
    """Return the params that the option of the current command sets, None without it."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.meta.get(_CHOICE)


def choose_params(params: SiteParams | None) -> None:
    """Let these params, such as those of a recording, be the chosen ones, unless the option chose others."""
    if chosen_params() is None:
        click.get_current_context().meta[_CHOICE] = params


def _choose(context: click.Context, option: click.Parameter, path: str | None) -> None:
    if path is None:
        return
    from colony.dsl.site_reading import read_params

    context.meta[_CHOICE] = read_params(path)
