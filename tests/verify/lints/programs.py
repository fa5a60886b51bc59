"""Small programs for one robot, and what the lints say of them."""

from __future__ import annotations

from colony.dsl.load import load_text
from colony.text.diagnostics import Diagnostic
from colony.verify.lints import lint
from tests.verify.small_robot import robot

ROBOT = robot()


USES = "contract uses: fresh(sonar) or fresh(bumper) or level >= 0 or level < 0\n"
"""Reads every sensor, so that none of them is said to be unused."""


def found(text: str, robot: str = ROBOT) -> list[tuple[str, str]]:
    """Code and message of every finding."""
    return [(d.code, d.message) for d in linted(robot + text + USES)]


def linted(text: str) -> list[Diagnostic]:
    """All that is said of a program."""
    return [finding.diagnostic for finding in lint(load_text(text))]


def codes(text: str) -> list[str]:
    return [code for code, _ in found(text)]
