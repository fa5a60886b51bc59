"""Options of `colony teleop`, each mistake in a line."""

from __future__ import annotations

import pytest

from colony.cli.teleop.main import LAYOUT, _layout
from colony.drivers.gamepad import AxisPart
from tests.cli.conftest import Colony
from tests.cli.machine import Machine
from tests.cli.teleop.test_inputs import LAYOUT as DEFAULT


def test_a_layout_is_changed_in_parts() -> None:
    assert _layout(LAYOUT) == DEFAULT
    changed = _layout("deadman=tr2, turn = -x*0.5,dead_zone=5percent")
    assert changed == DEFAULT._replace(deadman=0x139, turn=AxisPart(0, -0.5), dead_zone=0.05)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("--layout a=b", "--layout: found `a=b`; expected changes of deadman=tl,"),
        ("--layout deadman", "--layout: found `deadman`; expected changes of"),
        ("--layout fast=lt", "--layout: there is no button `lt`"),
        ("--layout turn=q", "--layout: there is no axis `q`"),
        ("--layout dead_zone=1", "--layout: expected a dead_zone from 0 to less than 1"),
        ("--speed 4deg/s", "--speed: found `4deg/s`; expected 1 to 100000 mm/s, such as 0.4m/s"),
        ("--turn 0", "--turn: found `0`; expected 1 to 10000 deg/s, such as 45deg/s"),
        ("--lease 6s", "--lease: found `6s`; expected 0.1 to 5 s, such as 0.3s"),
        ("--priority -1", "--priority"),
        ("", "no robot with a RServer runs on this machine"),
        ("--robot rome", "the standard input is no terminal, which has keys: give --gamepad [DEVICE]"),
        ("--robot rome --gamepad /dev/nothing", "--gamepad: /dev/nothing: No such file or directory"),
    ],
)
def test_misuse_is_one_line(machine: Machine, colony: Colony, arguments: str, said: str) -> None:
    assert said in colony.one_line("teleop", *arguments.split())
