"""Outputs: lamps, horns, valves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from colony.body.kinds import Named, Word, entry
from colony.ir.servers import CommandSpec, FieldSpec, ParameterSpec
from colony.ir.types import BOOL, DIMENSIONLESS

OutputKind = Literal["on", "level"]
"""The kind of an output: it is on or off, or has a level from 0 to 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """Outputs that stay as they are set, such as lamps, horns and valves."""

    outputs: Mapping[str, OutputKind] = entry(
        "outputs",
        Named(Word(("on", "level"))),
        "the outputs by name: one that is on or off, or has a level from 0 to 1",
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return tuple(
            FieldSpec(name, BOOL, "true while it is on")
            if kind == "on"
            else FieldSpec(name, DIMENSIONLESS, "the level, 0 to 1")
            for name, kind in self.outputs.items()
        )

    @property
    def commands(self) -> tuple[CommandSpec, ...]:
        """The commands that it takes."""
        return (CommandSpec("set", tuple(_parameter(*item) for item in self.outputs.items())),)


def _parameter(name: str, kind: OutputKind) -> ParameterSpec:
    if kind == "on":
        return ParameterSpec(name, BOOL, "true to switch it on")
    return ParameterSpec(name, DIMENSIONLESS, "the level, 0 to 1", low=0.0, high=1.0)
