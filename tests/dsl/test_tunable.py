"""`tunable param`: a param within an interval, which is read as a sensor that is never missing."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import check_text
from colony.dsl.site_reading import SavedParamsError, params_from_values, saved_params
from colony.ir.frame import Frame
from colony.ir.program import TUNABLE_SERVER, Module, PythonModule, Sensor
from colony.ir.types import ScalarValue
from colony.runtime.protocol.deployment import tunables_of
from colony.testing import check
from tests.dsl.texts import ROBOT, findings, messages, named, program

AVOID = """
tunable param roaming = 0.3 m/s in 0.1 m/s .. 0.6 m/s
module avoid {
  tunable param clearance = 60 cm in 0.5 m .. 1 m
  param more = 2
  when min(sonar) < clearance * more do drive(velocity = roaming, turn = 0)
}
"""


def tunables(text: str) -> dict[str, tuple[float | None, object, float | None, str]]:
    """Lower bound, initial value and upper bound in base units, and the declared unit, by name."""
    found = program(text).robot.sensors
    return {s.name: (s.low, s.default, s.high, s.unit) for s in found if s.tunable}


def test_it_is_a_sensor_of_the_program_with_its_interval_as_range() -> None:
    assert tunables(AVOID) == {
        "avoid.clearance": (500.0, 600.0, 1000.0, "cm"),
        "roaming": (100.0, 300.0, 600.0, "m/s"),
    }
    [clearance, _] = [s for s in program(AVOID).robot.sensors if s.tunable]
    assert (clearance.server, clearance.field, clearance.factor) == (TUNABLE_SERVER, "avoid.clearance", 10.0)
    assert not clearance.of_robot


def test_a_module_has_its_constant_params_beside_it() -> None:
    assert named(Module, "avoid", AVOID).params == (("more", 2.0),)


def test_a_derived_module_has_one_of_its_own_with_another_value_at_the_start() -> None:
    found = tunables(AVOID + "module wide = avoid(clearance = 0.9 m)\nmodule same = wide(more = 3)")
    assert found["wide.clearance"] == (500.0, 900.0, 1000.0, "cm")
    assert found["same.clearance"] == (500.0, 900.0, 1000.0, "cm")
    assert found["avoid.clearance"][1] == 600.0


def test_one_that_nothing_reads_and_those_of_templates_are_no_part_of_the_program() -> None:
    template = """
    tunable param unread = 1 in 0 .. 2
    module t {
      input far : mm
      tunable param near = 1 m in 0 m .. 2 m
      when far < near do drive(velocity = 0, turn = 0)
    }
    """
    assert tunables(template) == {}
    assert list(tunables(template + "module u = t(far = min(sonar))")) == ["u.near"]


def test_units_are_those_of_the_number_or_readable_ones() -> None:
    text = """
    param half = 1 m
    tunable param a = 2 * half in half .. 4 m
    tunable param b = 20 percent in 0 percent .. 50 percent
    tunable param c = -3 in -5 .. 5
    module m { when min(sonar) < a and b > 5 percent and c > 0 do drive(velocity = 0, turn = 0) }
    """
    assert tunables(text) == {
        "a": (1000.0, 2000.0, 4000.0, "mm"),
        "b": (0.0, 0.2, 0.5, "percent"),
        "c": (-5.0, -3.0, 5.0, ""),
    }


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("tunable param a = true in 0 .. 1", "1:19 E303"),
        ("tunable param a = 1 in 2 .. 0", "1:24 E303"),
        ("tunable param a = 3 in 0 .. 2", "1:19 E304"),
        ("tunable param a = 1 m in 0 s .. 2 m", "1:26 E202"),
        ("tunable param a = 1 in 0 .. 2\nparam b = a + 1", "2:11 E204"),
        (
            "tunable param a = 1 in 0 .. 2\nlet b = sonar[a]\nlet c = sum(sonar[i] for i in 0 .. a)",
            "3:36 E204",
        ),
        ("tunable param bumper = 1 in 0 .. 2", "1:15 E102"),
        ("tunable param drive = 1 in 0 .. 2", "1:15 E102"),
        ("input drive : mm from DServer.X", "1:7 E102"),
        ("tunable param t = 1 in 0 .. 2", "1:15 E307"),
    ],
)
def test_what_it_cannot_be(text: str, code: str) -> None:
    assert findings(text) == [code]


def test_no_constant_is_computed_from_it() -> None:
    said = messages("tunable param a = 1 in 0 .. 2\nparam b = a")
    assert "`a` is tunable, so it is not constant" in said
    assert "name what is computed from it with `let`" in said


@pytest.mark.parametrize("text", ["tunable param a = true\nlet b = 1", "tunable param a = 3 mm\nlet b = 1"])
def test_one_without_an_interval_has_a_hint(text: str) -> None:
    assert "hint: a tunable param is a number in an interval" in messages(text)


def test_a_derived_module_stays_in_the_interval() -> None:
    said = messages(AVOID + "module wide = avoid(clearance = 2 m)")
    assert "error[E404]: param `clearance` is outside of its interval, 50 cm .. 100 cm" in said


def test_a_module_in_python_takes_none() -> None:
    text = 'module p from python "a:B" { tunable param gain = 2 in 0 .. 3  reads sonar  commands drive }'
    assert findings(text) == ["1:30 E406"]
    given = """tunable param gain = 2 in 0 .. 3
    module p from python "a:B" { input g : number  reads sonar  commands drive }
    module q = p(g = gain)"""
    assert named(PythonModule, "q", given).class_name == "B"


def test_a_site_sets_the_value_at_the_start_within_the_interval() -> None:
    def checked(values: dict[str, object], more: str = "") -> tuple[dict[str, ScalarValue | None], list[str]]:
        found = check_text(AVOID + more + ROBOT, params=params_from_values(values, "site"))
        sensors: tuple[Sensor, ...] = () if found.program is None else found.program.robot.sensors
        initial = {s.name: s.default for s in sensors if s.tunable}
        return initial, [d.message for d in found.diagnostics if d.severity == "error"]

    assert checked({"roaming": "0.5 m/s", "avoid": {"clearance": "70 cm"}}) == (
        {"roaming": 500.0, "avoid.clearance": 700.0},
        [],
    )
    assert checked({"roaming": "2 m/s"})[1] == ["`roaming` is outside of its interval, 0.1 m/s .. 0.6 m/s"]
    wide = checked({"wide": {"clearance": "2 m"}}, "module wide = avoid(clearance = 0.9 m)\n")
    assert wide[1] == ["`wide.clearance` is outside of its interval, 50 cm .. 100 cm"]


def test_executors_agree_with_values_that_change() -> None:
    drive = "network { drive = avoid }\n"
    given = (None, 0.2, 0.4, None, 7.0, 0.6)
    frames = [
        Frame(k * 50_000_000, {"sonar": (900.0,) * 24, **({} if value is None else {"roaming": value})})
        for k, value in enumerate(given)
    ]
    decided = [outcome.decisions[0].values for _, outcome in check(program(AVOID + drive), frames)]
    assert decided == [(v, 0.0) for v in (300.0, 200.0, 400.0, 300.0, 600.0, 600.0)]


# --- files of params -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (None, 'a = "1 m"\nm.b = "2"\n'),
        ("", 'a = "1 m"\nm.b = "2"\n'),
        ("# site\na = 3 # m\n", '# site\na = "1 m" # m\nm.b = "2"\n'),
        ('c = "x"\n[n]\nd = 1\n', 'c = "x"\na = "1 m"\nm.b = "2"\n\n[n]\nd = 1\n'),
        ("[m]\nb = 1\nc = 2", 'a = "1 m"\n\n[m]\nb = "2"\nc = 2'),
        ("m.b = 1\na = 2", 'm.b = "2"\na = "1 m"'),
        ("# site\r\na = 3\r\nm.b = 4\r\n", '# site\r\na = "1 m"\r\nm.b = "2"\r\n'),
        ("\ufeffa = 3\nm.b = 4\n", 'a = "1 m"\nm.b = "2"\n'),
    ],
)
def test_saved_values_take_their_places_and_the_rest_stays(
    before: str | None, after: str, tmp_path: Path
) -> None:
    path = tmp_path / "site.toml"
    if before is not None:
        path.write_bytes(before.encode())
    assert saved_params(path, {"a": "1 m", "m.b": "2"}).rstrip("\n") == after.rstrip("\n")


@pytest.mark.parametrize("text", ["a = [", "[m]\nc = 1\n"])
def test_a_file_that_cannot_take_them_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "site.toml"
    path.write_text(text)
    with pytest.raises(SavedParamsError, match=r"site\.toml:.*is not TOML"):
        saved_params(path, {"m.b": "2"})


@pytest.mark.parametrize("unit", ["ft", "inch", "percent", "rad", "deg", "mm", "min"])
def test_its_bounds_are_shown_as_written_and_are_within_it(unit: str) -> None:
    for tenths in range(1, 40):
        low, high = f"{tenths / 10:g}", f"{tenths / 10 + 0.7:g}"
        found = program(
            f"tunable param a = {high} {unit} in {low} {unit} .. {high} {unit}\n"
            f"module m {{ when a > {low} {unit} do drive(velocity = 0, turn = 0) }}"
        )
        [sensor], [tunable] = [s for s in found.robot.sensors if s.tunable], tunables_of(found.robot)
        assert sensor.low is not None
        assert sensor.high is not None
        assert sensor.low <= tunable.low * sensor.factor <= tunable.high * sensor.factor <= sensor.high
        assert abs(tunable.low - float(low)) < 1e-12
        assert abs(tunable.high - float(high)) < 1e-12
