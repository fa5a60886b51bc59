"""Lint of sensors that nothing reads."""

from __future__ import annotations

from collections.abc import Iterator

from colony.text.diagnostics import Diagnostic, warning
from colony.verify.contracts.results import with_reaches
from colony.verify.lints.case import Case
from colony.verify.testing.frames import sensors_read


def findings(case: Case) -> Iterator[Diagnostic]:
    """Yield the warnings about unused sensors of the main file; an imported robot may have unused ones."""
    read = sensors_read(with_reaches(case.program))
    for sensor in case.program.robot.sensors:
        if case.is_own(sensor.span) and sensor.name not in read:
            yield warning(
                "V028",
                sensor.span,
                f"nothing reads the sensor `{sensor.name}`",
                "remove it, or use it",
            )
