"""Buttons and switches."""

from __future__ import annotations

from dataclasses import dataclass

from colony.body.devices.common import FIELD_NAME, Sensor
from colony.body.kinds import Many, entry
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL


@dataclass(frozen=True, slots=True, kw_only=True)
class Button(Sensor):
    """Buttons and switches, which `--set` and scenarios press; otherwise they are released."""

    names: tuple[str, ...] = entry("fields", Many(FIELD_NAME, 1, 100), "the fields, one for each button")

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return tuple(FieldSpec(name, BOOL, "true while it is pressed") for name in self.names)
