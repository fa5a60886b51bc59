"""Scripts by themselves: DServer's variables and semaphores and RServer's position, in frames of 50 ms."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from colony.runtime.kit.errors import CallRefused
from colony.runtime.kit.script import Do, Script, Sleep, Step
from colony.runtime.library import data
from colony.runtime.library.robot import Position

FRAME_NS = 50_000_000


class Stage:
    """Mutable: the time, the variables, the semaphores, the robot.

    `calls` is every call, as (script, method, name or names, value), in the order in which they came.
    """

    def __init__(self, **scripts: Script) -> None:
        self.now_ns = 0
        self.variables: dict[str, Any] = {}
        self.semaphores: dict[str, int] = {}
        self._histories: dict[str, deque[data.Dated]] = {}
        self.x = self.y = self.heading = 0.0
        self.calls: list[tuple[str, str, Any, Any]] = []
        self._scripts = scripts
        self._ready: deque[tuple[str, Any]] = deque((name, None) for name in scripts)
        self._sleeping: list[tuple[int, str]] = []
        self._waiting: list[tuple[str, str, int | None]] = []
        self.ended: set[str] = set()

    def run(self, seconds: float, each_frame: Callable[[], None] = lambda: None) -> None:
        """Frame by frame, until the time is over or all scripts have ended."""
        for _ in range(round(seconds * 1e9) // FRAME_NS):
            self._settle()
            if len(self.ended) == len(self._scripts):
                return
            self.now_ns += FRAME_NS
            each_frame()
            self._wake()

    def told(self, script: str, method: str) -> list[tuple[Any, Any]]:
        """What a script asked for by one method."""
        return [(name, value) for by, how, name, value in self.calls if (by, how) == (script, method)]

    def close(self, name: str) -> None:
        """End a script where it is."""
        self._scripts[name].close()
        self.ended.add(name)
        self._waiting = [w for w in self._waiting if w[0] != name]
        self._sleeping = [s for s in self._sleeping if s[1] != name]
        self._ready = deque(ready for ready in self._ready if ready[0] != name)

    def start(self, name: str, script: Script) -> None:
        """Run one more."""
        self._scripts[name] = script
        self.ended.discard(name)
        self._ready.append((name, None))

    def _wake(self) -> None:
        for due, name in [s for s in self._sleeping if s[0] <= self.now_ns]:
            self._sleeping.remove((due, name))
            self._ready.append((name, self.now_ns))
        for name, semaphore, due_ns in [w for w in self._waiting if w[2] is not None and w[2] <= self.now_ns]:
            self._waiting.remove((name, semaphore, due_ns))
            self._ready.append((name, CallRefused("timeout", semaphore)))

    def _settle(self) -> None:
        while self._ready:
            name, answer = self._ready.popleft()
            script = self._scripts[name]
            while True:
                try:
                    problem = isinstance(answer, Exception)
                    step = script.throw(answer) if problem else script.send(answer)
                except StopIteration:
                    self.ended.add(name)
                    break
                answer = self._do(name, step)
                if answer is _LATER:
                    break

    def _do(self, name: str, step: Step) -> Any:
        if isinstance(step, Sleep):
            if step.seconds <= 0:
                return self.now_ns
            self._sleeping.append((self.now_ns + round(step.seconds * 1e9), name))
            return _LATER
        return self._ask(name, step)

    def _ask(self, by: str, step: Do) -> Any:
        told: Mapping[str, Any] = msgspec.to_builtins(step.ask.arguments, builtin_types=(msgspec.Raw,))
        match step.server, step.ask.method:
            case "DServer", "set":
                return self._set(by, {told["name"]: told["value"]}, "set")
            case "DServer", "set_many":
                values = msgspec.msgpack.decode(told["values"], type=dict[str, msgspec.Raw])
                return self._set(by, values, "set_many")
            case "DServer", "get":
                found = self._get([told["name"]])
                return found if isinstance(found, Exception) else found[told["name"]]
            case "DServer", "set_history":
                self._histories[told["name"]] = deque(maxlen=told["length"])
                return None
            case "DServer", "history":
                return tuple(self._histories.get(told["name"], ()))
            case "DServer", "get_many":
                return self._get(told["names"])
            case "DServer", "create_semaphore":
                self.calls.append((by, "create", told["name"], told["value"]))
                return told["name"] not in self.semaphores and not self.semaphores.update(
                    {told["name"]: told["value"]}
                )
            case "DServer", "signal":
                self.calls.append((by, "signal", told["name"], None))
                return self.signal(told["name"])
            case "DServer", "wait":
                return self._wait(by, told["name"], told["wait_ns"])
            case "RServer", "position":
                return Position(x=self.x, y=self.y, heading=self.heading % 360.0, t_ns=self.now_ns)
            case "RServer", "adjust_position":
                self.calls.append((by, "adjust", None, (told["x"], told["y"], told["heading"])))
                self.x, self.y = self.x + told["x"], self.y + told["y"]
                self.heading += told["heading"]
                return None
            case server, method:
                raise AssertionError(f"nobody answers {server}.{method}")

    def _set(self, by: str, raw: Mapping[str, msgspec.Raw], how: str) -> None:
        values = {name: msgspec.msgpack.decode(value) for name, value in raw.items()}
        self.calls.append((by, how, tuple(values), tuple(values.values())))
        self.variables.update(values)
        for name in self._histories.keys() & raw.keys():
            self._histories[name].appendleft(data.Dated(t_ns=self.now_ns, value=raw[name]))

    def _get(self, names: list[str]) -> Any:
        missing = [name for name in names if name not in self.variables]
        if missing:
            return CallRefused("unknown", missing[0])
        return {name: self.variables[name] for name in names}

    def signal(self, semaphore: str) -> None:
        """As somebody else does it."""
        for waiting in self._waiting:
            if waiting[1] == semaphore:
                self._waiting.remove(waiting)
                self._ready.append((waiting[0], None))
                return
        self.semaphores[semaphore] += 1

    def _wait(self, by: str, semaphore: str, wait_ns: int | None) -> Any:
        assert semaphore in self.semaphores, f"{by} waits for {semaphore}, which nobody made"
        if self.semaphores[semaphore]:
            self.semaphores[semaphore] -= 1
            return None
        if wait_ns == 0:
            return CallRefused("timeout", semaphore)
        self._waiting.append((by, semaphore, None if wait_ns is None else self.now_ns + wait_ns))
        return _LATER


_LATER = object()
