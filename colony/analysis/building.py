"""Building the index of a recording: the interpreter follows it once, from its first frame to its last."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from hashlib import blake2b
from pathlib import Path
from typing import BinaryIO

from colony.analysis.follower import Follower
from colony.analysis.index import MAX_BYTES, Index, Mark, Sections, StaleIndexError, decode, encode
from colony.analysis.tracks import TrackWriter
from colony.files import keep_in_cache, read_from_cache, user_cache
from colony.ir.program import Program
from colony.runtime.recordings.recorded import RecordingReader
from colony.text.wording import time_text

INTERVAL_NS = 5_000_000_000
"""Least time between two marks, in the time of the run."""


def build_index(
    program: Program,
    reader: RecordingReader,
    progress: Callable[[], None] = lambda: None,
    *,
    interval_ns: int = INTERVAL_NS,
) -> Index:
    """Follow a whole recording, and return its index; `progress` is called after each frame.

    Marks are at least `interval_ns` apart.

    Raises:
        DiagnosticError: the recording is of another program, or cannot be read.
    """
    follower, tracks, sections = Follower(program), TrackWriter(), Sections()
    marks: list[Mark] = []
    damaged: list[str] = []
    frames, first_ns, last_ns = 0, 0, 0
    for recorded in reader.frames(program):
        t_ns = recorded.frame.t_ns
        if recorded.damaged:
            before_ns = t_ns - (first_ns if frames else t_ns)
            damaged.append(_span(last_ns - first_ns if frames else None, before_ns))
        is_due = not marks or t_ns - marks[-1].t_ns >= interval_ns
        if recorded.place is not None and is_due and frames and not recorded.damaged:
            section, checksum = sections.add(follower.checkpoint)
            marks.append(
                Mark(t_ns=t_ns, k=recorded.tick.k, place=recorded.place, section=section, checksum=checksum)
            )
        tracks.take(recorded, follower.take(recorded))
        first_ns, last_ns, frames = (first_ns if frames else t_ns), t_ns, frames + 1
        progress()
    if reader.damaged:
        damaged.append(_span(last_ns - first_ns if frames else None, None))
    return Index(
        frames=frames,
        first_ns=first_ns,
        last_ns=last_ns,
        truncation=reader.truncation,
        remarks=tuple(reader.remarks),
        damaged=tuple(damaged),
        tracks=tracks.tracks,
        marks=tuple(marks),
        sections=bytes(sections),
    )


def _span(after_ns: int | None, before_ns: int | None) -> str:
    start = "from its beginning" if after_ns is None else f"from {time_text(after_ns)}"
    return f"{start} {'to its end' if before_ns is None else f'to {time_text(before_ns)}'}"


# --- the cache -------------------------------------------------------------------------------------


def cached_index(path: Path | None) -> Index | None:
    """Return the index in a file of the cache, None if there is none that can be used."""
    if path is None:
        return None
    try:
        return decode(read_from_cache(path, MAX_BYTES))
    except (OSError, StaleIndexError):
        return None


def keep_index(path: Path | None, index: Index) -> str | None:
    """Write an index into the cache; return why it could not be written."""
    if path is None:
        return "there is no folder for the cache: neither XDG_CACHE_HOME nor HOME is set"
    try:
        keep_in_cache(path, encode(index))
    except OSError as problem:
        return problem.strerror or str(problem)
    return None


def index_path(recording: BinaryIO, program: Program, environment: Mapping[str, str]) -> Path | None:
    """Return where the index of a recording is in the user's cache, by the content of both."""
    folder = user_cache(environment, "moments")
    return None if folder is None else folder / f"{_content(recording)}-{_meaning(program)}.index"


def _content(file: BinaryIO) -> str:
    """Return a hash of the whole file; its position stays where it is."""
    position, hashed = file.tell(), blake2b(digest_size=16)
    file.seek(0, os.SEEK_SET)
    while block := file.read(1 << 20):
        hashed.update(block)
    file.seek(position)
    return hashed.hexdigest()


def _meaning(program: Program) -> str:
    """Return a hash of the texts of a program, and of the params that a site set."""
    site = None if program.site is None else program.site.values
    about = [[name, source.text] for name, source in program.files]
    return blake2b(json.dumps([about, site]).encode(), digest_size=16).hexdigest()
