"""Checks of the frames that programs pass to colony as a library; numpy numbers become Python numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from operator import index
from reprlib import repr as short
from typing import Any

from colony.execute.executor import ProgramExecutor
from colony.execute.validity import MAX_TIME_NS
from colony.ir.frame import NOTHING_GIVEN, Answer, Frame, Outcome, OverriddenCommand
from colony.ir.program import Sensor
from colony.text.wording import did_you_mean, quoted


class CheckedExecutor(ProgramExecutor):
    """An executor of a program that refuses invalid frames."""

    _last_ns: int | None = None

    def step(
        self,
        frame: Frame,
        answers: Mapping[str, Answer] | None = None,
        given: Mapping[str, OverriddenCommand] = NOTHING_GIVEN,
    ) -> Outcome:
        """Execute one frame and return its outcome.

        Raises:
            TypeError: it is not a frame, its readings are not a mapping, or a time is not an integer.
            ValueError: its time is not later than that of the previous frame, or a name is that of no sensor.
        """
        checked = checked_frame(frame, self._last_ns, self.code.sensors)
        self._last_ns = checked.t_ns
        return super().step(checked, answers, given)

    def restart(self) -> None:
        """Restart from the initial memory; the next frame may have any time."""
        self._last_ns = None
        super().restart()


def checked_trace(frames: Iterable[Frame], sensors: Iterable[Sensor]) -> tuple[Frame, ...]:
    """Return consecutive frames of a robot with these sensors, each checked by `checked_frame`.

    Raises:
        TypeError: `frames` is not iterable, or as `checked_frame`.
        ValueError: as `checked_frame`.
    """
    if not isinstance(frames, Iterable):
        raise TypeError(f"found {short(frames)}; expected frames")
    trace: list[Frame] = []
    for frame in frames:
        trace.append(checked_frame(frame, trace[-1].t_ns if trace else None, sensors))
    return tuple(trace)


def checked_frame(frame: Frame, after_ns: int | None, sensors: Iterable[Sensor]) -> Frame:
    """Return a frame of a robot with these sensors, with Python numbers in place of numpy numbers.

    Raises:
        TypeError: it is not a frame, its readings are not a mapping, a time is not an integer, or `restarted`
            is not a bool.
        ValueError: a time does not fit into 63 bits, the frame's is not later than `after_ns`, or a name is
            that of no sensor.
    """
    if not isinstance(frame, Frame):
        raise TypeError(f"found {short(frame)}; expected a colony.Frame")
    for name, value in (("readings", frame.readings), ("taken_ns", frame.taken_ns)):
        if not isinstance(value, Mapping):
            raise TypeError(f"{name}: found {short(value)}; expected a mapping from names of sensors")
    names = {sensor.name for sensor in sensors}
    for name in (*frame.readings, *frame.taken_ns):
        if name not in names:
            hint = did_you_mean(str(name), names) or f"the robot has {quoted(sorted(names))}"
            raise ValueError(f"readings: found {short(name)}, which is no sensor; {hint}")
    t_ns = _time("t_ns", frame.t_ns)
    if after_ns is not None and t_ns <= after_ns:
        raise ValueError(f"t_ns: found {t_ns} after {after_ns}; expected a later time in each frame")
    readings = {name: _without_numpy(reading) for name, reading in frame.readings.items()}
    taken_ns = {name: _time(f"taken_ns of {name}", time_ns) for name, time_ns in frame.taken_ns.items()}
    if not isinstance(frame.restarted, bool):
        raise TypeError(f"restarted: found {short(frame.restarted)}; expected True or False")
    return Frame(t_ns, readings, taken_ns, frame.restarted)


def _time(name: str, value: Any) -> int:
    try:
        time = index(value)
    except TypeError:
        raise TypeError(f"{name}: found {short(value)}; expected whole nanoseconds, an int") from None
    if not -MAX_TIME_NS < time < MAX_TIME_NS:
        raise ValueError(f"{name}: found {short(time)}; expected nanoseconds that fit into 63 bits")
    return time


def _without_numpy(reading: Any) -> Any:
    """Return a reading with Python numbers and lists in place of numpy's, without importing numpy."""
    if isinstance(reading, list | tuple):
        return tuple([_without_numpy(element) for element in reading])
    return reading.tolist() if hasattr(reading, "tolist") else reading
