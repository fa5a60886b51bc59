"""`colony help`: the explanation of an error code, or the help text of a command."""

from __future__ import annotations

import re

import click

from colony.shipped import errors_page
from colony.text.units import BASE_UNITS
from colony.text.wording import did_you_mean

_SECTION = re.compile(r"^### (([A-Z]\d{3}): .*\n(?:(?!^##).*\n?)*)", re.MULTILINE)
"""A section of docs/errors.md: the code in its heading, and the text up to the next heading."""


@click.command("help", short_help="explain an error code or a command")
@click.argument("topic", required=False, metavar="[CODE|COMMAND]")
@click.pass_context
def command(context: click.Context, topic: str | None) -> None:
    """Explain the code of an error or warning: its cause, an example, and what to do.

    With the name of a command, show the help text of the command.

    \b
    Example:
      colony help E201
      colony help run
    """
    from colony.cli.main import COMMANDS, colony
    from colony.dsl.parser import CONTEXTUAL_KEYWORDS
    from colony.dsl.syntax_errors import RESERVED
    from colony.ir.expression import Function, MemoryFunction

    if topic is None:
        click.echo(colony.get_help(context.find_root()))
        return
    if topic in COMMANDS:
        found = colony.get_command(context, topic)
        assert found is not None
        with click.Context(found, info_name=topic, parent=context.find_root()) as inner:
            click.echo(found.get_help(inner))
        return
    sections = {code: text for text, code in _SECTION.findall(errors_page())}
    section = sections.get(topic.upper())
    if section is None:
        functions = (function.value for function in (*Function, *MemoryFunction))
        keywords = ("any", *RESERVED, *(keyword.lower() for keyword in CONTEXTUAL_KEYWORDS))
        if topic in (*BASE_UNITS, *keywords, *functions):
            raise click.UsageError(f"`{topic}` is a word of the language: see docs/language.md", context)
        hint = did_you_mean(topic.upper(), sections) or did_you_mean(topic, COMMANDS)
        message = f"no code or command `{topic}`; {hint or 'for words of the language see docs/language.md'}"
        raise click.UsageError(message, context)
    click.echo(section.rstrip())
