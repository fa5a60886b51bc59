"""Gamepads: events as Linux writes them, what sysfs lists, and the driver that makes sensors of them."""

from __future__ import annotations

import fcntl
import os
import re
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from colony.drivers.gamepad import (
    REOPEN_S,
    AxisPart,
    Gamepad,
    GamepadDriver,
    GamepadError,
    InputDevice,
    axis_part,
    beyond,
    button_code,
    gamepad,
    input_devices,
    open_gamepad,
)
from colony.runtime.servers.drivers import Reading
from tests.kit.gamepad import FULL, SYN_DROPPED, SYN_REPORT, Pad, axis, key, pad
from tests.waiting import until

TL, EAST = 0x136, 0x131


@pytest.fixture
def plugged(tmp_path: Path) -> Iterator[Pad]:
    with pad(tmp_path) as made:
        yield made


# --- events ----------------------------------------------------------------------------------------------


def test_events_change_buttons_and_axes(plugged: Pad) -> None:
    device = Gamepad(str(plugged.path))
    assert (device.read(), device.pressed) == ((), set())
    plugged.send(key("tl", 1), axis("y", -FULL), axis("hat0x", 1))
    assert (device.read(), device.pressed) == ((TL,), {TL})
    assert [device.axis(code) for code in (1, 16)] == pytest.approx([-1.0, 1.0], abs=1e-3)
    assert device.axis(0) == pytest.approx(0.0, abs=1e-3)
    plugged.send(key("tl", 2), key("east", 1), key("east", 0))
    assert (device.read(), device.pressed) == ((EAST,), {TL})
    plugged.release("tl")
    assert (device.read(), device.pressed) == ((), set())
    device.close()


def test_events_may_come_in_parts(plugged: Pad) -> None:
    device = Gamepad(str(plugged.path))
    data = key("tl", 1) + axis("y", FULL) + SYN_REPORT
    for byte in data[:-1]:
        os.write(plugged._file, bytes([byte]))
        device.read()
    assert device.pressed == {TL}
    assert device.axis(1) == pytest.approx(1.0)
    device.close()


def test_where_events_were_dropped_nothing_is_held(plugged: Pad) -> None:
    """A pipe cannot be asked what is held, unlike a device."""
    device = Gamepad(str(plugged.path))
    plugged.send(key("tl", 1), axis("y", FULL))
    plugged.send(SYN_DROPPED)
    assert device.read() == (TL,)
    assert device.pressed == set()
    assert device.axis(1) == pytest.approx(0.0, abs=1e-3)
    device.close()


def test_a_gamepad_that_is_gone_raises(plugged: Pad) -> None:
    device = Gamepad(str(plugged.path))
    plugged.unplug()
    with pytest.raises(OSError, match="No such device"):
        device.read()
    device.close()


# --- names -----------------------------------------------------------------------------------------------


def test_buttons_and_axes_have_names_and_numbers() -> None:
    assert [button_code(text) for text in ("tl", " EAST ", "310", "0x136")] == [TL, EAST, TL, TL]
    found = [axis_part(text) for text in ("y", "-rx", "- x * 60", "5*0.5")]
    assert found == [AxisPart(1, 1.0), AxisPart(3, -1.0), AxisPart(0, -60.0), AxisPart(5, 0.5)]


