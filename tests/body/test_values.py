"""Values of a body's own, and wheels at any places: held to themselves and to the interface."""

from __future__ import annotations

import pytest

from colony.body.servers import servers_of
from colony.dsl.load import load_text
from colony.runtime.assembly.processes.spec import decoded_server, encoded_server
from colony.runtime.kit.description import Description, server_spec
from colony.runtime.kit.devices import DeviceReader
from tests.body.test_disagreements import findings, found
from tests.body.test_reader import SMALL, body_of, problems
from tests.runtime.kit.test_devices import Device

INTERFACE = """language 1
enum floor { tiles = 0, carpet = 1 }
robot small {
  frame    50 ms
  sensor   gas : percent range 0 .. 80  from Nose.gas
  sensor   on : floor                   from Nose.kind
  sensor   wet : bool                   from Nose.wet
  sensor   voltage : V                  from Nose.voltage
}
"""
BODY = (
    SMALL
    + """
[server.Nose.simulated]
device  = "value"
values.gas = { value = "5 percent", noise = "1 percent", circles = [["1 m", "2 m", "3 m", "80 percent"]] }
values.kind = { value = "tiles", members = ["tiles", "carpet"] }
values.wet = { value = false, rectangles = [["1 m", "2 m", "3 m", "4 m", true]] }
values.voltage = { value = "12 V", noise = "50 mV" }
"""
)


def test_an_interface_of_values_agrees() -> None:
    assert found(INTERFACE, BODY) == []
    gas = body_of(BODY).servers["Nose"].simulated.fields[0]  # type: ignore[union-attr]
    assert gas.name == "gas"


@pytest.mark.parametrize(
    ("old", "new", "hint"),
    [
        ('"5 percent"', "0.5", "write `0.5 percent`, or `50 percent` for 0.5 of the whole"),
        ('"1 percent"', '"0.01"', "write `0.01 percent`, or `1 percent` for 0.01 of the whole"),
        ('"80 percent"', "80", "write `80 percent`, or `8000 percent` for 80 of the whole"),
        ('"5 percent"', "0", None),
        ('"5 percent"', '"50 percent"', None),
    ],
)
def test_a_bare_number_of_a_field_in_percent_is_refused(old: str, new: str, hint: str | None) -> None:
    assert old in BODY
    found = [(d.code, d.hint) for d in findings(INTERFACE, BODY.replace(old, new))]
    assert found == ([] if hint is None else [("B007", hint)])


def test_a_server_describes_the_units_that_the_interface_declares() -> None:
    declared = INTERFACE.replace("voltage : V", "voltage : mV")
    [spec, *_] = [s for s in servers_of(body_of(BODY), load_text(declared).robot) if s.name == "Nose"]
    reader = DeviceReader(decoded_server(encoded_server(spec)), Device(), print)
    described = server_spec(Description(server="Nose", fields=reader.descriptions))
    assert {f.name: f.declared for f in described.fields} == {
        "gas": "percent",
        "kind": "",
        "wet": "",
        "voltage": "mV",
    }


@pytest.mark.parametrize(
    ("old", "new", "code", "message"),
    [
        ("voltage : V", "voltage : A", "R003", "`voltage`: Nose.voltage is V, not A"),
        ("wet : bool", "wet : percent", "R003", "`wet`: Nose.wet is bool, not percent"),
        ("carpet = 1", "rug = 1", "R003", None),
        ("0 .. 80", "0 .. 50", "B015", "`gas` has a range up to 50 percent, and its device reads 80 percent"),
        ("Nose.gas", "Nose.gass", "R002", "`gas`: Nose has no field `gass`"),
    ],
)
def test_what_does_not_fit_a_value_is_found(old: str, new: str, code: str, message: str | None) -> None:
    assert old in INTERFACE
    [(found_code, _, found_message)] = found(INTERFACE.replace(old, new), BODY)
    assert (found_code, message in (None, found_message)) == (code, True), found_message


