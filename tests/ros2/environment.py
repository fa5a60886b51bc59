"""ROS 2 environments for tests, from PyPI: pinned, made once, in the user's cache.

`python -m tests.ros2.environment` makes one, prints its Python, and exits with 1 if it cannot be had. The
variable ROS2_RELEASE names its release: `jazzy`, the default, or `kilted`.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
from pathlib import Path

JAZZY = (
    "ros-jazzy-rclpy==7.1.6",
    "ros-jazzy-rmw-fastrtps-cpp==8.4.3",
    *(f"ros-jazzy-{name}-msgs==5.3.6" for name in ("std", "sensor", "nav", "geometry", "diagnostic")),
    "ros-jazzy-std-srvs==5.3.6",
    "ros-jazzy-test-msgs==2.0.3",
)
KILTED = (
    "ros-kilted-rclpy==9.1.2",
    "ros-kilted-rmw-fastrtps-cpp==9.3.3",
    *(f"ros-kilted-{name}-msgs==5.5.1" for name in ("std", "sensor", "nav", "geometry", "diagnostic")),
    "ros-kilted-std-srvs==5.5.1",
    "ros-kilted-test-msgs==2.3.0",
)
RELEASES = {"jazzy": JAZZY, "kilted": KILTED}
COMMON = ("numpy", "pyyaml")

MARK = "made"


def release() -> str:
    """Return the release of ROS 2 that is tested."""
    return os.environ.get("ROS2_RELEASE", "jazzy")


def _packages() -> dict[str, str]:
    """Return the packages by name, each as pip takes it."""
    return {line.partition("==")[0]: line for line in (*RELEASES[release()], *COMMON)}


def _installed(folder: Path) -> dict[str, str]:
    """Return the packages that were installed into a folder."""
    mark = folder / MARK
    lines = mark.read_text().split() if mark.is_file() else []
    return {line.partition("==")[0]: line for line in lines}


def folder() -> Path:
    """Return the folder of the environment; tests set XDG_CACHE_HOME to one of their own."""
    cache = os.environ.get("COLONY_TEST_CACHE") or Path.home() / ".cache"
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return Path(cache) / "colony-ros2" / f"{release()}-{python}"


def existing() -> Path | None:
    """Return the Python of the environment, or None if it was not made."""
    found = folder()
    return found / "bin" / "python" if _packages().items() <= _installed(found).items() else None


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
        installed = _installed(found)  # what is missing is added: others may use the environment now
        if not installed:
            shutil.rmtree(found, ignore_errors=True)
            subprocess.run([sys.executable, "-m", "venv", found], check=True)
        pip = [found / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "install", "-qq"]
        subprocess.run([*pip, *_packages().values()], check=True)
        (found / MARK).write_text("\n".join({**installed, **_packages()}.values()))
        return found / "bin" / "python"


if __name__ == "__main__":
    try:
        print(make())
    except (subprocess.CalledProcessError, OSError) as problem:
        sys.exit(f"no ROS 2 environment: {problem}")
