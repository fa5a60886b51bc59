"""New names, wherever the old one stands."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from colony.dsl.syntax_errors import RESERVED
from colony.editing.server.jobs import UsesAnswer
from colony.editing.server.protocol import TextEdit
from colony.editing.text import Lines


def new_name_problem(name: str) -> str | None:
    """Return why a name cannot be given; None if it can."""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        return f"`{name}` is no name: names are made of letters, digits and `_`"
    return f"`{name}` is a reserved word" if name in RESERVED else None


def rename_edit(
    answer: UsesAnswer, name: str, folders: Sequence[str], uri_of: Callable[[str], str]
) -> dict[str, Any] | str:
    """Return the edit that renames every use, or why it cannot be done.

    Files outside of the workspace, such as those that come with colony, stay as they are: a name that one of
    them uses cannot be renamed.
    """
    if answer.refusal:
        return answer.refusal
    if answer.kind in ("file", "test"):
        return f"`{answer.name}` is a file or a title, which is not renamed"
    changes: dict[str, list[TextEdit]] = {}
    for path, start, end in answer.uses:
        if not any(Path(path).is_relative_to(folder) for folder in folders):
            return f"`{answer.name}` stands in `{path}`, which is outside of the workspace"
        edit = TextEdit(Lines(answer.texts[path]).range(start, end), name)
        changes.setdefault(uri_of(path), []).append(edit)
    return {"changes": changes}
