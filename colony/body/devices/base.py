"""The base of a robot."""

from __future__ import annotations

from dataclasses import dataclass

from colony.ir.servers import OMNIDIRECTIONAL_RSERVER, RSERVER, CommandSpec, FieldSpec


@dataclass(frozen=True, slots=True, kw_only=True)
class Base:
    """The base: drive, dead reckoning and bumpers, as `[body]` describes them."""

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return RSERVER.fields

    @property
    def commands(self) -> tuple[CommandSpec, ...]:
        """The commands that it takes."""
        return RSERVER.commands


@dataclass(frozen=True, slots=True, kw_only=True)
class OmnidirectionalBase(Base):
    """A base that drives sideways, too."""

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return OMNIDIRECTIONAL_RSERVER.fields

    @property
    def commands(self) -> tuple[CommandSpec, ...]:
        """The commands that it takes."""
        return OMNIDIRECTIONAL_RSERVER.commands
