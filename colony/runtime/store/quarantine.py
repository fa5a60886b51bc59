"""Quarantine of damaged databases: each is renamed to `<name>.damaged-1` and so on, together with its log.

Nothing is deleted or overwritten. A quarantined database stays until a user removes it.
"""

from __future__ import annotations

import fcntl
import itertools
import os
from pathlib import Path

from colony.files import open_descriptor, sync_folder

COMPANION_SUFFIXES = ("-wal", "-journal", "-shm")
"""Suffixes of the files that SQLite keeps in addition to a database."""


def quarantine(path: Path) -> Path:
    """Rename a database and its companion files, and return the new name.

    Raises:
        BlockingIOError: another process has the database open.
        OSError: a file cannot be renamed.
    """
    _check_unused(path)
    for number in itertools.count(1):
        quarantined_path = path.with_name(f"{path.name}.damaged-{number}")
        if not any(
            os.path.lexists(_with_suffix(quarantined_path, suffix)) for suffix in ("", *COMPANION_SUFFIXES)
        ):
            break
    for suffix in ("", *COMPANION_SUFFIXES):  # database first: without its log, it could look intact
        if os.path.lexists(_with_suffix(path, suffix)):
            os.rename(_with_suffix(path, suffix), _with_suffix(quarantined_path, suffix))
    sync_folder(path.parent)
    return quarantined_path


def list_quarantined(path: Path) -> tuple[Path, ...]:
    """Return the quarantined databases, including those of which only the log is left."""
    try:
        names = os.listdir(path.parent)
    except OSError:
        return ()
    prefix = f"{path.name}.damaged-"
    numbers = {name.removeprefix(prefix).partition("-")[0] for name in names if name.startswith(prefix)}
    return tuple(path.with_name(f"{prefix}{n}") for n in sorted(filter(str.isdecimal, numbers), key=int))


def damage_notes(path: Path) -> tuple[str, ...]:
    """Return a sentence for users about each quarantined database, or its log if nothing else is left."""
    return tuple(
        f"its file was damaged, so it started empty; remove {_first_existing(damaged)} when it is not needed"
        for damaged in list_quarantined(path)
    )


def _first_existing(quarantined_path: Path) -> Path:
    return next(
        (
            file
            for suffix in ("", *COMPANION_SUFFIXES)
            if os.path.lexists(file := _with_suffix(quarantined_path, suffix))
        ),
        quarantined_path,
    )


def _check_unused(path: Path) -> None:
    """Raise BlockingIOError if another process holds SQLite's locks on the database."""
    try:
        descriptor = open_descriptor(path, os.O_RDWR)
    except FileNotFoundError:
        return
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    finally:
        os.close(descriptor)


def _with_suffix(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)
