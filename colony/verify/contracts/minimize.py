"""Makes a counterexample easy to read: fewer frames, fewer values given, rounder numbers.

Each change is kept only where the contract still breaks in the reference interpreter.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, Enum, ScalarValue, Value, element_type
from colony.verify.contracts.decimals import rounded, write
from colony.verify.contracts.replay import Replay
from colony.verify.contracts.results import Snapshot, Trace

_PATIENCE = 1500
"""How many frames the interpreter may compute for one trace of a small program."""

Snapshots = tuple[Snapshot, ...]


def minimal(replay: Replay, snapshots: Sequence[Snapshot], patience: int = _PATIENCE) -> Trace:
    """A trace that breaks the contract in its last frame, no longer than `snapshots`, which break it."""
    small = _Minimizer(replay, tuple(snapshots), replay.affordable(patience))
    small.run()
    missing = small.needed_missing()
    return Trace(
        snapshots=small.snapshots,
        outcomes=replay.run(small.snapshots),
        needed_missing=tuple(missing),
        found=replay.found(small.snapshots),
    )


class _Minimizer:
    """Mutable: the shortest trace so far, and how much patience is left."""

    def __init__(self, replay: Replay, snapshots: Snapshots, patience: int) -> None:
        self._replay = replay
        self._patience = patience
        self._sensors = {s.name: s for s in replay.program.robot.sensors if " " not in s.name}
        self.snapshots = snapshots[: len(replay.run(snapshots))]

    def run(self) -> None:
        self._start_at_zero()
        for i in reversed(range(len(self.snapshots) - 1)):
            self._try(self.snapshots[:i] + self.snapshots[i + 1 :])
        self._start_at_zero()
        self._regular_times()
        for i in range(1, len(self.snapshots)):
            self._sooner(i)
        for name in self._sensors:
            self._quiet(name)
        for module in dict.fromkeys(m for s in self.snapshots for m in s.answers):
            self._without_answers(module)
        for sensor in self._sensors.values():
            for i in range(len(self.snapshots)):
                self._rounder(sensor, i)

    def _try(self, snapshots: Snapshots) -> bool:
        """Take `snapshots` over if they break the contract, and if there is patience to find out."""
        self._patience -= len(snapshots)
        if self._patience < 0 or snapshots == self.snapshots or not self._replay.breaks(snapshots):
            return False
        self.snapshots = snapshots[: len(self._replay.run(snapshots))]
        return True

    # --- times ---------------------------------------------------------------------------------------

    def _start_at_zero(self) -> None:
        first = self.snapshots[0].t_ns
        self._try(tuple(replace(s, t_ns=s.t_ns - first) for s in self.snapshots))

    def _regular_times(self) -> None:
        """Frames one period apart, or at least at whole milliseconds."""
        period = self._replay.program.robot.frame_ns
        if self._try(tuple(replace(s, t_ns=i * period) for i, s in enumerate(self.snapshots))):
            return
        for grain in (period, 1_000_000, 1_000):
            for up in (False, True):
                times = [(s.t_ns + (grain - 1 if up else 0)) // grain * grain for s in self.snapshots]
                rising = all(a < b for a, b in pairwise(times))
                if rising and self._try(
                    tuple(replace(s, t_ns=t) for s, t in zip(self.snapshots, times, strict=True))
                ):
                    return

    def _sooner(self, i: int) -> None:
        """Frame `i`, and all after it, as few periods after the one before as will do; found by bisection."""
        if i >= len(self.snapshots):
            return
        period = self._replay.program.robot.frame_ns
        low, high = 0, (self.snapshots[i].t_ns - self.snapshots[i - 1].t_ns) // period
        while high - low > 1:
            middle = (low + high) // 2
            start, at = self.snapshots[i - 1].t_ns, self.snapshots[i].t_ns
            moved = [replace(s, t_ns=s.t_ns - at + start + middle * period) for s in self.snapshots[i:]]
            if self._try((*self.snapshots[:i], *moved)):
                high = middle
            else:
                low = middle

    # --- sensors -------------------------------------------------------------------------------------

    def _quiet(self, name: str) -> None:
        """Never there; or always the same; or at least from frame to frame, or simple."""
        if not any(name in s.readings for s in self.snapshots):
            return
        if self._try(tuple(_with(s, name, None) for s in self.snapshots)):
            return
        values = [s.readings[name] for s in reversed(self.snapshots) if name in s.readings]
        for value in dict.fromkeys((*values, *self._simple(name, values[0]))):
            if self._try(tuple(_with(s, name, value) for s in self.snapshots)):
                break
        for i in range(len(self.snapshots)):
            if i >= len(self.snapshots):  # what was quieter before broke the contract sooner
                return
            for quieter in self._quieter(name, i):
                if self._set(i, name, quieter):
                    break

    def _quieter(self, name: str, i: int) -> Iterator[Value | None]:
        """What a sensor might as well give in frame `i`, best first; ends with what it gives."""
        present = self.snapshots[i].readings.get(name)
        if i > 0:
            yield self.snapshots[i - 1].readings.get(name)
        if present is None:
            return
        yield None
        yield from (v for v in self._simple(name, present) if v != present)

    def _simple(self, name: str, like: Value) -> Iterator[Value]:
        """Simple values of a sensor; of an array those that are the same in all elements, then `like` with
        more of its elements the same.
        """
        sensor = self._sensors[name]
        scalars = list(dict.fromkeys(_simple_scalars(sensor)))
        if not isinstance(like, tuple):
            yield from scalars
            return
        for value in dict.fromkeys((*scalars, *sorted(set(like)))):
            yield (value,) * len(like)

    def _set(self, i: int, name: str, value: Value | None) -> bool:
        """Try another value in frame `i` alone, or from there on as long as the sensor stays as it is."""
        before = self.snapshots[i].readings.get(name)
        if value == before:
            return True
        end = i
        while end < len(self.snapshots) and self.snapshots[end].readings.get(name) == before:
            end += 1
        for stop in dict.fromkeys((end, i + 1)):
            changed = tuple(
                _with(s, name, value) if i <= j < stop else s for j, s in enumerate(self.snapshots)
            )
            if self._try(changed):
                return True
        return False

    # --- numbers -------------------------------------------------------------------------------------

    def _rounder(self, sensor: Sensor, i: int) -> None:
        if i >= len(self.snapshots):
            return
        value = self.snapshots[i].readings.get(sensor.name)
        if value is None or (i > 0 and value == self.snapshots[i - 1].readings.get(sensor.name)):
            return
        if not isinstance(value, tuple):
            self._round(sensor, i, value, lambda x: x)
            return
        [(common, _), *_] = Counter(value).most_common(1)
        for j, x in enumerate(value):
            if x != common:
                self._set(i, sensor.name, (*value[:j], common, *value[j + 1 :]))
                value = self._array(sensor, i)
        for x in dict.fromkeys(e for e in value if e != common):
            if self._set(i, sensor.name, tuple(x if e == common else e for e in value)):
                break
        value = self._array(sensor, i)
        for x in dict.fromkeys(value):
            self._round(
                sensor,
                i,
                x,
                lambda y, x=x, value=value: tuple(y if e == x else e for e in value),  # type: ignore[misc]
            )
            value = self._array(sensor, i)

    def _array(self, sensor: Sensor, i: int) -> tuple[ScalarValue, ...]:
        value = self.snapshots[i].readings[sensor.name]
        assert isinstance(value, tuple)
        return value

    def _round(self, sensor: Sensor, i: int, x: ScalarValue, put: Callable[[ScalarValue], Value]) -> None:
        """Fewer digits for a number, and a way to write it at all."""
        if isinstance(x, bool) or isinstance(element_type(sensor.type), Enum):
            return
        now = write(x, sensor)
        most = 17 if now is None else len(now.digits.replace(".", "").lstrip("0")) - 1
        for digits in range(1, min(most, 6) + 1):
            shorter = rounded(x, sensor, digits)
            if _inside(sensor, shorter) and self._set(i, sensor.name, put(shorter)):
                return

    # --- modules in Python ---------------------------------------------------------------------------

    def _without_answers(self, module: str) -> None:
        for i, snapshot in enumerate(self.snapshots):
            fewer = {m: a for m, a in snapshot.answers.items() if m != module}
            self._try((*self.snapshots[:i], replace(snapshot, answers=fewer), *self.snapshots[i + 1 :]))

    # --- what must be missing ------------------------------------------------------------------------

    def needed_missing(self) -> Iterator[str]:
        """Sensors that are never given, and that keep the contract from breaking whatever simple value
        they have.
        """
        for name, sensor in self._sensors.items():
            if any(name in s.readings for s in self.snapshots):
                continue
            trials: list[Value] = list(dict.fromkeys(_simple_scalars(sensor)))
            if isinstance(sensor.type, Array):
                trials = [(x,) * sensor.type.size for x in trials if not isinstance(x, tuple)]
            given = (tuple(_with(s, name, v) for s in self.snapshots) for v in trials)
            if trials and not any(self._replay.breaks(g) for g in given):
                yield name


def _with(snapshot: Snapshot, name: str, value: Value | None) -> Snapshot:
    readings = {k: v for k, v in snapshot.readings.items() if k != name}
    return replace(snapshot, readings=readings if value is None else {**readings, name: value})


def _inside(sensor: Sensor, x: float) -> bool:
    return (sensor.low is None or sensor.low <= x) and (sensor.high is None or x <= sensor.high)


def _simple_scalars(sensor: Sensor) -> Iterator[ScalarValue]:
    """Values that say little: the default, zero, the ends of the range."""
    if sensor.default is not None:
        yield sensor.default
    match element_type(sensor.type):
        case Bool():
            yield from (False, True)
        case Enum(members=members):
            yield from (n for _, n in members)
        case _:
            if _inside(sensor, 0.0):
                yield 0.0
            yield from (x for x in (sensor.low, sensor.high) if x is not None)
            if sensor.low is None and sensor.high is None:
                yield sensor.factor
