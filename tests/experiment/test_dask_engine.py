"""The same work on a Dask cluster."""

from __future__ import annotations

import pytest

from colony.experiment import dask_engine
from colony.experiment.dask_engine import DaskEngine
from colony.experiment.lists import PUBLISHED_MAP
from colony.experiment.parallel import SerialEngine, WorkersLostError
from colony.experiment.record import RunKey
from colony.experiment.runs import RunSpec, run
from colony.sim.hazards.hazards import Hazards

pytest.importorskip("distributed")


@pytest.mark.long
def test_a_local_cluster_of_two_workers_gives_the_same_results() -> None:
    specs = [
        RunSpec(
            key=RunKey("short", number, seed, "ours"),
            map_path=PUBLISHED_MAP,
            origin=origin,
            goal=goal,
            hazards=Hazards(),
        )
        for number, (origin, goal) in enumerate((("A342L", "A340R"), ("A339L", "A338R")), 1)
        for seed in (1, 2)
    ]
    expected = list(SerialEngine().results(run, specs))
    found = list(DaskEngine(workers=2).results(run, specs))
    assert sorted(found, key=lambda one: one.key) == expected


def test_a_scheduler_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_engine, "CONNECT_TIMEOUT_S", 0.5)
    engine = DaskEngine("tcp://127.0.0.1:9")
    with pytest.raises(WorkersLostError, match=r"no Dask scheduler at tcp://127.0.0.1:9"):
        list(engine.results(abs, [1]))
