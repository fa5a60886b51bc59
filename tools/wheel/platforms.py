"""Whether there are wheels of everything for machines that are not at hand. Nothing of them is run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PLATFORMS = [(version, machine) for version in ("3.11", "3.12", "3.13") for machine in ("x86_64", "aarch64")]
EXTRAS = ("", "drivers", "verify")


def check_platforms(wheel: Path, place: Path) -> None:
    """Ask the package index for each of them."""
    for version, machine in PLATFORMS:
        for extra in EXTRAS:
            wanted = f"{wheel}[{extra}]" if extra else str(wheel)
            platforms = [f"manylinux{one}_{machine}" for one in ("2014", "_2_17", "_2_28", "_2_34", "_2_38")]
            command = [sys.executable, "-m", "pip", "download", "--quiet", "--only-binary=:all:"]
            command += ["--python-version", version, "--implementation", "cp"]
            command += [word for one in platforms for word in ("--platform", one)]
            found = subprocess.run(
                [*command, "--dest", str(place / f"{version}-{machine}"), wanted],
                capture_output=True,
                text=True,
                check=False,
            )
            assert found.returncode == 0, f"Python {version}, {machine}: {found.stderr}"
        print(f"wheels of everything: Python {version}, {machine}")
