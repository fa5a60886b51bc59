"""The drivers of real devices: classes of users, imported and made in the process of the device's server.

A driver is not trusted to work. What goes wrong when it is imported or made ends its process with a message;
what it raises later is reported, and counts as no value or as a command that was not sent.
"""

from __future__ import annotations

import importlib
import inspect
import reprlib
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from colony.runtime.assembly.processes.spec import DriverError, HardwareDriver
from colony.runtime.kit.once import OnceReporter, Report, exception_text, failure_text
from colony.runtime.servers.commanding import NotSentError
from colony.runtime.servers.drivers import (
    BaseLimits,
    BaseState,
    DeviceDriver,
    is_opening,
    problems_of,
    unreached_of,
)
from colony.runtime.transport.live.robot_address import RobotAddress
from colony.text.wording import did_you_mean, listed

DEVICE_METHODS = ("fields", "command", "safe", "close")
BASE_METHODS = ("drive", "stop", "state")
"""The methods that drivers have."""


MAX_MAGNITUDE = 1e9
"""Maximum magnitude of what a base measures, in mm, deg and s: 1000 km."""

_MEASURED = tuple(field.name for field in fields(BaseState) if field.name != "t_ns")


def load_driver(hardware: HardwareDriver, robot_address: RobotAddress | None = None) -> Any:
    """Import the class of a driver, and make the driver.

    A driver with a parameter `frame_ns` or `robot_address` that the body does not give is given these.

    Raises:
        DriverError: it cannot be imported, or made.
    """
    sys.path += [folder for folder in hardware.search_path if folder not in sys.path]
    module_name, _, name = hardware.driver.partition(":")
    try:
        module = importlib.import_module(module_name)
    except (Exception, SystemExit) as problem:
        raise _error(hardware, "cannot be imported", _why(problem, hardware), is_final=True) from None
    make = getattr(module, name, None)
    if not callable(make):
        hint = did_you_mean(name, [known for known in vars(module) if not known.startswith("_")])
        why = f"`{module.__file__}` has no class `{name}`" + (f"; {hint}" if hint else "")
        raise _error(hardware, "cannot be imported", why, is_final=True)
    try:
        listen = {"listen": True} if hardware.listens else {}
        known = {"frame_ns": hardware.frame_ns, "robot_address": robot_address}
        return make(**{**_asked(make, known), **listen, **hardware.options})
    except (Exception, SystemExit) as problem:
        raise _error(hardware, "cannot be made", _why(problem, hardware), is_final=False) from None


def _asked(make: Callable[..., Any], given: Mapping[str, object]) -> dict[str, object]:
    """Return what a driver has a parameter for."""
    try:
        parameters = inspect.signature(make).parameters
    except (TypeError, ValueError):  # of something without a signature
        return {}
    return {name: value for name, value in given.items() if name in parameters}


def device_driver(driver: Any, hardware: HardwareDriver, commands: Iterable[str] = ()) -> DeviceDriver:
    """Return a driver as one of a device with fields and these commands.

    Raises:
        DriverError: it lacks a method, or says that it lacks a command.
    """
    _expect_methods(driver, hardware, DEVICE_METHODS)
    known = getattr(driver, "commands", None)
    if isinstance(known, Set) and (missing := [name for name in commands if name not in known]):
        close_driver(driver, lambda text: None)
        why = f"it has no command {listed([f'`{name}`' for name in missing], 'or')}"
        raise _error(hardware, "does not fit the interface", why, is_final=True)
    checked: DeviceDriver = driver
    return checked


def close_driver(driver: Any, report: Report) -> None:
    """Close a driver, if it can be closed; report what it raises."""
    try:
        close = getattr(driver, "close", None)
        if close is not None:
            close()
    except Exception as problem:
        report(failure_text("close of the driver", problem))


