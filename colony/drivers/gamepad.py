"""Gamepads of Linux: their buttons and axes, and a driver that gives them to behaviors as sensors.

A gamepad is a device `/dev/input/event*`, which is read as events of a fixed size. A pipe of such events, as
of a recording, is read in the same way; its axes are then taken to have 16 bits. The kernel lists the devices
also for users who may not read them. All this takes one structure and two ioctls: the library for it, evdev,
has no wheels, and reads no pipes.

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
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from colony.ir.types import ScalarValue
from colony.runtime.servers.drivers import Reading
from colony.text.wording import did_you_mean

# --- names -----------------------------------------------------------------------------------------------

_NAMES = "south east - north west - tl tr tl2 tr2 select start mode thumbl thumbr".split()
BUTTONS: Mapping[str, int] = {name: 0x130 + i for i, name in enumerate(_NAMES) if name != "-"}
"""The codes of buttons, by the names that Linux has for them: BTN_SOUTH is `south`."""

AXES: Mapping[str, int] = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5, "hat0x": 16, "hat0y": 17}
"""The codes of axes: ABS_RX is `rx`. Those of a stick grow to the right and backward."""

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
    """Return the axis and the factor of a text such as `-y`, `rx * 60` or `5`.

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
    with suppress(ValueError):
        return names[name] if name in names else int(name, 0)
    hint = did_you_mean(name, names) or f"expected {', '.join(names)} or a number"
    raise ValueError(f"there is no {kind} `{text}`; {hint}")


# --- gamepads --------------------------------------------------------------------------------------------

LISTING = Path("/proc/bus/input/devices")
"""The file in which the kernel lists input devices; those of gamepads have a handler js0, js1 and so on."""

_LISTED = re.compile(r'^N: Name="(.*)"$(?:\n.+)*?\nH: Handlers=((?:.* )?(event\d+).*)$', re.MULTILINE)

_EVENT = struct.Struct("@llHHi")
"""An input event: two words of time, which nothing here reads, its type, code and value."""

_READ_BYTES = 2048 * _EVENT.size
_SYN, _KEY, _ABS = 0, 1, 3
_SYN_DROPPED = 3
_RELEASED, _PRESSED = 0, 1

_ABS_INFO = struct.Struct("@6i")
_KEY_BYTES = 96

REOPEN_S = 1.0
"""Seconds between two attempts to open a gamepad."""


def _request(number: int, size: int) -> int:
    """Return the number of an ioctl that reads `size` bytes of an input device."""
    return 2 << 30 | size << 16 | ord("E") << 8 | number


