"""A mission over live connections: what it finds, and leaves, of missions before it."""

from __future__ import annotations

import pytest

from colony.nav.maps.building import load_building
from colony.nav.plan.route import plan
from colony.nav.shared import ELEVATOR_CALL, FLOOR
from colony.runs.live_mission import LiveMission
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import ServerNotFoundError
from colony.runtime.library import data
from colony.runtime.servers.dserver import DServer
from studies.lists import PUBLISHED_MAP
from tests.runtime.transport.live.stage import ROBOT, hosted, run_directory


def test_it_is_on_its_floor_and_calls_no_elevator_before_any_script_begins() -> None:
    """Here there is no base, and no script begins."""
    building = load_building(PUBLISHED_MAP)
    with (
        run_directory() as environment,
        hosted(environment, [DServer()]),
        Session.open(ROBOT, environment=environment) as session,
        session.connect("DServer") as store,
    ):
        store.do(data.set_many({FLOOR: "msu_engineering_2", ELEVATOR_CALL: ["a", "b", "c"]}))
        with (
            pytest.raises(ServerNotFoundError, match="RServer"),
            LiveMission(session, building, plan(building, "350R", "352L")),
        ):
            pass
        assert store.do(data.get_many((FLOOR, ELEVATOR_CALL))) == {
            FLOOR: "msu_engineering_3",
            ELEVATOR_CALL: [],
        }
