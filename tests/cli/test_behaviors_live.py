"""The behaviors that come with the project, as processes: what is on time is as the interpreter decides."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from colony.dsl.load import load_file
from tests.cli.conftest import Colony
from tests.cli.machine import MAP, Machine
from tests.paths import ROOT
from tests.sampling import sampled

DRIVING = [f for f in sorted((ROOT / "behaviors").glob("*.colony")) if load_file(f).wires]
SETTINGS = {"teleop": ("--set", "TeleopVelocity=200")}
SEED = 1


def test_most_of_them_drive() -> None:
    assert len(DRIVING) >= 6


@pytest.mark.long
@pytest.mark.parametrize("file", sampled(DRIVING, every=3, thorough=True), ids=lambda path: path.stem)
def test_it_decides_as_the_interpreter_does(file: Path, machine: Machine, colony: Colony) -> None:
    asked = ("--map", MAP, "--processes", "--duration", "2", "--seed", str(SEED), "--no-picture")
    told = ("--record", "run.mcap", "--format", "json", *SETTINGS.get(file.stem, ()))
    run = machine.start("run", str(file), *asked, *told)
    assert run.wait() == 0, run.err
    assert json.loads(run.out)["disagreements"] == []
    audited = colony("audit", run.folder / "run.mcap", "--format", "json")
    assert audited.code == 0, audited.out + audited.err
    report = json.loads(audited.out)
    assert report["agrees"] is True
    assert report["compared"] >= 20  # decisions, of 40 frames or more; fewer where the machine is busy
