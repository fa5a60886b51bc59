"""What `colony serve all` prints of drivers that fail: one line for each reason, and one for the end."""

from __future__ import annotations

from colony.cli.run.driver_watch import MAX_REASONS, DriverReports

BUS, POWER, PORT = ("no bus",), ("no power",), ("no port",)
FINE: tuple[str, ...] = ()


def test_each_reason_of_an_outage_and_its_end_are_one_line() -> None:
    reports: list[str] = []
    drivers = DriverReports(reports.append)
    for failing in (FINE, BUS + POWER, POWER, None, BUS, FINE, FINE, POWER):
        drivers.update({"Lidar": failing, "Lift": FINE, "Floor": None})
    assert reports == [
        "Lidar fails: no bus",
        "Lidar fails: no power",
        "Lidar works again",
        "Lidar fails: no power",
    ]
    assert drivers.first == {"Lidar": "no bus"}


def test_servers_of_one_reason_share_a_line_and_so_does_their_end() -> None:
    reports: list[str] = []
    drivers = DriverReports(reports.append)
    for looks in (
        {"RServer": PORT, "Sonar": PORT, "Battery": FINE, "Lidar": BUS},
        {"RServer": PORT, "Sonar": PORT, "Battery": PORT, "Lidar": BUS},
        {"RServer": FINE, "Sonar": PORT, "Battery": PORT, "Lidar": BUS},
        {"RServer": None, "Sonar": FINE, "Battery": FINE, "Lidar": BUS},
        {"RServer": FINE, "Sonar": PORT, "Battery": FINE, "Lidar": BUS},
    ):
        drivers.update(looks)
    assert reports == [
        "RServer and Sonar fail: no port",
        "Lidar fails: no bus",
        "RServer, Sonar and Battery work again",
        "Sonar fails: no port",
    ]
    assert drivers.first == {
        "RServer": "no port",
        "Sonar": "no port",
        "Lidar": "no bus",
        "Battery": "no port",
    }


def test_the_reasons_of_an_outage_are_limited() -> None:
    reports: list[str] = []
    drivers = DriverReports(reports.append)
    for number in range(20):
        drivers.update({"Lidar": (f"error {number}",)})
    assert len(reports) == MAX_REASONS
    drivers.update({"Lidar": FINE})
    assert reports[-1] == "Lidar works again"


def test_a_stop_and_its_release_are_one_line_each() -> None:
    reports: list[str] = []
    drivers = DriverReports(reports.append)
    for by in (None, "", "ada/1", "ada/1", None, "", ""):
        drivers.stopped(by)
    assert reports == [
        "EMERGENCY STOP, by ada/1: nothing moves until `colony stop --release`",
        "the emergency stop was released",
    ]
