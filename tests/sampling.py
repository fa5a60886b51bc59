"""What takes long: `make test` runs a sample of it, `make test-long` or `make test-thorough` the rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import pytest
from _pytest.mark import ParameterSet

T = TypeVar("T")


def long(*values: object) -> ParameterSet:
    """Return parameters of a test that `make test-long` runs alone."""
    return pytest.param(*values, marks=pytest.mark.long)


def thorough(*values: object) -> ParameterSet:
    """Return parameters of a test that `make test-thorough` runs alone."""
    return pytest.param(*values, marks=pytest.mark.thorough)


def sampled(values: Sequence[T], *, every: int, thorough: bool = False) -> list[T | ParameterSet]:
    """Return parameters of which `make test` runs the first, and each that is `every` places after one.

    `make test-long` runs the others; if they are `thorough`, only `make test-thorough` does.
    """
    mark = pytest.mark.thorough if thorough else pytest.mark.long
    return [pytest.param(value, marks=mark) if at % every else value for at, value in enumerate(values)]
