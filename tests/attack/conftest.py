"""One robot behind a gateway for all attacks of a worker."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.attack.lab import Lab
from tools.attack.lab import lab as open_lab


@pytest.fixture(scope="package")
def folder() -> Iterator[Path]:
    """A folder with a short path, as sockets need it."""
    made = Path(tempfile.mkdtemp(prefix="colony-", dir="/tmp"))
    yield made
    shutil.rmtree(made)


@pytest.fixture(scope="package")
def lab(folder: Path) -> Iterator[Lab]:
    with open_lab(folder) as made:
        yield made