@pytest.mark.parametrize(
    ("call", "text", "said"),
    [
        (button_code, "lt", "there is no button `lt`"),
        (axis_part, "q", "there is no axis `q`; expected x, y, z, rx"),
        (axis_part, "x * fast", "found `x * fast`; expected an axis such as -y or rx * 60"),
        (axis_part, "x * 1.2.3", "found `x * 1.2.3`; expected an axis such as -y or rx * 60"),
        (lambda text: gamepad(dead_zone=float(text)), "1", "dead_zone is 1; expected 0 to less than 1"),
    ],
)
def test_other_names_are_refused(call: object, text: str, said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        call(text)  # type: ignore[operator]


def test_a_dead_zone_takes_nothing_from_the_ends() -> None:
    assert [beyond(value, 0.2) for value in (-1.0, -0.6, -0.2, 0.1, 0.6, 1.0)] == pytest.approx(
        [-1.0, -0.5, 0.0, 0.0, 0.5, 1.0]
    )


# --- devices ---------------------------------------------------------------------------------------------


def listed(folder: Path, number: int, name: str, key: str, abs_: str) -> None:
    """Write what sysfs says of a device."""
    device = folder / f"event{number}" / "device"
    (device / "capabilities").mkdir(parents=True)
    (device / "name").write_text(f"{name}\n")
    (device / "capabilities" / "key").write_text(f"{key}\n")
    (device / "capabilities" / "abs").write_text(f"{abs_}\n")


def test_sysfs_tells_gamepads_from_other_devices(tmp_path: Path) -> None:
    keyboard = "402000000 3803078f800d001 feffffdfffefffff fffffffffffffffe"
    listed(tmp_path, 10, "Xbox Wireless Controller", "7cdb000000000000 0 0 0 0", "3003f")
    listed(tmp_path, 2, "Joystick", "ffff00000000 0 0 0 0", "3")
    listed(tmp_path, 3, "Touchpad", "e520 10000 0 0 0 0", "660800011000003")
    listed(tmp_path, 0, "AT keyboard", keyboard, "0")
    found = [(device.path, device.name, device.is_gamepad) for device in input_devices(tmp_path)]
    assert found == [
        ("/dev/input/event0", "AT keyboard", False),
        ("/dev/input/event2", "Joystick", True),
        ("/dev/input/event3", "Touchpad", False),
        ("/dev/input/event10", "Xbox Wireless Controller", True),
    ]
    assert input_devices(tmp_path / "none") == ()


def test_the_first_gamepad_that_can_be_read_is_opened(plugged: Pad, tmp_path: Path) -> None:
    others = (
        InputDevice("/dev/input/event0", "keyboard", False),
        InputDevice(str(tmp_path / "a"), "a", True),
    )
    device = open_gamepad("", lambda: (*others, InputDevice(str(plugged.path), "b", True)))
    plugged.press("tl")
    assert device.read() == (TL,)
    device.close()


def test_where_no_gamepad_can_be_read_the_message_says_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(GamepadError, match=r"no gamepad is connected; input devices: none"):
        open_gamepad("", lambda: ())
    with pytest.raises(GamepadError, match=r"no gamepad is connected; input devices: /dev/x \(keyboard\)"):
        open_gamepad("", lambda: (InputDevice("/dev/x", "keyboard", False),))
    path = str(tmp_path / "event7")
    with pytest.raises(GamepadError, match=rf"{path} \(pad\): No such file"):
        open_gamepad(path, lambda: (InputDevice(path, "pad", True),))


@pytest.mark.skipif(os.geteuid() != 0, reason="a user cannot take the right to read from itself")
def test_a_device_that_may_not_be_read_has_a_way_out(tmp_path: Path) -> None:
    path = tmp_path / "event7"
    path.touch(mode=0o600)
    os.seteuid(65534)
    try:
        with pytest.raises(GamepadError, match="add the user to the group `input`, and log in again"):
            open_gamepad(str(path), lambda: ())
    finally:
        os.seteuid(0)


# --- driver ----------------------------------------------------------------------------------------------


class Clock:
    """A clock that is set by hand. Mutable."""

    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def values(driver: GamepadDriver) -> dict[str, object]:
    return {name: reading.value for name, reading in driver.fields().items()}


def test_axes_have_values_only_while_the_deadman_is_held(plugged: Pad) -> None:
    driver = gamepad(str(plugged.path), "tl", 0.0, velocity="-y * 300", horn="south")
    plugged.move(y=-1.0)
    assert values(driver) == {"deadman": False, "horn": False}
    plugged.press("tl", "south")
    found = driver.fields()
    assert found["deadman"] == Reading(True, 0)
    assert found["horn"] == Reading(True, 0)
    assert found["velocity"].value == pytest.approx(300.0, rel=1e-3)
    plugged.release("tl")
    assert values(driver) == {"deadman": False, "horn": True}
    driver.close()


def test_without_a_gamepad_nothing_has_a_value_until_it_is_back(plugged: Pad) -> None:
    clock = Clock()
    driver = GamepadDriver(str(plugged.path), TL, 0.1, {}, {}, clock)
    plugged.press("tl")
    assert values(driver) == {"deadman": True}
    plugged.unplug()
    assert values(driver) == {}
    assert driver.problem == "the gamepad is gone: No such device"
    plugged.plug()
    assert values(driver) == {}, "it is not looked for in each frame"
    clock.now_s += REOPEN_S
    assert values(driver) == {"deadman": False}, "what was held counts no more"
    assert driver.problem is None
    plugged.path.unlink()
    plugged.unplug()
    driver.fields()
    clock.now_s += REOPEN_S
    assert values(driver) == {}
    assert driver.problem is not None
    assert "No such file" in driver.problem
    with pytest.raises(ValueError, match="no command `set`"):
        driver.command("set", {})
    driver.safe()
    driver.close()


# --- a device of the kernel ------------------------------------------------------------------------------

UINPUT = "/dev/uinput"
_SET_EV, _SET_KEY, _SET_ABS = 0x40045564, 0x40045565, 0x40045567
_CREATE, _DESTROY, _SYSNAME = 0x5501, 0x5502, 0x8040552C


@pytest.mark.skipif(not os.access(UINPUT, os.W_OK), reason=f"there is no {UINPUT} to make a device with")
def test_a_device_of_the_kernel_is_found_and_read() -> None:
    file = os.open(UINPUT, os.O_WRONLY | os.O_NONBLOCK)
    try:
        for request, code in ((_SET_EV, 1), (_SET_EV, 3), (_SET_KEY, 0x130), (_SET_KEY, TL)):
            fcntl.ioctl(file, request, code)
        least, most = [0] * 64, [0] * 64
        for code in (0, 1):
            fcntl.ioctl(file, _SET_ABS, code)
            most[code] = 255
        os.write(
            file, struct.pack("@80sHHHHI64i64i64i64i", b"colony", 3, 1, 1, 1, 0, *most, *least, *[0] * 128)
        )
        fcntl.ioctl(file, _CREATE)
        name = fcntl.ioctl(file, _SYSNAME, bytes(64)).rstrip(b"\0").decode()
        [folder] = Path(f"/sys/devices/virtual/input/{name}").glob("event*")
        path = f"/dev/input/{folder.name}"
        assert InputDevice(path, "colony", True) in input_devices()
        device = until(lambda: Path(path).exists() and open_gamepad(path), "the device is there")
        assert device.axis(1) == -1.0
        os.write(file, key("tl", 1) + axis("y", 255) + SYN_REPORT)
        until(lambda: device.read() or time.sleep(0.001), "the event is there")
        assert device.pressed == {TL}
        assert device.axis(1) == 1.0
        device._resume()
        assert (device.pressed, device.axis(1)) == ({TL}, 1.0)
        fcntl.ioctl(file, _DESTROY)
        with pytest.raises(OSError, match="No such device"):
            device.read()
        device.close()
    finally:
        os.close(file)
