"""What `colony serve all` prints of drivers that fail: one line for each reason, and one for the end."""

from __future__ import annotations

from colony.robots.driver_watch import MAX_REASONS, DriverReports
from colony.runtime.servers.drivers import BEING_OPENED


def test_each_reason_of_an_outage_and_its_end_are_one_line() -> None:
    reports: list[str] = []
    drivers = DriverReports(reports.append)
    bus, power = "no bus", "no power"
    states: list[tuple[str, ...] | None] = [(), (bus, power), (power,), None, (bus,), (), ()]
    for failing in states:
        drivers.update("Lidar", failing)
        drivers.update("Lift", ())
        drivers.update("Floor", None)
    drivers.update("Lidar", (power,))
    assert reports == [
        "Lidar fails: no bus",
        "Lidar fails: no power",
        "Lidar works again",
        "Lidar fails: no power",
    ]
    assert drivers.first == {"Lidar": bus}


def test_one_reason_of_several_servers_is_spelled_out_once() -> None:
    reports: list[str] = []
    drivers = DriverReports(reports.append)
    for server in ("RServer", "Sonar", "Battery"):
        drivers.update(server, ("no port",))
    drivers.update("RServer", ())
    drivers.update("Panel", ("no port",))
    assert reports == [
        "RServer fails: no port",
        "Sonar fails: as RServer does",
        "Battery fails: as RServer does",
        "RServer works again",
        "Panel fails: as Sonar does",
    ]
    assert set(drivers.first.values()) == {"no port"}


def test_the_reasons_of_an_outage_are_limited() -> None:
    reports: list[str] = []
    drivers = DriverReports(reports.append)
    for number in range(20):
        drivers.update("Lidar", (f"error {number}",))
    assert len(reports) == MAX_REASONS
    drivers.update("Lidar", ())
    assert reports[-1] == "Lidar works again"


def test_a_device_that_is_being_opened_has_not_failed() -> None:
    reports: list[str] = []
    drivers = DriverReports(reports.append)
    for failing in [(BEING_OPENED,), (BEING_OPENED,), ()]:
        drivers.update("RServer", failing)
    assert reports == [f"RServer: {BEING_OPENED}", "RServer works"]
    assert drivers.first == {}
    for failing in [(BEING_OPENED,), ("no answer",), ()]:
        drivers.update("RServer", failing)
    assert reports[2:] == [f"RServer: {BEING_OPENED}", "RServer fails: no answer", "RServer works again"]
    assert drivers.first == {"RServer": "no answer"}
