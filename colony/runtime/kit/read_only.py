"""Servers that command nothing: another controller drives the robot, and they hear what it commands."""

from __future__ import annotations

from collections.abc import Iterable

from colony.ir.servers import CommandSpec, ParameterSpec, ServerSpec
from colony.ir.types import Bool, ScalarValue
from colony.runtime.frames.publishing import Fields
from colony.runtime.kit.description import FieldDescription
from colony.runtime.kit.once import Report
from colony.runtime.kit.service import Reads, Service, method
from colony.runtime.protocol.bindings import heard_name
from colony.runtime.protocol.calls import RefusedError
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import MAX_DEPLOYMENT_BYTES, READ_ONLY, Deployment
from colony.runtime.protocol.messages import Sample
from colony.runtime.servers.base import Base
from colony.runtime.servers.drivers import BaseDriver, ListeningDriver, is_opening, problems_of


class BaseReader:
    """Reads the fields of a base for the frames of a server that does not drive it."""

    descriptions: tuple[FieldDescription, ...] = ()

    def __init__(self, driver: BaseDriver) -> None:
        self._driver, self._base = driver, Base(driver)

    @property
    def failing(self) -> tuple[str, ...]:
        """One line for each problem that the driver has now."""
        return problems_of(self._driver)

    @property
    def opening(self) -> bool:
        """True while the base is being opened."""
        return is_opening(self._driver)

    def read(self, now_ns: int) -> Fields:
        """Return the fields at `now_ns`."""
        self._base.refresh()
        return self._base.fields(now_ns)


class ListeningReader:
    """Reads the fields of a device or a base, and what another controller commands.

    Args:
        reader: reads the fields.
        driver: hears the commands.
        commands: the commands of the server.
    """

    def __init__(self, reader: Reads, driver: ListeningDriver, commands: Iterable[CommandSpec]) -> None:
        self._reader, self._driver, self._commands = reader, driver, tuple(commands)

    @property
    def descriptions(self) -> tuple[FieldDescription, ...]:
        """The descriptions of the fields, and of the commands that are heard."""
        meaning = "the parameters that another controller commanded, in base units"
        heard = (
            FieldDescription(
                name=heard_name(c.name), kind="number", size=max(1, len(c.parameters)), meaning=meaning
            )
            for c in self._commands
        )
        return (*self._reader.descriptions, *heard)

    @property
    def failing(self) -> tuple[str, ...]:
        """One line for each problem of the driver."""
        return self._reader.failing

    @property
    def opening(self) -> bool:
        """True while the device is being opened."""
        return self._reader.opening

    def read(self, now_ns: int) -> Fields:
        """Return the fields at `now_ns`; None, or nothing, for those without a value."""
        fields, overheard = dict(self._reader.read(now_ns)), self._driver.overheard()
        for command in self._commands:
            if (found := overheard.get(command.name)) is not None:
                values = tuple([_in_base_unit(p, found.values.get(p.name)) for p in command.parameters])
                fields[heard_name(command.name)] = Sample(values, now_ns - found.age_ns)
        return fields


def _in_base_unit(parameter: ParameterSpec, value: ScalarValue | None) -> ScalarValue:
    if isinstance(parameter.type, Bool):
        return bool(value)
    return 0.0 if value is None else value * parameter.factor


def listening_server(spec: ServerSpec, reader: Reads, driver: ListeningDriver, report: Report) -> Service:
    """Return a server that refuses programs, and publishes what another controller commands.

    Args:
        spec: its fields, and the commands that it hears.
        reader: reads the fields.
        driver: hears the commands.
        report: takes each problem.
    """

    def refuse(caller: Caller, deployed: Deployment) -> None:
        raise RefusedError("read only", READ_ONLY)

    return Service(
        spec.name,
        (method("deploy", Deployment, refuse, max_bytes=MAX_DEPLOYMENT_BYTES),),
        ListeningReader(reader, driver, spec.commands),
        report,
        is_expected=True,
    )
