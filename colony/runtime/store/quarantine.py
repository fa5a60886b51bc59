"""Quarantine of damaged databases: each is renamed to `<name>.damaged-1` and so on, with its log beside it.

Nothing is deleted or overwritten. A quarantined database stays until a user removes it.
"""

from __future__ import annotations

import fcntl
import itertools
import os
from pathlib import Path

from colony.files import open_descriptor, sync_folder

BESIDE = ("-wal", "-journal", "-shm")
"""Suffixes of the files that SQLite keeps beside a database."""


def quarantine(path: Path) -> Path:
    """Rename a database and the files that SQLite keeps beside it, and return the new name.

    Raises:
        BlockingIOError: another process has the database open.
        OSError: a file cannot be renamed.
    """
    _expect_unused(path)
    for number in itertools.count(1):
        aside = path.with_name(f"{path.name}.damaged-{number}")
        if not any(os.path.lexists(_beside(aside, ending)) for ending in ("", *BESIDE)):
            break
    for ending in ("", *BESIDE):  # the database first: without its log it could pass for an intact one
        if os.path.lexists(_beside(path, ending)):
            os.rename(_beside(path, ending), _beside(aside, ending))
    sync_folder(path.parent)
    return aside


def quarantined(path: Path) -> tuple[Path, ...]:
    """Return the quarantined databases, including those of which only the log was left."""
    try:
        names = os.listdir(path.parent)
    except OSError:
        return ()
    prefix = f"{path.name}.damaged-"
    numbers = {name.removeprefix(prefix).partition("-")[0] for name in names if name.startswith(prefix)}
    return tuple(path.with_name(f"{prefix}{n}") for n in sorted(filter(str.isdecimal, numbers), key=int))


def damages(path: Path) -> tuple[str, ...]:
    """Return a sentence for users about each quarantined database, or its log if nothing else was left."""
    return tuple(
        f"its file was damaged, so it began with nothing; remove {_first_left(aside)} once nobody needs it"
        for aside in quarantined(path)
    )


def _first_left(aside: Path) -> Path:
    return next((file for e in ("", *BESIDE) if os.path.lexists(file := _beside(aside, e))), aside)


def _expect_unused(path: Path) -> None:
    """Raise BlockingIOError if another process holds SQLite's locks on the database."""
    try:
        descriptor = open_descriptor(path, os.O_RDWR)
    except FileNotFoundError:
        return
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        os.close(descriptor)


def _beside(path: Path, ending: str) -> Path:
    return path.with_name(path.name + ending)
