"""What a hand asks for, at a gamepad and at the keys of a terminal."""

from __future__ import annotations

import os
import pty
import signal
import termios
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from colony.cli.interruption import termination_signals
from colony.cli.teleop.inputs import HOLD_S, REPEAT_S, GamepadInput, Hand, Keyboard, PadLayout, single_keys
from colony.drivers.gamepad import REOPEN_S, AxisPart, Gamepad, button_code
from tests.kit.gamepad import pad

AHEAD, LEFT = Hand(1.0, 0.0, 0.0), Hand(0.0, 1.0, 0.0)


class Keys:
    """A terminal: the end that is typed at, and a keyboard at the other one."""

    def __init__(self, typed: int, file: int) -> None:
        self.typed, self.file = typed, file
        self.keyboard = Keyboard(file)

    def type(self, data: bytes, now_s: float) -> str:
        os.write(self.typed, data)
        return self.keyboard.read(now_s)


@pytest.fixture(autouse=True)
def handlers() -> Iterator[None]:
    """The handlers of signals are those of before."""
    before = {number: signal.getsignal(number) for number in termination_signals()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def keys() -> Iterator[Keys]:
    typed, file = pty.openpty()
    with open(typed, "wb", buffering=0), open(file, "rb"), single_keys(file):
        yield Keys(typed, file)


def test_a_key_is_held_until_it_repeats_and_a_little_longer(keys: Keys) -> None:
    assert keys.keyboard.hand(0.0) is None
    assert keys.type(b"w", 10.0) == ""
    assert [keys.keyboard.hand(10.0 + HOLD_S + x) for x in (-0.01, 0.0)] == [AHEAD, None]
    keys.type(b"w", 10.5)
    assert keys.keyboard.holds_s(10.5) == pytest.approx(REPEAT_S)
    keys.type(b"w", 10.6)
    assert [keys.keyboard.hand(10.6 + REPEAT_S + x) for x in (-0.01, 0.0)] == [AHEAD, None]


@pytest.mark.parametrize("key", [b" ", b"e", b"\x1b", b"\x1b[5~", b"\t"])
def test_another_key_takes_its_place_and_any_else_lets_go(keys: Keys, key: bytes) -> None:
    keys.type(b"w", 0.0)
    keys.type(b"a", 0.1)
    assert keys.keyboard.hand(0.1) == LEFT
    keys.type(key, 0.2)
    assert keys.keyboard.hand(0.2) is None


@pytest.mark.parametrize(
    ("typed", "asked"),
    [
        (b"s", Hand(-1.0, 0.0, 0.0)),
        (b"d", Hand(0.0, -1.0, 0.0)),
        (b",", Hand(0.0, 0.0, 1.0)),
        (b".", Hand(0.0, 0.0, -1.0)),
        (b"W", Hand(1.0, 0.0, 0.0, fast=True)),
        (b"\x1b[A", AHEAD),
        (b"\x1bOD", LEFT),
        (b"\x1b[1;2B", Hand(-1.0, 0.0, 0.0)),
        (b"\x1b\x1b[C", Hand(0.0, -1.0, 0.0)),
    ],
)
def test_keys_and_arrows(keys: Keys, typed: bytes, asked: Hand) -> None:
    keys.type(typed, 0.0)
    assert keys.keyboard.hand(0.0) == asked


def test_an_arrow_that_comes_in_parts_is_no_letter(keys: Keys) -> None:
    """`A` alone would be a fast turn to the left."""
    for part in (b"\x1b", b"[", b"A"):
        keys.type(part, 0.0)
    assert keys.keyboard.hand(0.0) == AHEAD


def test_stop_and_quit(keys: Keys) -> None:
    keys.type(b"w", 0.0)
    assert keys.type(b"x", 0.1) == "stop"
    assert keys.keyboard.hand(0.1) is None
    assert keys.type(b"q", 0.2) == "quit"


def test_a_terminal_that_is_closed_is_the_end() -> None:
    typed, file = pty.openpty()
    keyboard = Keyboard(file)
    os.close(typed)
    assert keyboard.read(0.0) == "quit"
    os.close(file)


def failing() -> None:
    raise ZeroDivisionError


@pytest.mark.parametrize(
    ("happens", "raised"),
    [
        (failing, ZeroDivisionError),
        (lambda: signal.raise_signal(signal.SIGTERM), KeyboardInterrupt),
        (lambda: signal.raise_signal(signal.SIGQUIT), KeyboardInterrupt),
        (lambda: signal.raise_signal(signal.SIGINT), KeyboardInterrupt),
    ],
)
def test_the_terminal_is_as_before_whatever_happens(
    happens: Callable[[], None], raised: type[BaseException]
) -> None:
    typed, file = pty.openpty()
    before = termios.tcgetattr(file)

    def fail() -> None:
        with single_keys(file):
            assert not termios.tcgetattr(file)[3] & (termios.ICANON | termios.ECHO)
            happens()

    with pytest.raises(raised):
        fail()
    assert termios.tcgetattr(file) == before
    os.close(typed)
    os.close(file)


# --- gamepad ---------------------------------------------------------------------------------------------

LAYOUT = PadLayout(
    deadman=button_code("tl"),
    fast=button_code("tr"),
    stop=button_code("east"),
    velocity=AxisPart(1, -1.0),
    turn=AxisPart(3, -1.0),
    sideways=AxisPart(0, -1.0),
    dead_zone=0.1,
)


def test_a_gamepad_is_held_by_its_deadman(tmp_path: Path) -> None:
    with pad(tmp_path) as made:
        device = Gamepad(str(made.path))
        source = GamepadInput(device, LAYOUT)
        made.move(y=-1.0, rx=0.05)
        assert (source.read(0.0), source.hand(0.0)) == ("", None)
        made.press("tl")
        source.read(0.0)
        assert source.hand(0.0) == pytest.approx(Hand(1.0, 0.0, 0.0), abs=1e-3)
        made.press("tr")
        source.read(0.0)
        assert (found := source.hand(0.0)) is not None
        assert found.fast
        made.press("east")
        assert source.read(0.0) == "stop"
        source.release()
        assert source.hand(0.0) is None
        made.release("tl")
        made.press("tl")
        source.read(0.0)
        assert source.hand(0.0) is not None
        device.close()


def test_a_gamepad_that_is_unplugged_lets_go_and_may_come_back(tmp_path: Path) -> None:
    with pad(tmp_path) as made:
        device = Gamepad(str(made.path))
        source = GamepadInput(device, LAYOUT)
        made.press("tl")
        source.read(0.0)
        made.unplug()
        assert (source.read(1.0), source.hand(1.0), source.fileno()) == ("", None, None)
        assert source.problem == "the gamepad is gone: No such device"
        made.plug()
        source.read(1.0 + REOPEN_S)
        assert (source.problem, source.hand(0.0)) == ("", None)
        made.press("tl")
        source.read(3.0)
        assert source.hand(0.0) is not None
        device.close()
