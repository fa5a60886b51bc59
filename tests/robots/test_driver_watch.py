"""What `colony serve all` prints of drivers that fail: one line for each outage, and one for its end."""

from __future__ import annotations

from colony.robots.driver_watch import DriverReports


def test_an_outage_and_its_end_are_one_line_each() -> None:
    reports: list[str] = []
    drivers = DriverReports(reports.append)
    bus, power = "no bus", "no power"
    states: list[tuple[str, ...] | None] = [(), (bus, power), (power,), None, (bus,), (), ()]
    for failing in states:
        drivers.update("Lidar", failing)
        drivers.update("Lift", ())
        drivers.update("Floor", None)
    drivers.update("Lidar", (power,))
    assert reports == ["Lidar fails: no bus", "Lidar works again", "Lidar fails: no power"]
    assert drivers.first == {"Lidar": bus}
