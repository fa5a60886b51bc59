"""A program in the shadow of a robot: it reads what the robot measures, and nothing of it leaves the process.

The node `Shadow` has the same parts as a run: clients, the arbitration of each actuator, and the monitor that
holds the one to the other. What differs is what surrounds them:

- It sends no message at all: no request, no sign of life, no fetch of a frame that was missed. Whatever
  happens to it, no other process can tell.
- The robot's ticks are its frames, whichever program they belong to. It takes their numbers and times alone:
  another program's run, epoch and lost clients, the emergency stop and locks are not the shadow's.
- `last.ACTUATOR.FIELD` is what the shadow would have sent, not what the robot was given.
- A server counts as down when the Clock says so, or when it has answered no tick for a second: the Clock does
  not watch every server that the program reads.
- After a frame that it missed, all memory restarts, as it does after a restart of the Clock. As it fetches
  nothing, a frame counts as missed once its server has sent `MISSED_FRAMES` more.
- Modules in Python run in this process.

If the servers listen to another controller, its commands are in the frames. The program then decides as
before, and a `Controller` judges those commands by the program's contracts.
"""

from __future__ import annotations

from collections.abc import Iterable

from colony.execute.compiled import Compiled
from colony.execute.executor import ModuleExecutor, ProgramExecutor
from colony.execute.intake import converted
from colony.ir.frame import Answer, Frame, Reading
from colony.ir.program import Role
from colony.runtime.arbitration.arbiter import Arbiter, had_role, timing
from colony.runtime.assembly.controller import Controller
from colony.runtime.clients.client import ClientProgram
from colony.runtime.frames.assembler import AssembledFrame, FrameAssembler, frames_to_keep
from colony.runtime.frames.registry import TickAnswers
from colony.runtime.frames.run_frame import HeardCommand, RunFrame
from colony.runtime.observe.closing import close_all
from colony.runtime.observe.observer import KeyframeSchedule, Monitor, Sink
from colony.runtime.protocol.bindings import Bindings, SensorBinding, heard_name
from colony.runtime.protocol.deployment import Deployment
from colony.runtime.protocol.messages import (
    Effect,
    Message,
    QuietNode,
    Request,
    ServerFrame,
    Tick,
    Verdict,
)

MIN_SILENCE_NS = 1_000_000_000
"""Nanoseconds after which a server that has answered no tick counts as down, but at least three frames.

That is less than the retention of frames, so that no frame waits in vain.
"""

MISSED_FRAMES = 5
"""Number of frames that a server sends after one that has not come, before that counts as missed.

A server sends its frames in order, and other readers have a frame that they miss sent again.
"""

SUSPENDED_NS = MIN_SILENCE_NS // 4
"""Nanoseconds that the shadow falls behind from one tick to the next, from which it counts as suspended.

The ticks of that time may all be handled before the first of the frames that answer them.
"""

_NOBODY: frozenset[str] = frozenset()


