"""The same work on a Dask cluster."""

from __future__ import annotations

import pytest

from colony.experiment import dask_engine
from colony.experiment.dask_engine import DaskEngine
from colony.experiment.parallel import SerialEngine, WorkersLostError

pytest.importorskip("distributed")


@pytest.mark.long
def test_a_local_cluster_of_two_workers_gives_the_same_results() -> None:
    items = range(-20, 20)
    assert sorted(DaskEngine(workers=2).results(abs, items)) == sorted(SerialEngine().results(abs, items))


def test_a_scheduler_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_engine, "CONNECT_TIMEOUT_S", 0.5)
    engine = DaskEngine("tcp://127.0.0.1:9")
    with pytest.raises(WorkersLostError, match=r"no Dask scheduler at tcp://127.0.0.1:9"):
        list(engine.results(abs, [1]))
