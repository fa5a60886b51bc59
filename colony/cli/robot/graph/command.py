"""`colony robot import`: a description of a robot that runs, from what it says of itself."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NoReturn

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.reporting import say
from colony.cli.robot.names import FOLDER, expect_free, robot_name, write_description

MAX_LISTED = 20
"""Maximum number of unused topics that are printed; the interface lists all."""


@click.group("import", no_args_is_help=False, short_help="describe a robot that runs ROS 2")
def import_command() -> None:
    """Describe a robot that runs, from what it says of itself.

    \b
    Example:
      colony robot import ros2 burger --setup /opt/ros/jazzy/setup.bash
    """


@import_command.command("ros2", short_help="from the running graph of ROS 2")
@click.argument("name", metavar="NAME")
@click.option("--python", metavar="PATH", help="The Python that has rclpy. [default: /usr/bin/python3]")
@click.option("--setup", metavar="PATH", help="The script that sets up the ROS environment.")
@click.option("--domain", type=click.IntRange(0, 232), help="The domain. [default: that of ROS_DOMAIN_ID]")
@click.option("--namespace", default="", help="The namespace of the robot. [default: all topics]")
@click.option(
    "--seconds",
    type=click.FloatRange(0.1, 600.0),
    default=3.0,
    show_default=True,
    help="How long to listen, so that slow topics are heard.",
)
@click.option(
    "-o",
    "folder",
    type=click.Path(file_okay=False, path_type=Path),
    metavar="FOLDER",
    default=FOLDER,
    show_default=True,
    help="Write FOLDER/NAME/NAME.colony and NAME.toml.",
)
def ros2_command(
    name: str, setup: str | None, python: str | None, domain: int | None, namespace: str, **options: Any
) -> None:
    """Write interface and body of a robot that runs ROS 2, with topics, units, ages and mountings.

    A node looks at the graph, reads a few messages, /tf_static and /robot_description, and publishes nothing.
    What no topic says is guessed; each guess has a comment. Existing files are never overwritten.

    Exit code: 0; 1 if the graph cannot be seen, or has no robot; 2 if NAME is invalid, or a file exists or
    cannot be written.

    \b
    Example:
      colony robot import ros2 burger --setup /opt/ros/jazzy/setup.bash
      colony robot check burger
    """
    robot_name(name)
    folder: Path = options["folder"] / name
    paths = {suffix: folder / f"{name}{suffix}" for suffix in (".colony", ".toml")}
    expect_free((*paths.values(), options["folder"] / f"{name}.colony"))
    from colony.cli.robot.graph.choice import choose
    from colony.cli.robot.graph.description import body_text, interface_text, unused_lines
    from colony.ros2.connection import BridgeError, NodeSettings
    from colony.ros2.survey import survey
    from colony.text.wording import counted

    given = {"setup": setup, "python": python, "domain": domain, "namespace": namespace.strip("/") or None}
    node = {key: value for key, value in given.items() if value is not None}
    settings = NodeSettings(setup=setup or "", python=python or "", domain=domain)
    try:
        topics = survey(settings, options["seconds"])
    except BridgeError as problem:
        _fail(f"cannot look at ROS 2: {problem} (--setup names the script of the ROS environment)")
    chosen = choose(topics, namespace)
    if not chosen.used:
        where = f"domain {os.environ.get('ROS_DOMAIN_ID', 0) if domain is None else domain}"
        where += f", namespace {namespace}" if namespace else ""
        found = counted(len(topics), "topic")
        _fail(f"no robot in {where}: found {found}, and neither a twist, an odometry nor a sensor among them")
    texts = {".colony": interface_text(chosen, name), ".toml": body_text(chosen, name, node)}
    write_description({path: texts[suffix] for suffix, path in paths.items()})
    described = name if options["folder"] == FOLDER else paths[".colony"]
    click.echo(f"wrote {' and '.join(map(str, paths.values()))}; try: colony robot check {described}")
    click.echo(f"uses {', '.join(chosen.relative(topic) for topic in chosen.used)}")
    for note in chosen.notes:
        click.echo(f"note: {note}")
    unused = unused_lines(chosen)
    if unused:
        more = f" and {len(unused) - MAX_LISTED} more" if len(unused) > MAX_LISTED else ""
        click.echo(f"does not use {', '.join(unused[:MAX_LISTED])}{more}")


def _fail(text: str) -> NoReturn:
    say(f"error: {text}")
    raise click.exceptions.Exit(EXIT_ERRORS)
