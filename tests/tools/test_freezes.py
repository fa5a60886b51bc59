"""A robot whose processes are frozen together; `make soak` freezes more."""

from __future__ import annotations

import tempfile
from pathlib import Path
from random import Random

import pytest

from tools.freezes import SERVERS, freezes


@pytest.mark.long
def test_every_link_is_there_again_after_freezes() -> None:
    with tempfile.TemporaryDirectory(prefix="freezes-", dir="/tmp") as folder, freezes(Path(folder)) as robot:
        lacking = [robot.round(Random(seed), 6.0) for seed in range(3)]
        assert lacking == [frozenset()] * 3
        assert robot.missing(0) == frozenset() != SERVERS