@pytest.mark.parametrize(
    ("old", "new", "code", "message"),
    [
        ('"80 percent"', "true", "B009", "the values are of several types"),
        ('"80 percent"', '"80 V"', "B009", "the values are of several types"),
        ('"80 percent"', '"much"', "B009", "`much` is none of the `members`"),
        ('"50 mV"', '"50 mA"', "B009", "the noise is not in the unit of the value; expected one in V"),
        ('"50 mV"', '"-50 mV"', "B009", "only numbers have noise, which is a number"),
        ("value = false,", "value = false, noise = 1,", "B009", "only numbers have noise, which is a number"),
        ("value = false,", 'value = false, edge = "fading",', "B009", "only numbers fade"),
        ('value = "tiles"', 'value = "tile"', "B009", "`tile` is none of the `members`"),
        ('"12 V"', '"12 Volts"', "B007", None),
        ('"12 V"', '"12 V V"', "B006", None),
        ('"12 V"', "[12]", "B006", None),
        ('"12 V"', "1e30", "B006", None),
        ('"3 m", "80 percent"', '"0 m", "80 percent"', "B008", None),
    ],
)
def test_values_that_contradict_each_other_are_found(
    old: str, new: str, code: str, message: str | None
) -> None:
    assert old in BODY
    [(found_code, _, said)] = problems(BODY.replace(old, new, 1))
    assert (found_code, message in (None, said)) == (code, True), said


PLACES = '["75 mm", "130 mm", "150 deg"], ["-150 mm", "0 mm", "-90 deg"], ["75 mm", "-130 mm", "30 deg"]'
KIWI = f"wheels = [{PLACES}]"
DRIVE = 'kind = "differential", wheel_base = "30 cm"'


@pytest.mark.parametrize(
    ("drive", "wheels"),
    [
        ('kind = "differential"', 0),
        (DRIVE, 2),
        ('kind = "omnidirectional"', 0),
        ('kind = "omnidirectional", wheel_base = "30 cm", wheel_distance = "20 cm"', 4),
        (f'kind = "omnidirectional", {KIWI}', 3),
    ],
)
def test_wheels_may_be_described_or_not(drive: str, wheels: int) -> None:
    body = body_of(SMALL.replace(DRIVE, drive))
    assert len(body.chassis.drive.rolling) == wheels


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (f'{KIWI}, wheel_base = "30 cm"', "`wheel_base` describes mecanum wheels, and `wheels` omni wheels"),
        ('wheel_distance = "30 cm"', "`wheel_distance` alone describes no mecanum wheels"),
        (KIWI.replace("-90 deg", "0 deg").replace("150 deg", "-120 deg").replace("30 deg", "-60 deg"), None),
        (KIWI.replace("150 deg", "0 deg").replace("-90 deg", "0 deg").replace("30 deg", "0 deg"), None),
        (
            KIWI.replace("130 mm", "9 m"),
            "a place 9000.31 mm from the center of the robot; expected at most 2200 mm",
        ),
    ],
)
def test_wheels_that_cannot_hold_the_base_are_found(keys: str, message: str | None) -> None:
    found_problems = problems(SMALL.replace(DRIVE, f'kind = "omnidirectional", {keys}'))
    expected = message or "the wheels let the base slide or turn without rolling"
    assert found_problems
    assert {(code, said) for code, _, said in found_problems} == {("B009", expected)}


def test_encoders_have_the_wheels_of_the_drive() -> None:
    encoders = '[server.Wheels]\nsimulated = { device = "encoders", wheels = 3 }\n'
    assert problems(SMALL.replace(DRIVE, f'kind = "omnidirectional", {KIWI}') + encoders) == []
    undescribed = SMALL.replace(DRIVE, 'kind = "omnidirectional"')
    [(code, _, said)] = problems(undescribed + encoders)
    assert (code, said) == ("B009", "encoders of wheels that the drive does not describe")
