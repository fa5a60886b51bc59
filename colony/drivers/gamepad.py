"""Gamepads of Linux: their buttons and axes, and a driver that gives them to behaviors as sensors.

A gamepad is a device `/dev/input/event*`, which is read as events of a fixed size. A pipe of such events, as
of a recording, is read in the same way; its axes are then taken to have 16 bits. sysfs lists the devices and
what they have, also for users who may not read them. All this takes one structure and two ioctls: the library
for it, evdev, has no wheels, and reads no pipes.

    [server.Stick.hardware]
    driver   = "colony.drivers.gamepad:gamepad"
    velocity = "-y * 300"
    turn     = "-rx * 60"
    horn     = "south"
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import struct
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from colony.ir.types import ScalarValue
from colony.runtime.servers.drivers import Reading
from colony.text.wording import did_you_mean

# --- names -----------------------------------------------------------------------------------------------

_GAMEPAD, _JOYSTICK = 0x130, 0x120
"""The first buttons of gamepads and of joysticks, by which these are known."""

_NAMES = "south east - north west - tl tr tl2 tr2 select start mode thumbl thumbr".split()
BUTTONS: Mapping[str, int] = {name: _GAMEPAD + i for i, name in enumerate(_NAMES) if name != "-"}
"""The codes of buttons, by the names that Linux has for them: BTN_SOUTH is `south`."""

AXES: Mapping[str, int] = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5, "hat0x": 16, "hat0y": 17}
"""The codes of axes: ABS_RX is `rx`. Those of a stick grow to the right and backward."""

_NUMBER = re.compile(r"0x[0-9a-f]+|[0-9]+", re.IGNORECASE)
_AXIS = re.compile(r"(-?)\s*(\w+)(?:\s*\*\s*([0-9]+(?:\.[0-9]+)?))?")


class AxisPart(NamedTuple):
    """An axis, and the factor of its value."""

    code: int
    factor: float


def button_code(text: str) -> int:
    """Return the code of a button: a name such as `tl`, or a number, 310 or 0x136.

    Raises:
        ValueError: the text is neither.
    """
    return _code(text, BUTTONS, "button")


def axis_part(text: str) -> AxisPart:
    """Return what a text such as `-y`, `rx * 60` or `5` says.

    Raises:
        ValueError: it does not have this form, or there is no such axis.
    """
    found = _AXIS.fullmatch(text.strip())
    if found is None:
        raise ValueError(f"found `{text}`; expected an axis such as -y or rx * 60")
    factor = float(found[3] or 1.0)
    return AxisPart(_code(found[2], AXES, "axis"), -factor if found[1] else factor)


def _code(text: str, names: Mapping[str, int], kind: str) -> int:
    name = text.strip().lower()
    if name in names:
        return names[name]
    if _NUMBER.fullmatch(name):
        return int(name, 0)
    hint = did_you_mean(name, names) or f"expected {', '.join(names)} or a number"
    raise ValueError(f"there is no {kind} `{text}`; {hint}")


def beyond(value: float, dead_zone: float) -> float:
    """Return how far a value in [-1, 1] is beyond the dead zone around 0, as a part of the way to the end."""
    if abs(value) <= dead_zone:
        return 0.0
    return (value - dead_zone if value > 0.0 else value + dead_zone) / (1.0 - dead_zone)


# --- devices ---------------------------------------------------------------------------------------------


class GamepadError(Exception):
    """There is no gamepad, or it cannot be read; the message says what was found."""


class InputDevice(NamedTuple):
    """An input device of this machine."""

    path: str
    name: str
    is_gamepad: bool


def input_devices(inputs: Path = Path("/sys/class/input")) -> tuple[InputDevice, ...]:
    """Return the input devices that sysfs lists, in the order of their numbers."""
    folders = sorted(inputs.glob("event*"), key=lambda folder: (len(folder.name), folder.name))
    return tuple(_described(folder) for folder in folders)


def _described(folder: Path) -> InputDevice:
    def read(name: str) -> str:
        with suppress(OSError):
            return (folder / "device" / name).read_text(errors="replace").strip()
        return ""

    def bits(name: str) -> int:
        words = [int(word, 16) for word in read(f"capabilities/{name}").split()]
        return sum(word << (i * 8 * struct.calcsize("@l")) for i, word in enumerate(reversed(words)))

    keys, axes = bits("key"), bits("abs")
    is_gamepad = bool(keys >> _GAMEPAD & 1 or keys >> _JOYSTICK & 1) and axes & 3 == 3
    return InputDevice(f"/dev/input/{folder.name}", read("name"), is_gamepad)


_EVENT = struct.Struct("@llHHi")
"""An input event: two words of time, which nothing here reads, its type, code and value."""

_SYN, _KEY, _ABS = 0, 1, 3
_SYN_DROPPED = 3
_RELEASED, _PRESSED = 0, 1
_READ_BYTES = 2048 * _EVENT.size

_ABS_INFO = struct.Struct("@6i")
_KEY_BYTES = 96


def _request(number: int, size: int) -> int:
    """Return the number of an ioctl that reads `size` bytes of an input device."""
    return 2 << 30 | size << 16 | ord("E") << 8 | number


class Gamepad:
    """An open gamepad. Mutable: has the buttons and axes as they were after the last `read`.

    A button counts as pressed from its event on: one that was held before the gamepad was opened does not.

    Raises:
        OSError: the device cannot be opened.
    """

    def __init__(self, path: str) -> None:
        self._file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        self._rest = b""
        self._axes: dict[int, tuple[int, int, int]] = {}
        self.pressed: set[int] = set()

    def fileno(self) -> int:
        """Return the descriptor of the device."""
        return self._file

    def read(self) -> tuple[int, ...]:
        """Take the events that wait, and return the buttons that they press.

        Raises:
            OSError: the gamepad is gone.
        """
        try:
            data = os.read(self._file, _READ_BYTES)
        except BlockingIOError:
            return ()
        if not data:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        data = self._rest + data
        self._rest = data[len(data) - len(data) % _EVENT.size :]
        clicked, dropped = [], False
        for _, _, kind, code, value in _EVENT.iter_unpack(data[: len(data) - len(self._rest)]):
            if kind == _KEY and value == _PRESSED:
                self.pressed.add(code)
                clicked.append(code)
            elif kind == _KEY and value == _RELEASED:
                self.pressed.discard(code)
            elif kind == _ABS:
                self._axes[code] = (value, *self._info(code)[1:])
            elif kind == _SYN and code == _SYN_DROPPED:
                dropped = True
        if dropped:
            self._resume()
        return tuple(clicked)

    def axis(self, code: int) -> float:
        """Return the value of an axis in [-1, 1], 0 in the middle of its range."""
        value, low, high = self._info(code)
        return min(max(2.0 * (value - low) / max(high - low, 1) - 1.0, -1.0), 1.0)

    def close(self) -> None:
        """Close the device."""
        os.close(self._file)

    def _info(self, code: int) -> tuple[int, int, int]:
        """Return the value of an axis and the ends of its range; the device is asked once."""
        if code not in self._axes:
            try:
                found = fcntl.ioctl(self._file, _request(0x40 + code, _ABS_INFO.size), bytes(_ABS_INFO.size))
                self._axes[code] = _ABS_INFO.unpack(found)[:3]
            except OSError:  # a pipe
                is_hat = AXES["hat0x"] <= code < AXES["hat0x"] + 8
                self._axes[code] = (0, -1, 1) if is_hat else (0, -(1 << 15), (1 << 15) - 1)
        return self._axes[code]

    def _resume(self) -> None:
        """Ask the device for what it has, as it dropped events; what was pressed meanwhile does not count."""
        self._axes.clear()
        held = bytes(_KEY_BYTES)
        with suppress(OSError):
            held = fcntl.ioctl(self._file, _request(0x18, _KEY_BYTES), held)
        self.pressed = {code for code in self.pressed if held[code // 8] >> code % 8 & 1}


def open_gamepad(device: str = "", devices: Callable[[], tuple[InputDevice, ...]] = input_devices) -> Gamepad:
    """Open a device, or the first gamepad that can be read.

    Raises:
        GamepadError: there is none.
    """
    found = devices()
    names = {each.path: f"{each.path} ({each.name})" for each in found}
    paths = [device] if device else [each.path for each in found if each.is_gamepad]
    problems: list[str] = []
    for path in paths:
        try:
            return Gamepad(path)
        except PermissionError:
            text = "this user may not read it: add the user to the group `input`, and log in again"
            problems.append(f"{names.get(path, path)}: {text}")
        except OSError as problem:
            problems.append(f"{names.get(path, path)}: {problem.strerror}")
    listed = ", ".join(names.values()) or "none"
    raise GamepadError("; ".join(problems) or f"no gamepad is connected; input devices: {listed}")


# --- driver ----------------------------------------------------------------------------------------------


REOPEN_S = 1.0
"""Seconds between two attempts to open a gamepad."""


class GamepadDriver:
    """The fields of a gamepad. Mutable: has the device, which it opens again when it is gone.

    While there is a gamepad, `deadman` and the buttons have values. Axes have values only while the deadman
    is held. Reading it takes no thread, as events wait in the kernel.

    Args:
        device: the device; "" for the first gamepad.
        deadman: the code of the button that is to be held.
        dead_zone: the part of an axis around its middle that reads 0.
        buttons: codes by the names of fields.
        axes: axes with their factors by the names of fields.
        clock: the monotonic clock in seconds.
    """

    def __init__(
        self,
        device: str,
        deadman: int,
        dead_zone: float,
        buttons: Mapping[str, int],
        axes: Mapping[str, AxisPart],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._device, self._deadman, self._dead_zone = device, deadman, dead_zone
        self._buttons, self._axes, self._clock = buttons, axes, clock
        self._pad: Gamepad | None = None
        self._opened_s = -REOPEN_S
        self.problem: str | None = None

    def fields(self) -> Mapping[str, Reading]:
        """Return the fields that have a value now."""
        pad = self._read()
        return {} if pad is None else {name: Reading(value, 0) for name, value in self._values(pad)}

    def _values(self, pad: Gamepad) -> Iterator[tuple[str, ScalarValue]]:
        is_held = self._deadman in pad.pressed
        yield "deadman", is_held
        yield from ((name, code in pad.pressed) for name, code in self._buttons.items())
        for name, (code, factor) in self._axes.items() if is_held else ():
            yield name, factor * beyond(pad.axis(code), self._dead_zone)

    def _read(self) -> Gamepad | None:
        try:
            if self._pad is None:
                if self._clock() - self._opened_s < REOPEN_S:
                    return None
                self._opened_s = self._clock()
                self._pad = open_gamepad(self._device)
            self._pad.read()
            self.problem = None
        except GamepadError as problem:
            self.problem = str(problem)
        except OSError as problem:
            self.close()
            self.problem = f"the gamepad is gone: {problem.strerror}"
        return self._pad

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Refuse a command.

        Raises:
            ValueError: a gamepad has none.
        """
        raise ValueError(f"a gamepad has no command `{name}`")

    def safe(self) -> None:
        """Do nothing: a gamepad moves nothing."""

    def close(self) -> None:
        """Close the device."""
        if self._pad is not None:
            self._pad.close()
            self._pad = None


def gamepad(device: str = "", deadman: str = "tl", dead_zone: float = 0.1, **fields: str) -> GamepadDriver:
    """Return the driver of a gamepad; each other option is a field, with the button or axis that it reads.

    Raises:
        ValueError: there is no such button or axis, or the dead zone is not from 0 to less than 1.
    """
    if not 0.0 <= dead_zone < 1.0:
        raise ValueError(f"dead_zone is {dead_zone:g}; expected 0 to less than 1")
    buttons = {name: BUTTONS[text] for name, text in fields.items() if text in BUTTONS}
    axes = {name: axis_part(text) for name, text in fields.items() if name not in buttons}
    return GamepadDriver(device, button_code(deadman), dead_zone, buttons, axes)
