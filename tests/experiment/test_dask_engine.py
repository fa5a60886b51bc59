"""The same work on a Dask cluster."""

from __future__ import annotations

import pytest

from colony.experiment import dask_engine
from colony.experiment.dask_engine import DaskEngine
from colony.experiment.parallel import PoolEngine, SerialEngine, WorkersLost

pytest.importorskip("distributed")


def _work(item: int) -> tuple[int, float]:
    return item, item**0.5


def test_a_local_cluster_of_two_workers_gives_the_same_results() -> None:
    items = list(range(40))
    expected = list(SerialEngine().results(_work, items))
    assert sorted(DaskEngine(workers=2).results(_work, items)) == expected
    assert sorted(PoolEngine(2).results(_work, items)) == expected


def test_a_scheduler_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_engine, "REACHED_S", 0.5)
    engine = DaskEngine("tcp://127.0.0.1:9")
    with pytest.raises(WorkersLost, match=r"no Dask scheduler at tcp://127.0.0.1:9"):
        list(engine.results(_work, [1]))
