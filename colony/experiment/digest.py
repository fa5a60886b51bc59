"""A digest of all that the results of an experiment depend on, apart from its settings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from hashlib import sha256
from pathlib import Path

from colony.execute.colonyc import encode
from colony.execute.compiled import Compiled
from colony.files import StrPath

PACKAGE = Path(__file__).parents[1]


def digest_of(programs: Sequence[Compiled], maps: Iterable[StrPath]) -> str:
    """Return a digest of programs with their sources, of the files of a map, and of colony itself."""
    digest = sha256()
    for program in programs:
        digest.update(encode(program))
    for path in maps:
        digest.update(Path(path).read_bytes())
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
