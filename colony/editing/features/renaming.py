"""New names, wherever the old one stands."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from colony.dsl.syntax_errors import RESERVED
from colony.editing.index import Index
from colony.editing.server.jobs import UsesAnswer
from colony.editing.server.protocol import TextEdit
from colony.editing.text import Lines, lexemes


def new_name_problem(name: str) -> str | None:
    """Return why a name cannot be given; None if it can."""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        return f"`{name}` is no name: names are made of letters, digits and `_`"
    return f"`{name}` is a reserved word" if name in RESERVED else None


def renaming_problem(
    answer: UsesAnswer,
    name: str,
    programs: Sequence[Index],
    analyze: Callable[[str, Mapping[str, str]], Index],
) -> str:
    """Return why a new name cannot stand at all uses; "" if it can.

    It is tried in memory: no program may get an error, and each name has to mean what it meant.

    Args:
        answer: The uses of the old name.
        name: The new name.
        programs: Every program that has one of the uses, or that may see the new name.
        analyze: Makes the index of a file, with texts in place of some files.
    """
    path = _unread(answer, programs)
    if path is not None:
        return f"`{answer.name}` stands in `{path}` where its errors keep it from being read: mend them first"
    starts: dict[str, list[int]] = {}
    for path, start, _ in sorted(answer.uses):
        starts.setdefault(path, []).append(start)
    texts = {path: _renamed(answer.texts[path], found, answer.name, name) for path, found in starts.items()}
    growth = len(name) - len(answer.name)

    def moved(path: str, offset: int) -> int:
        return offset + growth * bisect_left(starts.get(path, ()), offset)

    for program in programs:
        after = analyze(program.root.path, texts)
        errors = _errors(after) - _errors(program)
        if errors:
            path, code = next(iter(errors))
            messages = (
                f.message
                for file in after.files
                if file.path == path
                for f in file.findings
                if f.code == code
            )
            return f"`{name}` is an error in `{path}`: {next(messages).splitlines()[0]}"
        changed = _meanings(after, lambda _, offset: offset) ^ _meanings(program, moved)
        if changed:
            path, start, *_ = min(changed)
            found = after.file(path)
            line = Lines("" if found is None else found[1].text).position(start).line + 1
            return f"`{name}` has another meaning in `{path}`, line {line}"
    return ""


def _unread(answer: UsesAnswer, programs: Sequence[Index]) -> str | None:
    """Return a file with errors in which the name stands and is no use of anything."""
    used: dict[str, set[int]] = {}
    broken: dict[str, str] = {}
    for file in (file for program in programs for file in program.files):
        used.setdefault(file.path, set()).update(start for start, _, _ in file.uses)
        if any(finding.severity == "error" for finding in file.findings):
            broken[file.path] = file.text
    for path, text in broken.items():
        before: list[str] = ["", "", ""]
        for lexeme in lexemes(text):
            is_of_server = before[-1] == "." and before[-3] in ("from", "to")
            if lexeme[:2] == ("word", answer.name) and lexeme.start not in used[path] and not is_of_server:
                return path
            before.append(lexeme.text)
    return None


def _renamed(text: str, starts: Sequence[int], old: str, new: str) -> str:
    pieces = [text[: starts[0]]]
    for start, following in zip(starts, [*starts[1:], len(text)], strict=True):
        pieces += [new, text[start + len(old) : following]]
    return "".join(pieces)


def _errors(program: Index) -> Counter[tuple[str, str]]:
    """Return how many errors of each code each file has."""
    return Counter((f.path, x.code) for f in program.files for x in f.findings if x.severity == "error")


def _meanings(program: Index, moved: Callable[[str, int], int]) -> set[tuple[str, int, int, str, str, int]]:
    """Return the place of each name, with the kind and the place of its declaration."""
    found: set[tuple[str, int, int, str, str, int]] = set()
    for file in program.files:
        for start, end, number in file.uses:
            declared = program.declarations[number]
            home = program.files[declared.file].path
            place = moved(file.path, start), moved(file.path, end)
            found.add((file.path, *place, declared.kind, home, moved(home, declared.start)))
    return found


def rename_edits(answer: UsesAnswer, name: str, folders: Sequence[str]) -> dict[str, list[TextEdit]] | str:
    """Return the edits that rename every use, by path, or why it cannot be done.

    Files outside of the workspace, such as those that come with colony, stay as they are: a name that one of
    them uses cannot be renamed.
    """
    if answer.kind in ("file", "test"):
        return f"`{answer.name}` is a file or a title, which is not renamed"
    edits: dict[str, list[TextEdit]] = {}
    for path, start, end in answer.uses:
        if not any(Path(path).is_relative_to(folder) for folder in folders):
            return f"`{answer.name}` stands in `{path}`, which is outside of the workspace"
        edits.setdefault(path, []).append(TextEdit(Lines(answer.texts[path]).range(start, end), name))
    return answer.refusal or edits
