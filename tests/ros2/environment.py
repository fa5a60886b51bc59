"""A ROS 2 environment for tests, from PyPI: pinned, made once, in the user's cache.

`python -m tests.ros2.environment` makes it, prints its Python, and exits with 1 if it cannot be had.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

PACKAGES = (
    "ros-jazzy-rclpy==7.1.6",
    "ros-jazzy-rmw-fastrtps-cpp==8.4.3",
    "ros-jazzy-sensor-msgs==5.3.6",
    "ros-jazzy-std-msgs==5.3.6",
    "ros-jazzy-nav-msgs==5.3.6",
    "ros-jazzy-geometry-msgs==5.3.6",
    "ros-jazzy-diagnostic-msgs==5.3.6",
    "ros-jazzy-test-msgs==2.0.3",
    "numpy",
    "pyyaml",
)

MARK = "made"


def folder() -> Path:
    """Return the folder of the environment; tests set XDG_CACHE_HOME to one of their own."""
    cache = os.environ.get("COLONY_TEST_CACHE") or Path.home() / ".cache"
    return Path(cache) / "colony-ros2" / f"jazzy-{sys.version_info.major}.{sys.version_info.minor}"


def existing() -> Path | None:
    """Return the Python of the environment, or None if it was not made."""
    found = folder()
    is_made = (found / MARK).is_file() and (found / MARK).read_text() == "\n".join(PACKAGES)
    return found / "bin" / "python" if is_made else None


def make() -> Path:
    """Make the environment unless it exists, and return its Python.

    Raises:
        subprocess.CalledProcessError: a package cannot be had.
        OSError: the folder cannot be written.
    """
    found = folder()
    found.parent.mkdir(parents=True, exist_ok=True)
    with open(found.with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if (python := existing()) is not None:
            return python
        shutil.rmtree(found, ignore_errors=True)
        venv.create(found, with_pip=True)
        pip = [found / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "install", "-qq"]
        subprocess.run([*pip, *PACKAGES], check=True)
        (found / MARK).write_text("\n".join(PACKAGES))
        return found / "bin" / "python"


if __name__ == "__main__":
    try:
        print(make())
    except (subprocess.CalledProcessError, OSError) as problem:
        sys.exit(f"no ROS 2 environment: {problem}")
