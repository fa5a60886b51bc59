"""The Clock of a robot: it numbers the frames and publishes what is down, lost and void.

Servers are down, clients are lost, and frames of dead servers are void. Frames are a period apart. A robot
without a program has frames too, of `IDLE_FRAME_NS`, in the run "": so that scripts can drive it and servers
are watched. A leader deploys a program; when all of its clients have reported that they are ready, or after
`GATHER_NS`, its frames begin, and they end with the leader's connection.

An epoch is the sequence of frames since one in which all memory was initial. A new one begins with a run;
when the Clock was restarted; when a client lost its memory for good; and when the observer stepped over a
frame that no other node received. A frame's number is never used twice: a Clock that starts derives its first
number from the time, a number each `NUMBER_NS`, and no frames come faster than that.

The emergency stop is latched here (`stop_latch.py`): the Clock keeps it, repeats it in every tick, learns of
stops that it missed from the frames of the servers that received them, and alone releases it.

A Clock that was suspended for a while skips the periods that it missed. In lockstep a frame begins as soon as
the one before it is decided, after a period at the latest; its time is a whole number of periods all the
same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from colony.runtime.arbitration.stop_latch import StopLatch
from colony.runtime.frames.liveness import Liveness, TickAnswers, lease
from colony.runtime.frames.publishing import FRAME_BYTES, FRAMES_KEPT, FetchBudget
from colony.runtime.frames.registry import ClientRegistry
from colony.runtime.library.clock import ServerWho, Who
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import Asked, CallDesk, Nothing, RefusedError, method
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import DEPLOYMENT_BYTES, Deployment, client_addresses
from colony.runtime.protocol.fields import DSERVER
from colony.runtime.protocol.leadership import Leadership
from colony.runtime.protocol.messages import (
    Alive,
    Announcement,
    Call,
    Effect,
    Fetch,
    Malformed,
    Message,
    Ready,
    Restart,
    Send,
    ServerFrame,
    Stopped,
    Tick,
    Verdict,
    Wake,
    WakeAt,
)
from colony.runtime.protocol.plausibility import NUMBER_NS

IDLE_FRAME_NS = 50_000_000
"""Frame period of a robot without a program, in nanoseconds."""

GATHER_NS = 5_000_000_000
"""Nanoseconds to wait for the clients of a run to be ready."""


class Clock:
    """The logical time of one robot. Mutable: the newest tick, and the state of servers and clients.

    Args:
        servers: the robot's servers, which answer ticks.
        keep: the number of ticks kept for nodes that missed one.
        deployment: a program that is deployed from the beginning; others come by `deploy`.
        told: called with every deployment, before its first frame.
        stop_path: the file in which the emergency stop is kept; without it, a restart forgets the stop.
        report: called with a line for users when that file cannot be read or written.
    """

    address = topics.CLOCK

    def __init__(
        self,
        *,
        servers: tuple[str, ...],
        keep: int = FRAMES_KEPT,
        deployment: Deployment | None = None,
        told: Callable[[Deployment], None] = lambda deployed: None,
        stop_path: Path | None = None,
        report: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._latch = StopLatch(stop_path, report=report)
        self._servers = servers
        self._keep = keep
        self._deployed = deployment
        self._told = told
        self._leadership = Leadership(self.address)
        self._leader: Caller | None = None
        self._tick = Tick(k=-1, t_ns=0)
        self._kept: dict[int, Tick] = {}
        self._fetched = FetchBudget()
        self._restart = False
        self._begun_run = ""
        self._decided: set[str] = set()
        self._alarm: int | None = None
        self._desk = CallDesk(
            self.address,
            (
                method("deploy", Deployment, self._deploy, largest=DEPLOYMENT_BYTES),
                method("who", Nothing, self._who, right="read"),
                method("release", Nothing, self._release),
            ),
            lost=self._lost,
            stop=self._stop,
        )
        self.listens = (
            topics.fetches(self.address),
            topics.READY,
            topics.RESTARTS,
            topics.VERDICTS,
            topics.ANSWERS,
            topics.announcements(DSERVER.name),
            *(topics.frames(server) for server in servers),
            *self._desk.listens,
        )

    @property
    def deferred(self) -> tuple[str, ...]:
        """Topics of the servers' frames: their content counts for the next tick."""
        return tuple(topics.frames(server) for server in self._servers)

    # --- messages --------------------------------------------------------------------------------------

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Begin the first frame."""
        self._latch.begin(now_ns)
        self._next_k = now_ns // NUMBER_NS
        self._epoch_k, self._due_ns = self._next_k, now_ns
        self._enroll(now_ns)
        return self._advance(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a message, and begin the next frame if it is due."""
        match message:
            case ServerFrame():
                self._heard(message.server, message.k, message.since, now_ns)
                self._latch.observe(message.stopped)
                self._overtake(message.k)
            case Announcement():
                self._heard(topics.activity(DSERVER.name, message.module), message.k, 0, now_ns)
            case Verdict():
                self._registry.judged(message, now_ns)
                if message.k == self._tick.k:
                    self._decided.add(message.actuator)
            case Fetch():
                tick = self._kept.get(message.k)
                if tick is not None:
                    size = FRAME_BYTES * (1 + len(tick.lost) + len(tick.void))
                    if self._fetched.take(self.address, message.k, size):
                        # not on the topic of ticks: a server that was restarted would take it for a new one
                        yield Send(topics.frames(self.address), tick)
            case Ready():
                if self._deployed is not None and message.run == self._deployed.run:
                    self._registry.ready(message.client)
                    if message.k >= 0:
                        self._registry.heard(message.client, now_ns)
            case Restart():
                begun = self._run != "" and self._begun_run == self._run
                member = message.client in self._registry or message.client == topics.OBSERVER
                if begun and member and message.start == self._tick.start:
                    self._restart = True
            case Call() | Alive() | Malformed() | Wake():
                yield from self._desk.handle(message, now_ns)
            case _:
                return
        yield from self._advance(now_ns)

    def close(self) -> None:
        """Close the file of the emergency stop."""
        self._latch.close()

    def _heard(self, server: str, k: int, since: int, now_ns: int) -> None:
        self._liveness.heard(server, now_ns)
        self._answers.answered(server, k, since)

    def _overtake(self, k: int) -> None:
        """Skip numbers up to frame `k`, which a server has answered, if this Clock has not ticked it yet.

        Another process has then ticked in its place, and the server would wait until this Clock gets there.
        """
        if k > self._tick.k and self._tick.k >= 0:
            self._next_k, self._restart = max(self._next_k, k + 1), True

    # --- the emergency stop ----------------------------------------------------------------------------

    def _stop(self, by: str, now_ns: int) -> None:
        self._latch.engage(Stopped(by=by, t_ns=now_ns))
        if self._latch.trouble is not None:
            text = f"stopped, but a Clock that is started again may not be: {self._latch.trouble}"
            raise RefusedError("not kept", f"{self.address}: {text}")

    def _release(self, asked: Asked, arguments: Nothing, now_ns: int) -> None:
        self._latch.release(now_ns)
        if self._latch.trouble is not None:
            text = f"released, but a Clock that is started again may be stopped: {self._latch.trouble}"
            raise RefusedError("not kept", f"{self.address}: {text}")

    # --- runs ------------------------------------------------------------------------------------------

    @property
    def _run(self) -> str:
        return "" if self._deployed is None else self._deployed.run

    @property
    def _frame_ns(self) -> int:
        """The current frame period."""
        if self._deployed is None or self._gather_by is not None:
            return IDLE_FRAME_NS
        return self._deployed.frame_ns

    def _enroll(self, now_ns: int) -> None:
        """Start watching the participants of the present deployment, and waiting for its clients."""
        deployed, announcers = self._deployed, self._announcers()
        clients = () if deployed is None else tuple(address for address, _ in client_addresses(deployed))
        lease_ns = lease(IDLE_FRAME_NS if deployed is None else deployed.frame_ns)
        self._gather_by = None if deployed is None else now_ns + GATHER_NS
        self._registry = ClientRegistry(clients, announcers, lease_ns=lease_ns, now_ns=now_ns)
        watched = (*self._watched_servers(), *announcers)
        self._liveness = Liveness(watched, lease_ns=lease_ns, now_ns=now_ns)
        self._answers = TickAnswers(watched, keep=self._keep)
        self._restarts = 0
        if deployed is not None and self._tick.k < 0:
            self._due_ns = now_ns + IDLE_FRAME_NS  # a program is deployed: no idle frame before it

    def _deploy(self, asked: Asked, deployed: Deployment, now_ns: int) -> None:
        new = self._leadership.take(asked.caller, deployed) and deployed.run != self._run
        self._leader = asked.caller
        if new or self._deployed is None:
            self._deployed = deployed
            self._told(deployed)
            self._enroll(now_ns)

    def _lost(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        """Note a lost connection; the run ends with the connection of its leader."""
        self._leadership.lost(caller)
        if self._leader is not None and self._leader.connection == caller.connection:
            self._leader, self._deployed = None, None
            self._enroll(now_ns)
            self._due_ns = min(self._due_ns, now_ns + IDLE_FRAME_NS)  # its frame period may have been long
        return ()

    # --- ticks -----------------------------------------------------------------------------------------

    def _advance(self, now_ns: int) -> Iterator[Effect]:
        """Carry out what is due, and schedule a wake for the next deadline."""
        if self._gather_by is not None and (self._registry.complete or now_ns >= self._gather_by):
            self._gather_by = None
            self._registry.begin(now_ns)
            for announcer in self._announcers():
                self._liveness.heard(announcer, now_ns)
            ticked = self._tick.k >= 0 and self._tick.t_ns == now_ns
            self._due_ns = now_ns + 1 if ticked else now_ns
        if now_ns >= self._due_ns or self._in_step():
            yield from self._next(now_ns)
        due = self._due_ns if self._gather_by is None else min(self._due_ns, self._gather_by)
        if self._alarm is None or now_ns >= self._alarm or due < self._alarm:
            self._alarm = due
            yield WakeAt(due)

    def _in_step(self) -> bool:
        """Return True if the frame is in lockstep, and decided for all actuators."""
        deployed = self._deployed
        if deployed is None or not deployed.lockstep or self._gather_by is not None:
            return False
        return (
            self._tick.run == deployed.run
            and bool(deployed.actuators)
            and len(self._decided) >= len(deployed.actuators)
        )

    def _next(self, now_ns: int) -> Iterator[Effect]:
        run = "" if self._gather_by is not None else self._run
        lockstep = self._deployed is not None and self._deployed.lockstep and run != ""
        frame_ns = self._frame_ns
        missed_ns = max(0, (now_ns - self._due_ns) // frame_ns * frame_ns)
        if missed_ns:  # this process was suspended: the silence was its own, not that of servers and clients
            self._liveness.slept(missed_ns)
            self._registry.slept(missed_ns)
        begins = self._tick.k < 0 or run != self._begun_run
        t_ns = self._tick.t_ns + frame_ns if lockstep and not begins else self._due_ns + missed_ns
        if begins or self._restart:
            self._restarts += not begins
            self._epoch_k = self._next_k
            self._restart, self._begun_run = False, run
            self._answers.forget()
        self._due_ns = (now_ns if lockstep else t_ns) + frame_ns
        yield from self._publish(t_ns, run, now_ns)

    def _publish(self, t_ns: int, run: str, now_ns: int) -> Iterator[Effect]:
        k, down = self._next_k, self._liveness.missing(now_ns)
        tick = Tick(
            k=k,
            t_ns=t_ns,
            start=self._epoch_k,
            run=run,
            down=down,
            lost=self._registry.lost(now_ns) if run else (),
            void=self._answers.void(down),
            stopped=self._latch.stopped,
            released_ns=self._latch.released_ns,
        )
        self._latch.save(now_ns)
        overdue = list(self._answers.overdue(k))
        self._answers.asked(k, down)
        self._kept[k] = tick
        self._kept.pop(k - self._keep, None)
        self._tick, self._next_k = tick, k + 1
        self._decided.clear()
        self._fetched.renew()
        yield Send(topics.TICKS, tick)
        for server, missing in overdue:
            asked = DSERVER.name if server in self._announcers() else server
            yield Send(topics.fetches(asked), Fetch(server=server, k=missing))

    # --- participants ----------------------------------------------------------------------------------

    def _who(self, asked: Asked, arguments: object, now_ns: int) -> Who:
        down = self._liveness.missing(now_ns)
        watched = (*self._watched_servers(), *self._announcers())
        deployed = self._deployed
        return Who(
            k=self._tick.k,
            t_ns=self._tick.t_ns,
            start=self._tick.start,
            frame_ns=self._frame_ns,
            run=self._run,
            program="" if deployed is None else deployed.program,
            leader=None if self._leader is None else self._leader.connection,
            begun=deployed is not None and self._gather_by is None,
            restarts=self._restarts,
            servers=tuple(ServerWho(server=s, up=s not in down) for s in watched),
            clients=self._registry.who(now_ns),
            stopped=self._latch.stopped,
            trouble=self._latch.trouble,
        )

    def _watched_servers(self) -> tuple[str, ...]:
        """Return the robot's servers, and those that the program reads besides."""
        more = () if self._deployed is None else self._deployed.servers
        return tuple(dict.fromkeys((*self._servers, *more)))

    def _announcers(self) -> tuple[str, ...]:
        modules = () if self._deployed is None else self._deployed.announced
        return tuple(topics.activity(DSERVER.name, m) for m in modules)
