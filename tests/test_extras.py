"""Without the extras of the distribution the core works, and says what is missing."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from colony.extras import EXTRAS, MissingExtraError, expect_extras, installed
from tests.paths import ROOT
from tests.watch.runs import recording

EVERYTHING = tuple(module for modules in EXTRAS.values() for module in modules)

COMMAND = """
import sys
sys.modules.update(dict.fromkeys({missing!r}))  # importing these fails, as if they were not installed
sys.argv = ["colony", *{arguments!r}]
from colony.cli.main import main
main()
"""

LIBRARY = """
import sys, warnings
sys.modules.update(dict.fromkeys({missing!r}))
import colony
program = colony.load("figure_4_14")
with warnings.catch_warnings(record=True) as warned:
    warnings.simplefilter("always")
    colony.build(colony.load("wander")).executor()
print([str(one.message).partition("[")[2] for one in warned])
for use in (lambda: colony.prove(program), lambda: __import__("colony.testing")):
    try:
        use()
    except ModuleNotFoundError as problem:
        print(problem)
"""


def _run(
    code: str, *arguments: str, folder: Path, missing: tuple[str, ...] = EVERYTHING
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code.format(missing=missing, arguments=arguments)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(folder / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    "command", ["check wander", "test figure_4_14", "compile figure_4_14", "graph wander"]
)
def test_the_core_needs_none(command: str, tmp_path: Path) -> None:
    ran = _run(COMMAND, *command.split(), folder=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert "not installed" not in ran.stderr


def test_what_z3_would_prove_is_said(tmp_path: Path) -> None:
    ran = _run(COMMAND, "compile", "wander", folder=tmp_path)
    assert ran.returncode == 0
    assert "keep_middle" in ran.stdout
    assert "clients: drive" in ran.stderr
    assert "proved by structure" in ran.stderr
    assert ran.stderr.endswith("pip install 'colony-robotics[verify]'\n")
    assert ran.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("command", "missing", "extras"),
    [
        ("verify wander", EVERYTHING, "verify"),
        ("diff wander teleop", EVERYTHING, "verify"),
        ("run wander --map loop", EVERYTHING, "sim"),
        ("run wander --map loop --processes", EVERYTHING, "sim"),
        ("run wander --robot amr --map loop --physics mujoco", ("mujoco",), "mujoco"),
        ("run wander --robot amr --map loop --physics mujoco", EVERYTHING, "sim,mujoco"),
        ("run navigator --map loop --from 201 --to 216", ("cv2",), "vision"),
        ("run navigator --map loop --from 201 --to 216", EVERYTHING, "sim,vision"),
        ("serve all --robot rome --map loop", ("numba",), "sim"),
        ("compile --prove clients.json wander", ("z3",), "verify"),
        ("serve all --robot rome --map loop", EVERYTHING, "sim"),
        ("map loop", EVERYTHING, "sim"),
        ("plan loop 201 216", EVERYTHING, "sim"),
        ("sim snapshot loop --at 201", EVERYTHING, "sim"),
        ("graph wander --format graphml", EVERYTHING, "sim"),
        ("shadow wander --bag clients.json", ("rosbags",), "bags"),
        ("vision x.png", EVERYTHING, "vision"),
        ("vision x.png", ("cv2",), "vision"),
        ("watch clients.json", EVERYTHING, "watch"),
        ("run wander --map loop --watch", ("starlette",), "watch"),
        ("verify wander --watch never_rams", ("starlette",), "watch"),
        ("watch --robot rome --foxglove", ("foxglove",), "foxglove"),
    ],
)
def test_a_command_names_the_extra_that_it_lacks(
    command: str, missing: tuple[str, ...], extras: str, tmp_path: Path
) -> None:
    (tmp_path / "clients.json").write_text("{}")
    ran = _run(COMMAND, *command.split(), folder=tmp_path, missing=missing)
    assert ran.returncode == 2
    assert ran.stderr.startswith("colony: error: ")
    assert ran.stderr.endswith(f"; run: pip install 'colony-robotics[{extras}]'\n")
    assert ran.stderr.count("\n") == 1
    assert {path.name for path in tmp_path.iterdir()} - {"cache"} == {"clients.json"}


def test_watching_needs_no_other_extra(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(recording())
    missing = tuple(module for module in EVERYTHING if module not in EXTRAS["watch"])
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        ran = _run(COMMAND, "watch", "run.mcap", "--port", port, folder=tmp_path, missing=missing)
    assert "cannot listen" in ran.stderr, ran.stderr


def test_exporting_needs_none(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(recording())
    ran = _run(COMMAND, "export", "run.mcap", "-o", "out.mcap", folder=tmp_path)
    assert ran.returncode == 0, ran.stderr


def test_the_library_says_so_too(tmp_path: Path) -> None:
    ran = _run(LIBRARY, folder=tmp_path)
    assert ran.stdout.splitlines() == [
        '["verify]\'"]',
        "extra verify not installed (no z3); run: pip install 'colony-robotics[verify]'",
        "extra verify not installed (no hypothesis); run: pip install 'colony-robotics[verify]'",
    ]


def test_all_that_is_missing_is_named_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    expect_extras(*EXTRAS)
    for module in ("cv2", "z3"):
        monkeypatch.setitem(sys.modules, module, None)
        assert not installed(module)
    with pytest.raises(MissingExtraError) as missing:
        expect_extras("sim", "verify", "vision")
    assert (
        str(missing.value)
        == "extras verify and vision not installed (no z3); run: pip install 'colony-robotics[verify,vision]'"
    )


def test_params_of_a_site_are_refused_without_a_prover(tmp_path: Path) -> None:
    (tmp_path / "site.toml").write_text('roaming = "250 mm/s"')
    words = ("run", "wander", "--map", "loop", "--params", "site.toml")
    ran = _run(COMMAND, *words, folder=tmp_path, missing=("z3",))
    assert ran.returncode == 2
    assert "14 contracts must be proved with these params, and z3 is not installed" in ran.stderr
    assert "--unproved" in ran.stderr
    compiled = _run(
        COMMAND,
        "compile",
        *("wander", "--params", "site.toml", "-o", "w.colonyc"),
        folder=tmp_path,
        missing=(),
    )
    assert compiled.returncode == 0, compiled.stderr
    driven = ("run", "w.colonyc", "--map", "loop", "--duration", "0.2", "--no-picture")
    ran = _run(COMMAND, *driven, folder=tmp_path, missing=("z3",))
    assert ran.returncode == 0, ran.stderr
    assert "  with the params of site.toml (" in ran.stdout
