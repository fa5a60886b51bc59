"""What the core does without any extra, and how large it is; what it does with MuJoCo."""

from __future__ import annotations

from pathlib import Path

from tools.wheel.environments import Environment

MOST_MB = 130
"""Largest environment of the core, with pip."""

WORKS = ("check wander", "test wander", "compile navigator", "graph wander", "new patrol", "--version")
LACKS = {
    "verify wander": "verify",
    "run wander --map loop": "sim",
    "run wander --robot amr --map loop --physics mujoco": "sim,mujoco",
    "vision x.png": "vision",
    "map loop": "sim",
}


def check_core(core: Environment, place: Path) -> None:
    """Type commands in an environment without extras."""
    folder = place / "with core"
    folder.mkdir()
    size_mb = sum(path.lstat().st_size for path in core.folder.rglob("*")) / 1e6
    print(f"the core's environment: {size_mb:.0f} MB")
    assert size_mb <= MOST_MB
    for line in WORKS:
        core.run("colony", *line.split(), folder=folder)
    for line, extra in LACKS.items():
        said = core.run("colony", *line.split(), folder=folder, codes=[2]).stderr
        assert said.endswith(f"pip install 'colony-robotics[{extra}]'\n"), said
        assert said.count("\n") == 1, said


def check_mujoco(environment: Environment, place: Path) -> None:
    """Drive a robot in MuJoCo, which comes without a display."""
    folder = place / "with mujoco"
    folder.mkdir()
    line = "run wander --robot amr --map loop --physics mujoco --duration 2 --no-picture"
    said = environment.run("colony", *line.split(), folder=folder).stdout
    assert said.startswith("amr: 2.0 s, 40 frames"), said
