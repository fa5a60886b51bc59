"""The behaviors, robots and maps that come with colony, by name: `wander`, `rome`, `loop`.

In the repository they are in its root folder, in a wheel in the folder of this file.
"""

from __future__ import annotations

import os
from enum import Enum, unique
from pathlib import Path

from colony.text.wording import did_you_mean

_HERE = Path(__file__).parent
_FOLDER = _HERE if (_HERE / "behaviors").is_dir() else _HERE.parents[1]


def errors_page() -> str:
    """Return docs/errors.md, which explains each code."""
    return (_HERE / "errors.md" if _FOLDER == _HERE else _FOLDER / "docs" / "errors.md").read_text("utf-8")


@unique
class Shipped(Enum):
    """A kind of shipped file, with its folder and the suffixes of its files.

    A robot has a folder of its own, with its description and its body: `robots/rome/rome.colony`.
    """

    BEHAVIOR = ("behaviors", ".colony")
    LIBRARY = ("behaviors/library", ".colony")
    ROBOT = ("robots", ".colony")
    MAP = ("maps", ".stickrep", ".yaml")

    @property
    def folder(self) -> Path:
        """The folder of the files of this kind."""
        folder: str = self.value[0]
        return _FOLDER / folder

    @property
    def suffix(self) -> str:
        """The suffix of the files of this kind; of maps that of buildings."""
        return self.suffixes[0]

    @property
    def suffixes(self) -> tuple[str, ...]:
        """All suffixes that files of this kind may have."""
        suffixes: tuple[str, ...] = self.value[1:]
        return suffixes

    def names(self, suffix: str | None = None) -> list[str]:
        """Return the names of all files of this kind, or of those with a suffix, in alphabetical order."""
        suffixes = self.suffixes if suffix is None else (suffix,)
        files = (path for each in suffixes for path in self.folder.glob(f"**/*{each}"))
        return sorted(path.stem for path in files if self.contains(path))

    def path(self, name: str) -> Path:
        """Return the file of this name, which is one of `names()`."""
        paths = self._paths(name)
        return next((path for path in paths if path.is_file()), paths[0])

    def _paths(self, name: str) -> list[Path]:
        folder = self.folder / name if self is Shipped.ROBOT else self.folder
        return [folder / f"{name}{suffix}" for suffix in self.suffixes]

    def contains(self, path: Path) -> bool:
        """Return True if `path` is the path of a file of this kind, as `path` gives it."""
        return path in self._paths(path.stem)

    def find(self, name_or_path: str) -> str:
        """Return the path of the user's file, given with or without its suffix, or else of a shipped file.

        If neither exists, return `name_or_path` unchanged: reading it reports the error.
        """
        path = self.user_file(name_or_path)
        return path if path is not None else str(self.file_named(name_or_path) or name_or_path)

    def user_file(self, name_or_path: str | os.PathLike[str]) -> str | None:
        """Return the path of a user's file, `name_or_path` with or without a suffix; None if there is none.

        A folder does not count as a file; a dangling symbolic link does, although it cannot be read.
        """
        paths = [f"{os.fspath(name_or_path)}{suffix}" for suffix in ("", *self.suffixes)]
        return next((path for path in paths if os.path.lexists(path) and not os.path.isdir(path)), None)

    def file_named(self, name: str, folder: Path | None = None) -> Path | None:
        """Return the file with this name, `wander` or `wander.colony`; None if there is none.

        It is searched for in `folder`, by default among the shipped files. A robot is a behavior, too, and so
        is a file of the library, which has no robot: behaviors and descriptions of robots import it.
        """
        suffix = next((suffix for suffix in self.suffixes if name.endswith(suffix)), None)
        stem = name.removesuffix(suffix or "")
        paths = self._paths(stem) if folder is None else [folder / f"{stem}{each}" for each in self.suffixes]
        for path in paths:
            if os.path.basename(name) == name and suffix in (None, path.suffix) and os.path.isfile(path):
                return path
        if self is not Shipped.BEHAVIOR or folder is not None:
            return None
        return Shipped.ROBOT.file_named(name) or Shipped.LIBRARY.file_named(name)

    def hint(self, name_or_path: str) -> str | None:
        """Return a suggestion for `name_or_path`, which was not found; None if there is none."""
        folder = Path(name_or_path).parent
        paths = sorted(folder.iterdir()) if folder.is_dir() else []
        own = {path.stem: path for path in paths if path.suffix in self.suffixes}
        close = did_you_mean(Path(name_or_path).stem, (*own, *self.names()))
        for stem, path in own.items():
            if close == f"did you mean `{stem}`?":
                return f"did you mean `{path}`?"
        if close is None and not Path(name_or_path).suffix and os.path.basename(name_or_path) == name_or_path:
            return f"{self.value[0]} that come with colony: {', '.join(self.names())}"
        return close