class Gamepad:
    """A gamepad, which may be gone. Mutable: has its buttons and axes as they were after the last `read`.

    A button counts as pressed from its event on: one that was held before the gamepad was opened does not.

    Args:
        device: its device; "" for the first gamepad that can be read.
        listing: the file in which the kernel lists input devices.
    """

    def __init__(self, device: str = "", listing: Path = LISTING) -> None:
        self._device, self._listing = device, listing
        self._file: int | None = None
        self._opened_s = -REOPEN_S
        self.problem = ""
        """Why it cannot be read; "" while it can."""
        self.pressed: set[int] = set()

    def fileno(self) -> int | None:
        """Return the descriptor of the device; None while it is gone."""
        return self._file

    def read(self, now_s: float) -> tuple[int, ...]:
        """Take the events that wait, and return the buttons that they press; open it first if it is gone."""
        if self._file is None and now_s - self._opened_s >= REOPEN_S:
            self._opened_s = now_s
            self._open()
        if self._file is None:
            return ()
        try:
            data = os.read(self._file, _READ_BYTES)
            if not data:
                raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        except BlockingIOError:
            return ()
        except OSError as problem:
            self.close()
            self.problem = f"the gamepad is gone: {problem.strerror}"
            return ()
        return tuple(self._take(data))

    def axis(self, code: int, dead_zone: float) -> float:
        """Return the value of an axis in [-1, 1]; the dead zone around its middle, a part of 1, is 0."""
        value, low, high = self._info(code)
        found = min(max(2.0 * (value - low) / max(high - low, 1) - 1.0, -1.0), 1.0)
        if abs(found) <= dead_zone:
            return 0.0
        return (found - dead_zone if found > 0.0 else found + dead_zone) / (1.0 - dead_zone)

    def close(self) -> None:
        """Close the device. Idempotent."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
        self.pressed.clear()

    def _open(self) -> None:
        listed: list[tuple[str, str, str]] = []
        with suppress(OSError):
            listed = _LISTED.findall(self._listing.read_text(errors="replace"))
        names = {f"/dev/input/{event}": name for name, _, event in listed}
        found = [f"/dev/input/{event}" for _, handlers, event in listed if re.search(r"\bjs\d", handlers)]
        problems: list[str] = []
        for path in [self._device] if self._device else found:
            try:
                self._file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            except PermissionError:
                problems.append(f"{path}: add this user to the group `input`, and log in again")
            except OSError as problem:
                problems.append(f"{path}: {problem.strerror}")
            else:
                self._rest, self._axes, self.problem = b"", dict[int, tuple[int, int, int]](), ""
                return
        devices = ", ".join(f"{path} ({name})" for path, name in names.items()) or "none"
        self.problem = f"{'; '.join(problems) or 'no gamepad is connected'}; input devices: {devices}"

    def _take(self, data: bytes) -> Iterator[int]:
        data = self._rest + data
        whole = len(data) - len(data) % _EVENT.size
        self._rest, dropped = data[whole:], False
        for _, _, kind, code, value in _EVENT.iter_unpack(data[:whole]):
            if kind == _KEY and value == _PRESSED:
                self.pressed.add(code)
                yield code
            elif kind == _KEY and value == _RELEASED:
                self.pressed.discard(code)
            elif kind == _ABS:
                self._axes[code] = (value, *self._info(code)[1:])
            dropped = dropped or (kind == _SYN and code == _SYN_DROPPED)
        if dropped:  # what was pressed in the meantime does not count
            self._axes.clear()
            held = self._ask(0x18, _KEY_BYTES) or bytes(_KEY_BYTES)
            self.pressed = {code for code in self.pressed if held[code // 8] >> code % 8 & 1}

    def _info(self, code: int) -> tuple[int, int, int]:
        """Return the value of an axis and the ends of its range; the device is asked once."""
        if code not in self._axes:
            found = self._ask(0x40 + code, _ABS_INFO.size)
            is_hat = AXES["hat0x"] <= code < AXES["hat0x"] + 8
            piped = (0, -1, 1) if is_hat else (0, -(1 << 15), (1 << 15) - 1)
            self._axes[code] = piped if found is None else _ABS_INFO.unpack(found)[:3]
        return self._axes[code]

    def _ask(self, number: int, size: int) -> bytes | None:
        """Return what the device answers; None if it is a pipe."""
        assert self._file is not None
        with suppress(OSError):
            return fcntl.ioctl(self._file, _request(number, size), bytes(size))
        return None


# --- driver ----------------------------------------------------------------------------------------------


class GamepadDriver:
    """The fields of a gamepad. Mutable: reads it when it is asked, as events wait in the kernel.

    While there is a gamepad, `deadman` and the buttons have values. Axes have values only while the deadman
    is held.
    """

    def __init__(
        self,
        pad: Gamepad,
        deadman: int,
        dead_zone: float,
        buttons: Mapping[str, int],
        axes: Mapping[str, AxisPart],
    ) -> None:
        self._pad, self._deadman, self._dead_zone = pad, deadman, dead_zone
        self._buttons, self._axes = buttons, axes

    @property
    def problem(self) -> str | None:
        """Why the gamepad cannot be read; None while it can."""
        return self._pad.problem or None

    def fields(self) -> Mapping[str, Reading]:
        """Return the fields that have a value now."""
        self._pad.read(time.monotonic())
        return {name: Reading(value, 0) for name, value in self._values()}

    def _values(self) -> Iterator[tuple[str, ScalarValue]]:
        if self._pad.fileno() is None:
            return
        pressed = self._pad.pressed
        yield "deadman", self._deadman in pressed
        yield from ((name, code in pressed) for name, code in self._buttons.items())
        if self._deadman in pressed:
            for name, (code, factor) in self._axes.items():
                yield name, factor * self._pad.axis(code, self._dead_zone)

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
        self._pad.close()


def gamepad(device: str = "", deadman: str = "tl", dead_zone: float = 0.1, **fields: str) -> GamepadDriver:
    """Return the driver of a gamepad; each other option is a field, with the button or axis that it reads.

    Raises:
        ValueError: there is no such button or axis, or the dead zone is not from 0 to less than 1.
    """
    if not 0.0 <= dead_zone < 1.0:
        raise ValueError(f"dead_zone is {dead_zone:g}; expected 0 to less than 1")
    buttons = {name: BUTTONS[text] for name, text in fields.items() if text in BUTTONS}
    axes = {name: axis_part(text) for name, text in fields.items() if name not in buttons}
    return GamepadDriver(Gamepad(device), button_code(deadman), dead_zone, buttons, axes)
