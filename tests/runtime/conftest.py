"""Where tests of real processes run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from tests.cli.machine import Machine
from tests.runtime.transport.live.stage import run_directory


@pytest.fixture
def environment() -> Iterator[Mapping[str, str]]:
    """A run directory of its own."""
    with run_directory() as made:
        yield made


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    made = Machine(tmp_path)
    yield made
    made.close()