class Shadow(QuietNode):
    """The node of a program that commands nothing. Mutable.

    Args:
        compiled: program to run in the shadow.
        bindings: its sensors and actuators, bound to the servers of the robot.
        deployed: the same program as a run would deploy it.
        sinks: consumers of the frames, with the verdicts that the program would have got.
        controller: judges the commands of another controller, to which the servers listen; None if they do
            not.

    Raises:
        DiagnosticError: a module in Python cannot be imported or built.

    Attributes:
        behind_ns: age of the newest tick when it was handled, in nanoseconds: how far the shadow is behind.
        deciding: number of the frame that is being decided, None between two; other threads may read it.
    """

    address = "Shadow"

    def __init__(
        self,
        compiled: Compiled,
        bindings: Bindings,
        deployed: Deployment,
        sinks: tuple[Sink, ...],
        controller: Controller | None = None,
    ) -> None:
        self._run = deployed.run
        self._controller = controller
        commands = () if controller is None else controller.bindings
        self._commands = {(b.server, heard_name(b.command)): heard_name(b.actuator) for b in commands}
        self._commanded_ns: dict[tuple[int, str], int] = {}  # times of heard commands, by frame and sensor
        measured = (
            *(b for b in bindings.sensors if not b.sent),
            *(
                SensorBinding(sensor=name, server=server, field=field, max_age_ns=None)
                for (server, field), name in self._commands.items()
            ),
        )
        self._factors = {b.sensor: b.factor for b in bindings.sensors if b.factor != 1.0}
        frames_kept = frames_to_keep(compiled.frame_ns)
        self._assembler = FrameAssembler(
            measured, run=deployed.run, frames_kept=frames_kept, declared_units=True
        )
        servers = {b.server for b in measured}
        self._heard_ns = dict.fromkeys(servers, 0)
        self._answers = TickAnswers(servers, frames_kept=frames_kept)
        self._program = _Program(compiled, deployed)
        self._keyframes = KeyframeSchedule(compiled.frame_ns)
        self._sinks = sinks
        self._tick: Tick | None = None
        self._is_first = True
        self.behind_ns = 0
        self.deciding: int | None = None
        self.listens = self._assembler.listens

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        """Decide every frame that is complete; there are no effects."""
        match message:
            case Tick():
                before_ns, self.behind_ns = self.behind_ns, max(0, now_ns - message.t_ns)
                self._take_tick(message, suspended_ns=self.behind_ns - before_ns)
            case ServerFrame():
                self._take_frame(message)
            case _:
                return ()
        for assembled in self._assembler.pop_complete():
            self.deciding = assembled.tick.k
            self._decide(assembled)
        self.deciding = None
        return ()

    def close(self) -> None:
        """Close the sinks."""
        close_all(self._sinks)

    # --- what the robot says -------------------------------------------------------------------------

    def _take_tick(self, tick: Tick, *, suspended_ns: int) -> None:
        """Turn a tick of the robot into one of the shadow's own epoch.

        Args:
            tick: the tick.
            suspended_ns: nanoseconds that the shadow fell behind since the tick before.
        """
        previous = self._tick
        if previous is None:
            self._heard_ns = dict.fromkeys(self._heard_ns, tick.t_ns)
        elif tick.k <= previous.k or tick.t_ns <= previous.t_ns:
            return
        is_next = previous is not None and tick.k == previous.k + 1
        follows = is_next and not self._assembler.lost and not self._assembler.is_passed_over(MISSED_FRAMES)
        elapsed_ns = 0 if previous is None else tick.t_ns - previous.t_ns
        if not follows:
            self._answers.clear()
        unheard_ns = elapsed_ns if not is_next else suspended_ns if suspended_ns > SUSPENDED_NS else 0
        if unheard_ns:  # no server was heard meanwhile
            self._heard_ns = {s: heard_ns + unheard_ns for s, heard_ns in self._heard_ns.items()}
        silent = self._silent(tick.t_ns, 3 * elapsed_ns)
        own = Tick(
            k=tick.k,
            t_ns=tick.t_ns,
            start=previous.start if previous is not None and follows else tick.k,
            run=self._run,
            down=tuple(dict.fromkeys((*tick.down, *silent))),
            void=(*(v for v in tick.void if v[1] >= self._assembler.next), *self._answers.take_void(silent)),
            restarted=previous is not None and not follows,
        )
        self._tick = own
        self._answers.tick_sent(tick.k, own.down)
        self._assembler.take(own)

    def _silent(self, now_ns: int, three_frames_ns: int) -> tuple[str, ...]:
        limit_ns = max(MIN_SILENCE_NS, three_frames_ns)
        return tuple(s for s, heard_ns in self._heard_ns.items() if now_ns - heard_ns > limit_ns)

    def _take_frame(self, frame: ServerFrame) -> None:
        if frame.server in self._heard_ns and self._tick is not None:
            self._heard_ns[frame.server] = self._tick.t_ns
        for (server, field), name in self._commands.items():
            if server == frame.server and (sample := frame.fields.get(field)) is not None:
                self._commanded_ns[frame.k, name] = sample.t_ns
        self._assembler.take(frame)

    # --- what the program would do -------------------------------------------------------------------

    def _decide(self, assembled: AssembledFrame) -> None:
        for server in self._heard_ns:  # what was decided is void no more
            self._answers.frame_received(server, assembled.tick.k, 0)
        if assembled.restart and not self._is_first:
            self._program.restart()
            if self._controller is not None:
                self._controller.restart()
        keyframe = None
        if self._keyframes.is_due(assembled.tick.t_ns, assembled.restart):
            keyframe = self._program.monitor.keyframe()
        measured, heard = self._split(assembled)
        frame = self._program.completed(measured)
        base = frame._replace(
            readings={name: self._in_base_units(name, value) for name, value in frame.readings.items()}
        )
        answers = self._program.answers(base)
        requests, verdicts = self._program.arbitrate(assembled._replace(frame=base, answers=answers))
        checked = self._program.monitor.check(frame, verdicts, (), answers)
        log = RunFrame(
            tick=assembled.tick,
            frame=frame,
            verdicts=verdicts,
            expected=checked.expected,
            breaches=checked.expected.breaches,
            disagreements=checked.disagreements,
            memory_unknown=not checked.expected.decisions,
            restart=assembled.restart and not self._is_first,
            requests=requests,
            keyframe=keyframe,
            answers=answers,
            heard=heard,
            heard_breaches=()
            if self._controller is None
            else self._controller.breaches(measured, heard, answers),
        )
        self._is_first = False
        for sink in self._sinks:
            sink.take(log)

    def _split(self, assembled: AssembledFrame) -> tuple[Frame, dict[str, HeardCommand | None]]:
        """Return the frame without the commands of another controller, and these by actuator."""
        frame, k = assembled.frame, assembled.tick.k
        if self._controller is None:
            return frame, {}
        readings, heard = dict(frame.readings), dict[str, HeardCommand | None]()
        for binding in self._controller.bindings:
            name = heard_name(binding.actuator)
            parameters = readings.pop(name, None)
            if parameters is None:
                heard[binding.actuator] = None
            else:
                age_ns = frame.t_ns - self._commanded_ns[k, name]
                heard[binding.actuator] = self._controller.command(binding, parameters, age_ns)  # type: ignore[arg-type]
        self._commanded_ns = {key: t_ns for key, t_ns in self._commanded_ns.items() if key[0] > k}
        return frame._replace(readings=readings), heard

    def _in_base_units(self, sensor: str, value: Reading) -> Reading:
        factor = self._factors.get(sensor)
        return value if factor is None else converted(value, lambda x: x * factor)  # type: ignore[return-value]


