"""The output files of a run: checked before the run, and drawn after it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from colony.cli.outputs import check_output, write_whole
from colony.cli.run.options import OptionError

if TYPE_CHECKING:
    from colony.robots.request import RunReport


def check_outputs(record: str | None, picture: str | None, inputs: Iterable[str]) -> None:
    """Refuse, before a long run, an output that cannot be written or would overwrite its input.

    Raises:
        OptionError: the picture has no format, or both outputs are the same file.
        click.exceptions.Exit: a file cannot be written, which has been reported.
    """
    if picture is not None:
        from colony.view.map_picture import picture_format

        try:
            picture_format(picture)
        except ValueError as problem:
            raise OptionError(f"--picture: {problem}") from None
        if record is not None and os.path.realpath(record) == os.path.realpath(picture):
            raise OptionError(f"--record and --picture: found `{picture}` for both; expected two files")
    for path in (record, picture):
        if path is not None:
            check_output(path, list(inputs))


def draw(result: RunReport, robot: str, path: str) -> RunReport:
    """Draw each floor with the robots' paths: the first floor into `path`, each other one into a file beside
    it.

    The other files are named after their floors: run.png and run.msu_engineering_2.png. The returned result
    lists them. If a picture cannot be written, that has been reported, and the result lists it as unwritten.
    """
    import numpy as np

    from colony.view.map_picture import draw_world, encode_picture, picture_format

    target = Path(path)
    others: list[str] = []
    for number, floor in enumerate(result.floors):
        path_xy = np.array(result.paths.get(floor.name, ()), dtype=np.float64).reshape(-1, 2)
        paths = [path_xy, *(np.array(path, dtype=np.float64) for path in result.other_paths.values())]
        people = [np.array(path) for path in result.people.get(floor.name, ())]
        picture = draw_world(floor, paths, names=[robot, *result.other_paths], people=people)
        file = target if number == 0 else target.with_suffix(f".{floor.name}{target.suffix}")
        try:
            write_whole(file, encode_picture(picture, picture_format(path)))
        except click.exceptions.Exit:
            return result._replace(summary=replace(result.summary, unwritten=(path,)))
        others += [str(file)] if number else []
    if result.mission_result is None:
        return result
    return result._replace(mission_result=result.mission_result._replace(pictures=tuple(others)))
