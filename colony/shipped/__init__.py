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


@unique
class Shipped(Enum):
    """A kind of file that is shipped: its folder and the suffix of its files."""

    BEHAVIOR = ("behaviors", ".colony")
    MAP = ("maps", ".stickrep")

    @property
    def folder(self) -> Path:
        """The folder of the files of this kind."""
        return _FOLDER / self.value[0]

    @property
    def suffix(self) -> str:
        """The suffix of the files of this kind."""
        return self.value[1]

    def names(self) -> list[str]:
        """Return the names of all files of this kind, in alphabetical order."""
        return sorted(path.stem for path in self.folder.glob(f"*{self.suffix}"))

    def path(self, name: str) -> Path:
        """Return the file of this name, which is one of `names()`."""
        return self.folder / f"{name}{self.suffix}"

    def find(self, given: str) -> str:
        """Return where the file is: at the path `given`, with or without its suffix, or the shipped one.

        Where there is none, `given` is returned as it is, and reading it says what is wrong.
        """
        own = self.own(given)
        return own if own is not None else str(self.named(given) or given)

    def own(self, given: str | os.PathLike[str]) -> str | None:
        """Return the path of a user's own file, `given` or that with the suffix; None where there is none.

        A folder is no file; a link that leads nowhere is one, which cannot be read.
        """
        paths = (os.fspath(given), f"{os.fspath(given)}{self.suffix}")
        return next((path for path in paths if os.path.lexists(path) and not os.path.isdir(path)), None)

    def named(self, name: str, folder: Path | None = None) -> Path | None:
        """Return the file with this name, `wander` or `wander.colony`; None where there is none.

        It is looked for in `folder`, where that is given, in place of what comes with colony.
        """
        path = (folder or self.folder) / f"{name.removesuffix(self.suffix)}{self.suffix}"
        return path if os.path.basename(name) == name and os.path.isfile(path) else None

    def hint(self, given: str) -> str | None:
        """Return what to try in place of `given`, which was not found; None for a path like no name."""
        close = did_you_mean(Path(given).stem, self.names())
        if close is None and not Path(given).suffix and os.path.basename(given) == given:
            return f"{self.value[0]} that come with colony: {', '.join(self.names())}"
        return close