class HardwareBase:
    """The base over the driver of a user, which has the methods `drive`, `stop` and `state` of `BaseDriver`.

    One that drives sideways has the `drive` of `OmnidirectionalDriver`. Its limits are those of the robot's
    body. The driver's times are of `time.monotonic_ns`. Mutable: remembers which problems it has reported.

    Raises:
        DriverError: the driver lacks a method.
    """

    def __init__(
        self,
        driver: Any,
        limits: BaseLimits,
        hardware: HardwareDriver,
        *,
        origin_ns: int,
        report: Report,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        _expect_methods(driver, hardware, BASE_METHODS)
        self.limits = limits
        self.register_bits: int | None = getattr(driver, "register_bits", None)
        self._driver = driver
        self._name = hardware.driver
        self._origin_ns = origin_ns
        self._clock = clock
        self._report = report
        self._problems = OnceReporter(report)
        self._stop_failure: str | None = None
        self.rest: Callable[[], None] | None = None if not hasattr(driver, "rest") else self._rest

    @property
    def problem(self) -> str | None:
        """What fails at the base now, or None: what the driver says itself, or else which methods fail."""
        return "; ".join(problems_of(self._driver) or self._problems.failing) or None

    @property
    def is_opening(self) -> bool:
        """True while the base is being opened, and has not failed."""
        return is_opening(self._driver)

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> None:
        """Drive.

        Raises:
            NotSentError: the driver failed.
        """
        speeds = (velocity, turn, sideways) if self.limits.sideways > 0.0 else (velocity, turn)
        try:
            self._driver.drive(*speeds)
        except (Exception, SystemExit) as problem:
            self._note("drive", problem)
            why = f"{type(problem).__name__}: {reprlib.repr(exception_text(problem))}"
            raise NotSentError(f"{self._name} failed to drive: {why}") from None

    def stop(self) -> None:
        """Stop."""
        self._stop_failure = None
        try:
            self._driver.stop()
        except (Exception, SystemExit) as problem:
            self._note("stop", problem)
            self._stop_failure = f"{self._name} failed to stop: {exception_text(problem)}"

    def _rest(self) -> None:
        try:
            self._driver.rest()
        except (Exception, SystemExit) as problem:
            self._note("rest", problem)

    @property
    def unreached(self) -> str | None:
        """Why the last stop has not reached the base, or not yet; None if it has."""
        return self._stop_failure or next(iter(unreached_of(self._driver)), None)

    def watch_bumpers(self, watched: bool) -> None:
        """Have the base stop by itself at a bumper or not, if its driver has a method for that."""
        try:
            watch = getattr(self._driver, "watch_bumpers", None)
            if watch is not None:
                watch(watched)
        except (Exception, SystemExit) as problem:
            self._note("watch_bumpers", problem)

    def state(self) -> BaseState | None:
        """Return the newest snapshot, in the time of the robot; None if there is none, or no valid one."""
        self._problems.end_frame()
        try:
            found: BaseState | None = self._driver.state()
            if found is None:
                return None
            _expect_valid(found, self._clock())
            return replace(found, t_ns=found.t_ns - self._origin_ns)
        except (Exception, SystemExit) as problem:
            self._note("state", problem)
            return None

    def close(self) -> None:
        """Close the driver, if it can be closed."""
        close_driver(self._driver, self._report)

    def _note(self, method: str, problem: BaseException) -> None:
        if isinstance(problem, OSError) and (problems_of(self._driver) or self.is_opening):
            return  # the driver says itself why its device does not work
        text = failure_text(f"{method} of {self._name}", problem)
        self._problems.report(method, type(problem).__name__, text)


def _expect_valid(state: Any, now_ns: int) -> None:
    """Raise TypeError or ValueError unless it is a snapshot of a base, taken up to now."""
    if not isinstance(state, BaseState):
        raise TypeError(f"returned a {type(state).__name__}; expected a BaseState or None")
    if isinstance(state.t_ns, bool) or not isinstance(state.t_ns, int):
        raise TypeError(f"t_ns is {state.t_ns!r:.100}; expected whole nanoseconds")
    if state.t_ns > now_ns:
        raise ValueError(f"a snapshot from the future, by {state.t_ns - now_ns} ns of time.monotonic_ns()")
    if state.t_ns < 0:
        raise ValueError("t_ns is below 0; expected the time by time.monotonic_ns()")
    for name in _MEASURED:
        value = getattr(state, name)
        if name.endswith("bumper"):
            if not isinstance(value, bool):
                raise TypeError(f"{name} is {value!r:.100}; expected True or False")
        elif (
            isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= MAX_MAGNITUDE
        ):
            raise TypeError(f"{name} is {value!r:.100}; expected a finite number, up to {MAX_MAGNITUDE:g}")


def _expect_methods(driver: Any, hardware: HardwareDriver, names: tuple[str, ...]) -> None:
    missing = [name for name in names if not callable(getattr(driver, name, None))]
    if missing:
        close_driver(driver, lambda text: None)
        why = f"it has no {listed([f'`{name}`' for name in missing], 'and')}"
        expected = f"; a driver has the methods {listed(list(names), 'and')}"
        raise _error(hardware, "is no driver", why + expected, is_final=True)


def _error(hardware: HardwareDriver, what: str, why: str, *, is_final: bool) -> DriverError:
    origin = f"{hardware.origin}: " if hardware.origin else ""
    return DriverError(f"{origin}the driver `{hardware.driver}` {what}: {why}", is_final=is_final)


def _why(problem: BaseException, hardware: HardwareDriver) -> str:
    """Return what was raised and where: the last line in the user's folders, else the last of all."""
    text = f"{type(problem).__name__}: {exception_text(problem)}".rstrip(": ")
    if isinstance(problem, SyntaxError) and problem.filename:
        return f"{problem.filename}:{problem.lineno}: {type(problem).__name__}: {problem.msg}"
    frames = [
        frame
        for frame in traceback.extract_tb(problem.__traceback__)
        if frame.filename != __file__ and "importlib" not in frame.filename
    ]
    own = [frame for frame in frames if _is_within(frame.filename, hardware.search_path)]
    if not frames:
        return text
    place = (own or frames)[-1]
    return f"{place.filename}:{place.lineno}: {text}"


def _is_within(file: str, folders: tuple[str, ...]) -> bool:
    return any(Path(file).is_relative_to(folder) for folder in folders)
