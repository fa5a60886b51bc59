"""Environments with the wheel, and commands typed there."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.paths import ROOT

LONGEST_S = 600
"""No command of the README takes longer, on a busy machine either."""


@dataclass(frozen=True, slots=True)
class Environment:
    """A virtual environment; its commands see no other Python, no checkout and no home of a user."""

    folder: Path

    @classmethod
    def made(cls, folder: Path, python: str, wheel: Path, *extras: str) -> Environment:
        """Make one with the wheel and these extras in it."""
        _run(python, "-m", "venv", str(folder))
        made = cls(folder)
        made.install(wheel, *extras)
        return made

    def install(self, wheel: Path, *extras: str) -> None:
        """Install the wheel with these extras."""
        print(f"installing {wheel.name}{list(extras) or ''} ...", flush=True)
        self.run("pip", "install", "--quiet", f"{wheel}[{','.join(extras)}]" if extras else str(wheel))

    def variables(self) -> dict[str, str]:
        """Return what its commands see of the environment."""
        home = self.folder / "home"
        home.mkdir(exist_ok=True)
        kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        path = os.pathsep.join((str(self.folder / "bin"), os.environ.get("PATH", os.defpath)))
        return kept | {"PATH": path, "HOME": str(home), "COLONY_RUN_DIR": str(home / "run")}

    def run(
        self, *command: str, folder: Path | None = None, codes: Sequence[int] = (0,)
    ) -> subprocess.CompletedProcess[str]:
        """Type a command, and see to it that it ends with one of `codes`."""
        began = time.monotonic()
        ran = subprocess.run(
            [str(self.folder / "bin" / command[0]), *command[1:]],
            stdin=subprocess.DEVNULL,  # `colony lsp` serves until its end
            cwd=folder or self.folder,
            env=self.variables(),
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
        print(f"{time.monotonic() - began:6.1f} s  {' '.join(command)[:100]}", flush=True)
        assert "Traceback" not in ran.stderr, ran.stderr
        assert ran.returncode in codes, f"ended with {ran.returncode}:\n{ran.stdout}\n{ran.stderr}"
        return ran


def build(folder: Path, python: str) -> Path:
    """Build the sdist from the checkout, and the wheel from the sdist, as an index would."""
    maker = folder / "maker"
    _run(python, "-m", "venv", str(maker))
    own = str(maker / "bin" / "python")
    _run(own, "-m", "pip", "install", "--quiet", "build")
    _run(own, "-m", "build", "--outdir", str(folder / "dist"), str(ROOT))
    [wheel] = (folder / "dist").glob("*.whl")
    return wheel


def _run(*command: str) -> None:
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LONGEST_S)
    if ran.returncode != 0:
        sys.exit(f"{' '.join(command)}:\n{ran.stdout}\n{ran.stderr}")
