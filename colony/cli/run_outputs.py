"""What a run leaves behind besides its summary: checked before it begins, drawn after it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from colony.cli.outputs import check_output, write_whole
from colony.cli.run_options import BadOption

if TYPE_CHECKING:
    from colony.nav.stickrep import Map


def check_outputs(record: str | None, picture: str | None, inputs: Iterable[str]) -> None:
    """Refuse, before a long run, what could not be written after it, or what would overwrite its input.

    Raises:
        BadOption: the picture has no format, or both would be one file.
        click.exceptions.Exit: a file cannot be written, which has been said.
    """
    if picture is not None:
        from colony.view.map_picture import picture_format

        try:
            picture_format(picture)
        except ValueError as problem:
            raise BadOption(f"--picture: {problem}") from None
        if record is not None and os.path.realpath(record) == os.path.realpath(picture):
            raise BadOption(f"--record and --picture: found `{picture}` for both; expected two files")
    for path in (record, picture):
        if path is not None:
            check_output(path, list(inputs))


def draw_way(building: Map, places: Iterable[tuple[float, float]], robot: str, path: str) -> None:
    """The building with the way of a robot, as a picture."""
    import numpy as np

    from colony.view.map_picture import draw_map, encode_picture, picture_format

    way = np.array(list(places), dtype=np.float64).reshape(-1, 2)
    picture = draw_map(building, [way], names=[robot])
    write_whole(Path(path), encode_picture(picture, picture_format(path)))
