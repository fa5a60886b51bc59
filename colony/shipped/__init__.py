"""The behaviors and maps that come with colony, by name: `wander`, `loop`.

They are at the top of the repository, and in a wheel in this folder.
"""

from __future__ import annotations

import os
from enum import Enum, unique
from pathlib import Path

from colony.text.suggestions import did_you_mean

_HERE = Path(__file__).parent
_FOLDER = _HERE if (_HERE / "behaviors").is_dir() else _HERE.parents[1]


def errors_page() -> str:
    """Return docs/errors.md: each code, when it is reported and what to do."""
    return (_HERE / "errors.md" if _FOLDER == _HERE else _FOLDER / "docs" / "errors.md").read_text("utf-8")


def is_file(path: str | os.PathLike[str]) -> bool:
    """Whether there is something at `path` to be read: no folder, but perhaps a link that leads nowhere."""
    return os.path.lexists(path) and not os.path.isdir(path)


@unique
class Shipped(Enum):
    """A kind of file that is shipped: its folder and the suffix of its files."""

    BEHAVIOR = ("behaviors", ".colony")
    MAP = ("maps", ".stickrep")

    @property
    def folder(self) -> Path:
        return _FOLDER / self.value[0]

    @property
    def suffix(self) -> str:
        return self.value[1]

    def names(self) -> list[str]:
        """Return the names of all files of this kind, in alphabetical order."""
        return sorted(path.stem for path in self.folder.glob(f"*{self.suffix}"))

    def path(self, name: str) -> Path:
        """Return the file of this name, which is one of `names()`."""
        return self.folder / f"{name}{self.suffix}"

    def find(self, given: str) -> str:
        """Return `given` if there is such a file, else the path of the shipped file with this name, if any.

        Where there is neither, `given` is returned as it is, and reading it says what is wrong.
        """
        named = None if is_file(given) else self.named(given)
        return given if named is None else str(named)

    def named(self, name: str, folder: Path | None = None) -> Path | None:
        """Return the file with this name, `wander` or `wander.colony`; None where there is none.

        It is looked for in `folder`, where that is given, in place of what comes with colony.
        """
        path = (folder or self.folder) / f"{name.removesuffix(self.suffix)}{self.suffix}"
        return path if os.path.basename(name) == name and os.path.isfile(path) else None

    def hint(self, given: str) -> str | None:
        """Return what to try in place of `given`, which was not found; None where nothing is like it."""
        return did_you_mean(Path(given).stem, self.names())
