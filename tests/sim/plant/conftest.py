"""A plant of two robots, and who controls it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from colony.sim.plant.control import PlantControl
from tests.sim.plant.plants import OTHER, START, PlantProcess
from tests.waiting import PATIENCE_S


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlantProcess]:
    with PlantProcess(tmp_path_factory.mktemp("plant") / "plant", {"rome": START, "remus": OTHER}) as running:
        yield running
        assert running.end() == 0
        assert not running.path.exists()


@pytest.fixture
def control(plant: PlantProcess) -> Iterator[PlantControl]:
    with PlantControl(plant.path, timeout_s=PATIENCE_S) as made:
        made.place("rome", *START)
        made.place("remus", *OTHER)
        yield made
