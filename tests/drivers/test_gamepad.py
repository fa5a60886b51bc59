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
    axis_part,
    button_code,
    gamepad,
)
from colony.runtime.servers.drivers import Reading
from tests.kit.gamepad import FULL, SYN_DROPPED, SYN_REPORT, Pad, axis, key, pad
from tests.waiting import until

TL, EAST = 0x136, 0x131


@pytest.fixture
def plugged(tmp_path: Path) -> Iterator[Pad]:
    with pad(tmp_path) as made:
        yield made


def opened(plugged: Pad) -> Gamepad:
    """Return a gamepad that is open, and has no events yet."""
    device = Gamepad(str(plugged.path))
    assert device.read(0.0) == ()
    assert device.problem == ""
    return device


# --- events ----------------------------------------------------------------------------------------------


def test_events_change_buttons_and_axes(plugged: Pad) -> None:
    device = opened(plugged)
    assert (device.read(0.0), device.pressed) == ((), set())
    plugged.send(key("tl", 1), axis("y", -FULL), axis("hat0x", 1))
    assert (device.read(0.0), device.pressed) == ((TL,), {TL})
    assert [device.axis(code, 0.0) for code in (1, 16)] == pytest.approx([-1.0, 1.0], abs=1e-3)
    assert device.axis(0, 0.0) == pytest.approx(0.0, abs=1e-3)
    plugged.send(key("tl", 2), key("east", 1), key("east", 0))
    assert (device.read(0.0), device.pressed) == ((EAST,), {TL})
    plugged.release("tl")
    assert (device.read(0.0), device.pressed) == ((), set())
    device.close()


def test_events_may_come_in_parts(plugged: Pad) -> None:
    device = opened(plugged)
    data = key("tl", 1) + axis("y", FULL) + SYN_REPORT
    for byte in data[:-1]:
        os.write(plugged._file, bytes([byte]))
        device.read(0.0)
    assert device.pressed == {TL}
    assert device.axis(1, 0.0) == pytest.approx(1.0)
    device.close()


def test_where_events_were_dropped_nothing_is_held(plugged: Pad) -> None:
    """A pipe cannot be asked what is held, unlike a device."""
    device = opened(plugged)
    plugged.send(key("tl", 1), axis("y", FULL))
    plugged.send(SYN_DROPPED)
    assert device.read(0.0) == (TL,)
    assert device.pressed == set()
    assert device.axis(1, 0.0) == pytest.approx(0.0, abs=1e-3)
    device.close()


def test_a_gamepad_that_is_gone_holds_nothing_and_is_opened_again(plugged: Pad) -> None:
    device = opened(plugged)
    plugged.press("tl")
    device.read(0.0)
    plugged.unplug()
    assert (device.read(5.0), device.pressed, device.fileno()) == ((), set(), None)
    assert device.problem == "the gamepad is gone: No such device"
    plugged.plug()
    device.read(5.5)
    assert (device.fileno() is not None, device.problem, device.pressed) == (True, "", set())
    plugged.unplug()
    device.read(5.6)
    plugged.plug()
    device.read(5.7)
    assert device.fileno() is None, "it is not looked for all the time"
    device.read(5.5 + REOPEN_S)
    assert device.fileno() is not None
    device.close()
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


def test_a_dead_zone_takes_nothing_from_the_ends(plugged: Pad) -> None:
    device = opened(plugged)
    found = []
    for part in (-1.0, -0.6, -0.2, 0.1, 0.6, 1.0):
        plugged.move(y=part)
        device.read(0.0)
        found.append(device.axis(1, 0.2))
    assert found == pytest.approx([-1.0, -0.5, 0.0, 0.0, 0.5, 1.0], abs=1e-4)
    device.close()


# --- devices ---------------------------------------------------------------------------------------------

LISTED = """\
I: Bus=0011 Vendor=0001 Product=0001 Version=ab41
N: Name="AT Translated Set 2 keyboard"
P: Phys=isa0060/serio0/input0
H: Handlers=sysrq kbd event0 leds
B: EV=120013

I: Bus=0003 Vendor=045e Product=028e Version=0114
N: Name="Microsoft X-Box 360 pad"
P: Phys=usb-0000:00:14.0-1/input0
S: Sysfs=/devices/pci0000:00/input/input17
H: Handlers=event{a} js0
B: KEY=7cdb000000000000 0 0 0 0

I: Bus=0005 Vendor=054c Product=09cc Version=8100
N: Name="Wireless Controller"
H: Handlers=js1 event{b}
B: ABS=3003f
"""


def listing(folder: Path, text: str) -> Path:
    path = folder / "devices"
    path.write_text(text)
    return path


def test_where_no_gamepad_can_be_read_the_problem_says_what_is_there(tmp_path: Path) -> None:
    def problem(device: str, listing: Path) -> str:
        pad = Gamepad(device, listing)
        pad.read(0.0)
        return pad.problem

    assert problem("", tmp_path / "none") == "no gamepad is connected; input devices: none"
    keyboard = LISTED.partition("\n\n")[0]
    names = "/dev/input/event0 (AT Translated Set 2 keyboard)"
    found = problem("", listing(tmp_path, keyboard))
    assert found == f"no gamepad is connected; input devices: {names}"
    every = listing(tmp_path, LISTED.format(a=900, b=901))
    names += ", /dev/input/event900 (Microsoft X-Box 360 pad), /dev/input/event901 (Wireless Controller)"
    gone = "/dev/input/event900: No such file or directory; /dev/input/event901: No such file or directory"
    assert problem("", every) == f"{gone}; input devices: {names}"
    path = tmp_path / "event7"
    assert problem(str(path), every) == f"{path}: No such file or directory; input devices: {names}"


@pytest.mark.skipif(os.geteuid() != 0, reason="a user cannot take the right to read from itself")
def test_a_device_that_may_not_be_read_has_a_way_out(tmp_path: Path) -> None:
    path = tmp_path / "event7"
    path.touch(mode=0o600)
    device = Gamepad(str(path))
    os.seteuid(65534)
    try:
        device.read(0.0)
    finally:
        os.seteuid(0)
    assert device.problem.startswith(f"{path}: add this user to the group `input`, and log in again")


# --- driver ----------------------------------------------------------------------------------------------


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


def test_without_a_gamepad_nothing_has_a_value(plugged: Pad) -> None:
    driver = gamepad(str(plugged.path))
    plugged.press("tl")
    assert (values(driver), driver.problem) == ({"deadman": True}, None)
    plugged.unplug()
    assert (values(driver), driver.problem) == ({}, "the gamepad is gone: No such device")
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
        device = Gamepad(path)
        until(lambda: device.read(time.monotonic()) or device.fileno(), "the device is there")
        assert device.axis(1, 0.0) == -1.0
        os.write(file, key("tl", 1) + axis("y", 255) + SYN_REPORT)
        until(lambda: device.read(0.0), "the event is there")
        assert device.pressed == {TL}
        assert device.axis(1, 0.0) == 1.0
        assert list(device._take(SYN_DROPPED)) == []
        assert (device.pressed, device.axis(1, 0.0)) == ({TL}, 1.0), "the device says what it has"
        fcntl.ioctl(file, _DESTROY)
        device.read(0.0)
        assert device.problem == "the gamepad is gone: No such device"
    finally:
        os.close(file)
