"""The names and options of drivers, held to the sources of their modules."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.body.driver_signatures import driver_misfits
from colony.body.reader import body_of_text
from colony.dsl.load import load_text

MODULE = """
import math
from somewhere import imported

try:
    import numpy
except ImportError:
    def spare(): ...

def battery(port, baud=0, *, frame_ns, cells): ...
def fields(port, **names: str): ...
def typed(port: str, baud: int = 0, *, scale: float = 1, inverted: bool = False) -> Any: ...
def listening(port):
    return SerialFields(Rover(), port, {})
def commanding(port):
    return SerialActuators(Rover(), port, {}, {"jaw": b"", "lift": b""}, frame_ns=5)
class Arm:
    def fields(self): ...
class Whole(Arm):
    def safe(self): ...
class Given:
    def __init__(self):
        self.command = print
@math.wraps
def wrapped(): ...
class Lidar:
    def __init__(self, port, rate=10): ...
class Derived(Lidar): ...
alias = Lidar
raise SystemExit("never run")
"""

BODY = """
[robot]
name = "ada"
[body]
footprint = {{ shape = "circle", radius = "200 mm" }}
drive     = {{ kind = "differential", wheel_base = "300 mm" }}
[body.limits]
velocity          = "400 mm/s"
turn              = "90 deg/s"
acceleration      = "500 mm/s^2"
turn_acceleration = "180 deg/s^2"
[server.Battery]
fields.voltage = {{}}
hardware = {{ driver = "{driver}", {options} }}
"""


@pytest.mark.parametrize(
    ("driver", "options", "found"),
    [
        ("parts.mine:battery", 'port = "x", cells = 3', []),
        ("parts.mine:batery", 'port = "x"', ["`parts.mine` has no class `batery`; did you mean `battery`?"]),
        ("parts.mine:battery", 'port = "x"', ["`parts.mine:battery` requires `cells`"]),
        (
            "parts.mine:battery",
            'ports = "x", cells = 3',
            [
                "`parts.mine:battery` has no option `ports`; did you mean `port`?",
                "`parts.mine:battery` requires `port`",
            ],
        ),
        ("parts.mine:Lidar", 'port = "x", rat = 5', ["no option `rat`; did you mean `rate`?"]),
        ("parts.mine:fields", 'port = "x", level = "volts"', []),
        ("parts.mine:fields", 'port = "x", level = 3', ["`level` of `parts.mine:fields` takes `str`, not 3"]),
        ("parts.mine:typed", 'port = "x", baud = 9600, scale = 2, inverted = true', []),
        (
            "parts.mine:typed",
            'port = 5, baud = "57600", scale = true, inverted = 1',
            [f"takes `{kind}`, not " for kind in ("str", "int", "float", "bool")],
        ),
        ("parts.mine:typed", 'port = "x", baud = 0.5', ["`baud` of `parts.mine:typed` takes `int`, not 0.5"]),
        ("colony.drivers.pioneer.pioneer:base", 'port = "x", baud = "57600"', ["takes `int`, not '57600'"]),
        *(
            (f"parts.mine:{name}", "a = 1", [])
            for name in ("wrapped", "Derived", "alias", "imported", "numpy")
        ),
        ("parts.mine:spare", "a = 1", ["`parts.mine:spare` has no option `a`; it has none"]),
        ("parts.none:battery", "a = 1", ["there is no module `parts.none`"]),
        ("colony.drivers.create2.create2:base", 'prot = "x"', ["did you mean `port`?", "requires `port`"]),
        ("parts.broken:battery", "a = 1", ["`parts.broken` cannot be read: invalid syntax"]),
    ],
)
def test_a_driver_and_its_options_are_found_in_the_source(
    tmp_path: Path, driver: str, options: str, found: list[str]
) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "mine.py").write_text(MODULE)
    (tmp_path / "parts" / "broken.py").write_text("def battery(:\n")
    file = body_of_text(BODY.format(driver=driver, options=options), str(tmp_path / "ada.toml"))
    assert file.diagnostics == ()
    texts = [f"{d.message}; {d.hint}" for d in driver_misfits(file)]
    assert len(texts) == len(found)
    for text, expected in zip(texts, found, strict=True):
        assert expected in text


@pytest.mark.parametrize(
    ("driver", "found"),
    [
        ("commanding", []),
        ("listening", ["`parts:listening` has no command `jaw` or `lift`"]),
        ("Arm", ["`parts:Arm` has no method `command`"]),
        *((name, []) for name in ("Whole", "Given", "alias", "imported", "typed")),
    ],
)
def test_a_command_that_a_driver_lacks_is_found_in_the_source(
    tmp_path: Path, driver: str, found: list[str]
) -> None:
    (tmp_path / "parts.py").write_text(MODULE)
    options = 'port = "x"' if driver[0] in "clt" else "rate = 1"
    file = body_of_text(BODY.format(driver=f"parts:{driver}", options=options), str(tmp_path / "ada.toml"))
    interface = """
    language 1
    robot ada {
      actuator jaw { to : mm } to Battery.jaw idle hold
      actuator lift { to : mm } to Battery.lift idle hold
    }
    """
    actuators = load_text(interface).robot.actuators
    messages = [d.message for d in driver_misfits(file, actuators) if "option" not in d.message]
    assert messages == found
