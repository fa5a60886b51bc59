"""Where a name is declared, and where it is used in this file."""

from __future__ import annotations

from typing import Any

from colony.editing.open_file import OpenFile
from colony.editing.text import TextPosition


def definition(file: OpenFile, position: TextPosition) -> Any:
    """Return the place of the declaration of the name at a position; of an import, the file."""
    use = file.use_at(position)
    if use is None:
        return None
    declared = file.declaration(use[1])
    place = file.place_in(declared.file, declared.start, declared.end)
    return None if place is None else {"uri": place[0], "range": place[1]}


def highlights(file: OpenFile, position: TextPosition) -> Any:
    """Return the ranges of this file with the name at a position."""
    use = file.use_at(position)
    if use is None:
        return []
    places = (file.place(start, end) for start, end, number in file.file.uses if number == use[1])
    return [{"range": place} for place in places if place is not None]