class _Program:
    """The clients of a program, their arbitration and their monitor. Stateful: holds all memory."""

    def __init__(self, compiled: Compiled, deployed: Deployment) -> None:
        self._clients = ClientProgram(
            compiled, [(spec.name, client) for spec in deployed.actuators for client, _ in spec.clients]
        )
        times = timing(compiled.frame_ns)
        self._arbiters = {spec.name: Arbiter(spec, times) for spec in deployed.actuators}
        self._modules = {name: ModuleExecutor(compiled, name) for name in compiled.python_modules}
        actuators = compiled.robot.actuators
        self.monitor = Monitor(
            ProgramExecutor(compiled, simplified=False, answers_given=True),
            (a.name for a in actuators if a.on_loss == "degrade"),
            compiled.python_modules,
            actuators,
        )
        self._sensors = tuple((s.name, s.sent) for s in compiled.robot.sensors if s.sent is not None)
        self._sent: dict[str, Reading] = {}
        self._forget()

    def restart(self) -> None:
        """Restart all memory; the clients restart by themselves, with the first frame of their epoch."""
        self.monitor.restart()
        for module in self._modules.values():
            module.restart()
        self._forget()

    def _forget(self) -> None:
        self._sent = dict.fromkeys(name for name, _ in self._sensors)

    def completed(self, frame: Frame) -> Frame:
        """Return a frame with what would have been sent in the frame before, in declared units."""
        return frame._replace(readings={**frame.readings, **self._sent}) if self._sensors else frame

    def answers(self, frame: Frame) -> dict[str, Answer]:
        """Return the answers of the modules in Python in a frame in base units."""
        return {name: module.step(frame) for name, module in self._modules.items()}

    def arbitrate(self, assembled: AssembledFrame) -> tuple[tuple[Request, ...], dict[str, Verdict]]:
        """Return the requests of a frame in base units, and the verdict on each actuator."""
        tick, verdicts = assembled.tick, dict[str, Verdict]()
        requests = tuple(r for r in self._clients.step(assembled) if isinstance(r, Request))
        for name, arbiter in self._arbiters.items():
            events = [
                *arbiter.open(tick, _NOBODY, tick.t_ns),
                *(e for r in requests if r.actuator == name for e in arbiter.receive(r, tick.t_ns)),
                *arbiter.finish(),
            ]
            verdicts[name] = next(event for event in events if isinstance(event, Verdict))
        for sensor, before in self._sensors:
            verdict = verdicts[before.actuator]
            if isinstance(before.of, Role):
                self._sent[sensor] = had_role(dict(verdict.fates), before.of)
            elif verdict.values is not None:
                self._sent[sensor] = verdict.values[before.of]
        return requests, verdicts
