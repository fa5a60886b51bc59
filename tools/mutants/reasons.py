"""Why survivors change nothing: `survivors.toml`, by module.

Each entry has the `path` of a module, `why`, and the `mutants` that it explains, by their keys. An entry of
`[[everywhere]]` has a `was` and a `now` instead, regular expressions for the changed lines in any module.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tools.mutants.mutation import Mutant

FILE = Path(__file__).parent / "survivors.toml"


@dataclass(frozen=True, slots=True)
class Reasons:
    """By module and key, and for changes of a kind wherever they are."""

    of: dict[tuple[str, str], str] = field(default_factory=dict)
    everywhere: tuple[tuple[re.Pattern[str], re.Pattern[str], str], ...] = ()

    def why(self, mutant: Mutant) -> str | None:
        """Why this mutant changes nothing, if that is known."""
        known = self.of.get((mutant.path, mutant.key))
        if known is not None:
            return known
        for was, now, why in self.everywhere:
            if was.search(mutant.was) and now.search(mutant.now):
                return why
        return None

    def stale(self, survivors: list[Mutant], tried: list[Mutant]) -> Iterator[str]:
        """Entries for mutants that are killed, or that are no mutants any more, in the modules tried."""
        surviving = {(m.path, m.key) for m in survivors}
        paths = {m.path for m in tried}
        for path, key in self.of:
            if path in paths and (path, key) not in surviving:
                yield f"{path}: {key}"


def load(file: Path = FILE) -> Reasons:
    data = tomllib.loads(file.read_text())
    of = {(one["path"], key): one["why"] for one in data.get("survivor", ()) for key in one["mutants"]}
    kinds = ((re.compile(k["was"]), re.compile(k["now"]), k["why"]) for k in data.get("everywhere", ()))
    return Reasons(of, tuple(kinds))
