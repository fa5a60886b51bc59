"""`colony new`: what it writes works as it stands."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import Colony
from tests.paths import ROOT


def test_a_behavior_alone_checks_passes_its_tests_and_compiles(colony: Colony, tmp_path: Path) -> None:
    assert colony("new", "patrol.colony").code == 0
    assert colony("check", "patrol.colony").err == ""
    assert colony("test", "patrol.colony").code == 0
    assert colony("compile", "patrol.colony").code == 0
    before = (tmp_path / "patrol.colony").read_text()
    assert "already exists" in colony.refusal("new", "patrol.colony")
    assert (tmp_path / "patrol.colony").read_text() == before


def test_a_project_passes_its_own_tests(colony: Colony, tmp_path: Path) -> None:
    assert (
        colony("new", "my-patrol").out
        == "wrote my-patrol; try: cd my-patrol && colony test my-patrol.colony\n"
    )
    project = tmp_path / "my-patrol"
    names = {"README.md", "my-patrol.colony", "pyproject.toml", "test_my-patrol.py"}
    assert {path.name for path in project.iterdir()} == names
    for path in project.iterdir():
        assert "NAME" not in path.read_text()
    (project / "conftest.py").write_text(
        "from hypothesis import settings\n"
        "settings.register_profile('few', max_examples=5)\nsettings.load_profile('few')\n"
    )
    tested = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"],
        cwd=project,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert tested.returncode == 0, tested.stdout
    assert "2 passed" in tested.stdout


def test_nothing_that_exists_is_touched(colony: Colony, tmp_path: Path) -> None:
    (tmp_path / "patrol").mkdir()
    code, _, err = colony("new", "patrol")
    assert (code, err) == (2, "patrol: error: cannot write: File exists\n")
    assert list((tmp_path / "patrol").iterdir()) == []


@pytest.mark.parametrize("name", ["my patrol", "patrol.py", "-", "ä", "a/../b c"])
def test_a_name_must_do_for_a_project(colony: Colony, tmp_path: Path, name: str) -> None:
    assert "expected a name of letters" in colony.refusal("new", "--", name)
    assert list(tmp_path.iterdir()) == []


def test_what_can_be_typed_is_said(colony: Colony) -> None:
    assert colony("new", "my patrol.colony").out.endswith("try: colony test 'my patrol.colony'\n")
