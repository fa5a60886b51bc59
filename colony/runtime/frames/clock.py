"""The Clock of a robot: it numbers the frames, and publishes which nodes are down or lost.

Each tick lists the servers that are down, the clients that are lost, and the frames that are void. When a
server dies, its frames that have not arrived are void. Frames begin one period apart. A robot without a
program also has frames, `IDLE_FRAME_NS` apart, in the run "", so that scripts can drive it and servers are
monitored. A leader deploys a program. The frames of its run begin when all clients have reported ready, or
after `READY_TIMEOUT_NS`; they end with the leader's connection.

An epoch is a sequence of frames that begins with initial memory. A new epoch begins with a run, when a client
lost its memory irrecoverably, and when the observer stepped over a frame that no other node received. A frame
number is never used twice: a Clock derives its first number from the time at which it starts, one number per
`FRAME_NUMBER_NS`, and frames are never closer together than that.

A restarted Clock goes on with the epoch (`registry.py`). The numbers between the last frame of the old
Clock and its own first frame of the run are a gap, which its ticks list while nodes may be behind. If no node
knows the epoch, a new one begins.

The emergency stop is latched here (`stop_latch.py`): the Clock keeps it, repeats it in every tick, and alone
releases it. It learns of stops that it missed from the frames of the servers that received them. A release
is answered once the servers have answered a tick that carries it.

A Clock that was suspended skips the periods that it missed. In lockstep a frame begins as soon as the
previous one is decided, after one period at the latest; its time is still a whole number of periods.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from colony.ir.servers import DSERVER
from colony.runtime.arbitration.stop_latch import StopLatch
from colony.runtime.frames.publishing import FRAME_BYTES, FRAMES_KEPT, FetchBudget
from colony.runtime.frames.registry import (
    ClientRegistry,
    Liveness,
    ResumedEpoch,
    Resumption,
    TickAnswers,
    lease,
)
from colony.runtime.library.clock import Participants, ServerParticipant, Tune, TunedParam
from colony.runtime.protocol import topics
from colony.runtime.protocol.calls import (
    LATER,
    CallDispatcher,
    CallId,
    Later,
    NoArguments,
    RefusedError,
    method,
)
from colony.runtime.protocol.codec import FRAME_NUMBER_NS, MAX_CLOCK_LEAD_NS, MAX_GAPS
from colony.runtime.protocol.connections import Caller
from colony.runtime.protocol.deployment import (
    MAX_DEPLOYMENT_BYTES,
    READ_ONLY,
    Deployment,
    Leadership,
    client_addresses,
    tuned_with,
)
from colony.runtime.protocol.interface import Interface, interface_problem
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
    SendMessage,
    ServerFrame,
    Stopped,
    Tick,
    Verdict,
    Wake,
    WakeSchedule,
)

IDLE_FRAME_NS = 50_000_000
"""Frame period of a robot without a program, in nanoseconds."""

RELEASE_NS = 500_000_000
"""Longest time in ns until a release is answered, or two frames if that is longer."""

READY_TIMEOUT_NS = 5_000_000_000
"""Timeout, in nanoseconds, for the clients of a run to report ready."""

LEADER_LEASE_NS = 525_000_000
"""Nanoseconds without a sign of life after which a connection to the Clock is lost, such as that of a leader.

A robot whose leader is frozen stops soon, so it is shorter than at other servers.
"""


class Clock:
    """The logical time of one robot. Mutable.

    Args:
        servers: the robot's servers, which answer ticks.
        frames_kept: number of frames whose ticks are kept for nodes that missed one.
        deployment: program that is deployed from the beginning; later ones arrive through `deploy`.
        on_deploy: callback for every deployment, before its first frame.
        stop_path: file that keeps the emergency stop; without it, a restart forgets the stop.
        report: callback for a line to users when that file cannot be read or written.
        interface: that of the robot's description; programs that were checked against another are refused.
        resident: the limits of the robot's description as a program without modules. Its run goes on while
            no other program does, so that the robot's servers never take a frame for one without limits.
        read_only: True to refuse every program.
    """

    address = topics.CLOCK

    def __init__(
        self,
        *,
        servers: tuple[str, ...],
        frames_kept: int = FRAMES_KEPT,
        deployment: Deployment | None = None,
        on_deploy: Callable[[Deployment], None] = lambda deployment: None,
        stop_path: Path | None = None,
        report: Callable[[str], None] = lambda line: None,
        interface: Interface | None = None,
        resident: Deployment | None = None,
        read_only: bool = False,
    ) -> None:
        self._read_only = read_only
        self._interface = interface or Interface()
        self._resident = resident
        self._resident_run = "" if resident is None else resident.run
        self._latch = StopLatch(stop_path, report=report)
        self._servers = servers
        self._frames_kept = frames_kept
        self._deployment = deployment
        self._on_deploy = on_deploy
        if resident is not None and deployment is None:
            on_deploy(resident)
        self._leadership = Leadership(self.address)
        self._leader: Caller | None = None
        self._tick = Tick(k=-1, t_ns=0)
        self._kept: dict[int, Tick] = {}
        self._fetch_budget = FetchBudget()
        self._restart = False
        self._begun_run = self._newest_run = self._resident_run
        self._resumption = Resumption(self._resident_run)
        self._gaps: tuple[tuple[int, int], ...] = ()
        self._decided: set[str] = set()
        self._answered: dict[str, int] = {}  # the newest frame of each server
        self._tuned: dict[str, float] = {}
        self._reset: set[str] = set()  # params that were set back since the deployment
        self._tunings: list[CallId] = []  # to be answered with the next tick
        self._releases: dict[CallId, tuple[int, int]] = {}  # the first tick with each, and its deadline
        self._wakes = WakeSchedule()
        self._calls = CallDispatcher(
            self.address,
            (
                method("deploy", Deployment, self._deploy, max_bytes=MAX_DEPLOYMENT_BYTES),
                method("participants", NoArguments, self._participants, right="read"),
                method("interface", NoArguments, self._read_interface, right="read"),
                method("release", NoArguments, self._release),
                method("tune", Tune, self._tune),
                method("tunables", NoArguments, self._tunables, right="read"),
            ),
            on_lost=self._lost,
            stop=self._stop,
            lease_ns=LEADER_LEASE_NS,
        )
        self.listens = (
            topics.fetches(self.address),
            topics.READY,
            topics.RESTARTS,
            topics.VERDICTS,
            topics.ANSWERS,
            topics.announcements(DSERVER.name),
            *(topics.frames(server) for server in servers),
            *self._calls.listens,
        )

    # --- messages --------------------------------------------------------------------------------------

    def start(self, now_ns: int) -> Iterable[Effect]:
        """Begin the first frame."""
        self._latch.begin(now_ns)
        self._next_k = now_ns // FRAME_NUMBER_NS
        self._epoch_k, self._due_ns = self._next_k, now_ns
        self._enroll(now_ns)
        return self._advance(now_ns)

    def handle(self, message: Message, now_ns: int) -> Iterator[Effect]:
        """Handle a message, and begin the next frame if it is due."""
        match message:
            case ServerFrame():
                self._note_answer(message.server, message.k, message.since, now_ns)
                self._latch.observe(message.stopped)
                self._skip_past(message.k)
                self._answered[message.server] = max(message.k, self._answered.get(message.server, -1))
            case Announcement():
                self._note_answer(topics.activity(DSERVER.name, message.module), message.k, 0, now_ns)
            case Verdict():
                self._registry.record_verdict(message, now_ns)
                if message.k == self._tick.k:
                    self._decided.add(message.actuator)
            case Fetch():
                tick = self._kept.get(message.k)
                if tick is not None:
                    size = FRAME_BYTES * (1 + len(tick.lost) + len(tick.void))
                    if self._fetch_budget.take(self.address, message.k, size):
                        # not on the topic of ticks: a restarted server would take it for a new tick
                        yield SendMessage(topics.frames(self.address), tick)
            case Ready():
                self._take_ready(message, now_ns)
            case Restart():
                begun = self._run != "" and self._begun_run == self._run
                member = message.client in self._registry or message.client == topics.OBSERVER
                if begun and member and message.start == self._tick.start:
                    self._restart = True
            case Call() | Alive() | Malformed() | Wake():
                yield from self._calls.handle(message, now_ns)
            case _:
                return
        yield from self._advance(now_ns)
        if self._releases:
            yield from self._answer_releases(now_ns)

    def close(self) -> None:
        """Close the file of the emergency stop."""
        self._latch.close()

    def _note_answer(self, server: str, k: int, since: int, now_ns: int) -> None:
        self._liveness.renew(server, now_ns)
        self._answers.frame_received(server, k, since)

    def _take_ready(self, ready: Ready, now_ns: int) -> None:
        by_observer = ready.client == topics.OBSERVER
        if self._deployment is None and by_observer and ready.run != self._resumption.run:
            self._resumption = Resumption(ready.run)  # its leader has yet to deploy the program again
        if ready.run == self._resumption.run and (by_observer or ready.client in self._registry):
            self._resumption.take(ready.client, ready.progress)
        if ready.run != self._run:
            return
        self._registry.mark_ready(ready.client)
        if ready.k >= 0:
            self._registry.renew(ready.client, now_ns)

    def _skip_past(self, k: int) -> None:
        """Skip the numbers up to frame `k`, which a server has answered, if this Clock has not ticked it yet.

        Another Clock process has then sent ticks in the meantime, and servers expect later numbers.
        """
        if k > self._tick.k and self._tick.k >= 0:
            self._next_k, self._restart = max(self._next_k, k + 1), True

    # --- the emergency stop ----------------------------------------------------------------------------

    def _stop(self, by: str, now_ns: int) -> None:
        self._latch.engage(Stopped(by=by, t_ns=now_ns))
        if self._latch.trouble is not None:
            text = f"stopped, but a restart of the Clock may lose the stop: {self._latch.trouble}"
            raise RefusedError("not kept", f"{self.address}: {text}")

    def _release(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> Later:
        self._latch.release(now_ns)
        if self._latch.trouble is not None:
            text = f"released, but a restart of the Clock may bring back the stop: {self._latch.trouble}"
            raise RefusedError("not kept", f"{self.address}: {text}")
        self._releases[call_id] = self._next_k, now_ns + max(RELEASE_NS, 2 * self._frame_ns)
        return LATER

    def _answer_releases(self, now_ns: int) -> Iterator[Effect]:
        """Answer the releases that are overdue, or known to all servers that answer ticks."""
        behind = min((k for k in self._answered.values() if k >= self._tick.k - 2), default=self._tick.k)
        for call_id, (k, due_ns) in tuple(self._releases.items()):
            if (self._tick.k >= k and behind >= k) or now_ns >= due_ns:
                del self._releases[call_id]
                yield from self._calls.answer(call_id, None)

    # --- runs ------------------------------------------------------------------------------------------

    @property
    def _active(self) -> Deployment | None:
        """The program that is deployed, or the resident one."""
        return self._resident if self._deployment is None else self._deployment

    @property
    def _run(self) -> str:
        return "" if self._active is None else self._active.run

    @property
    def _frame_ns(self) -> int:
        """The current frame period."""
        begun = self._active if self._ready_by_ns is None else self._resident
        return IDLE_FRAME_NS if begun is None else begun.frame_ns

    def _enroll(self, now_ns: int) -> None:
        """Start monitoring the participants of the current deployment, and wait for a program's clients."""
        deployment, active, announcers = self._deployment, self._active, self._announcers()
        clients = () if active is None else tuple(address for address, _ in client_addresses(active))
        lease_ns = lease(IDLE_FRAME_NS if active is None else active.frame_ns)
        self._ready_by_ns = None if deployment is None else now_ns + READY_TIMEOUT_NS
        self._registry = ClientRegistry(clients, announcers, lease_ns=lease_ns, now_ns=now_ns)
        watched = (*self._watched_servers(), *announcers)
        self._liveness = Liveness(watched, lease_ns=lease_ns, now_ns=now_ns)
        self._answers = TickAnswers(watched, frames_kept=self._frames_kept)
        if self._resumption.run != self._run:
            self._resumption = Resumption(self._run)
        self._restarts = 0
        if deployment is not None and self._tick.k < 0:
            self._due_ns = now_ns + IDLE_FRAME_NS  # a program is deployed: no idle frame before it

    def _deploy(self, call_id: CallId, deployment: Deployment, now_ns: int) -> None:
        if self._read_only:
            raise RefusedError("read only", READ_ONLY)
        problem = interface_problem(deployment.interface, self._interface)
        if problem is not None:
            raise RefusedError("interface", problem)
        new = self._leadership.take(call_id.caller, deployment) and deployment.run != self._run
        self._leader = call_id.caller
        if new or self._deployment is None:
            self._deployment, self._tuned, self._reset = deployment, {}, set()
            self._on_deploy(deployment)
            self._enroll(now_ns)

    def _lost(self, caller: Caller, now_ns: int) -> Iterable[Effect]:
        """Handle a lost connection; if it was the leader's, the run ends."""
        self._leadership.on_lost(caller)
        if self._leader is not None and self._leader.connection == caller.connection:
            self._leader, self._deployment = None, None
            if self._resident is not None:
                self._on_deploy(self._resident)
            self._enroll(now_ns)
            self._due_ns = min(self._due_ns, now_ns + self._frame_ns)  # its frame period may have been long
        return ()

    # --- ticks -----------------------------------------------------------------------------------------

    def _advance(self, now_ns: int) -> Iterator[Effect]:
        """Begin the run and the next frame if they are due, and schedule a wake for the next deadline."""
        if self._ready_by_ns is not None and (self._registry.all_ready or now_ns >= self._ready_by_ns):
            self._ready_by_ns = None
            self._registry.begin(now_ns)
            for announcer in self._announcers():
                self._liveness.renew(announcer, now_ns)
            ticked = self._tick.k >= 0 and self._tick.t_ns == now_ns
            self._due_ns = now_ns + 1 if ticked else now_ns
        if now_ns >= self._due_ns or self._is_decided_in_lockstep():
            yield from self._begin_frame(now_ns)
        due = self._due_ns if self._ready_by_ns is None else min(self._due_ns, self._ready_by_ns)
        yield from self._wakes.request(due, now_ns)

    def _is_decided_in_lockstep(self) -> bool:
        """Return True if the run is in lockstep, and the frame is decided for all actuators."""
        deployment = self._deployment
        if deployment is None or not deployment.lockstep or self._ready_by_ns is not None:
            return False
        return (
            self._tick.run == deployment.run
            and bool(deployment.actuators)
            and len(self._decided) >= len(deployment.actuators)
        )

    def _begin_frame(self, now_ns: int) -> Iterator[Effect]:
        run = self._resident_run if self._ready_by_ns is not None else self._run
        is_program = run != self._resident_run
        lockstep = self._deployment is not None and self._deployment.lockstep and is_program
        frame_ns = self._frame_ns
        missed_ns = max(0, (now_ns - self._due_ns) // frame_ns * frame_ns)
        if missed_ns:  # this process was suspended, which must not count toward leases
            self._liveness.extend(missed_ns)
            self._registry.extend(missed_ns)
        is_new_run = self._tick.k < 0 or run != self._begun_run
        t_ns = self._tick.t_ns + frame_ns if lockstep and not is_new_run else self._due_ns + missed_ns
        restarted = False
        resumed = self._resumption.epoch() if is_new_run and is_program else None
        if resumed is not None and not lockstep and resumed.last.t_ns > now_ns + MAX_CLOCK_LEAD_NS:
            resumed = None  # times of another origin, as after a reboot: frames cannot go on from there
        if resumed is not None:
            t_ns = max(resumed.last.t_ns + frame_ns, 0 if lockstep else t_ns)
            self._resume(resumed)
        elif is_new_run or self._restart:
            restarted = is_program and self._has_begun(run)
            self._restarts += restarted
            self._epoch_k, self._gaps = self._next_k, ()
            self._answers.clear()
        if is_new_run or self._restart:
            self._restart, self._begun_run = False, run
            self._newest_run = run if is_program else self._newest_run
        self._due_ns = (now_ns if lockstep else t_ns) + frame_ns
        yield from self._publish(t_ns, run, now_ns, restarted=restarted)

    def _has_begun(self, run: str) -> bool:
        """Return True if the run had an epoch before, as far as the Clock knows."""
        return run == self._newest_run or self._resumption.has_begun

    def _resume(self, resumed: ResumedEpoch) -> None:
        """Go on with an epoch; the numbers between its last frame and the next one are a gap."""
        self._next_k = max(self._next_k, resumed.used_k + 1)
        self._epoch_k = resumed.start
        self._gaps = (*resumed.last.gaps, (resumed.last.k, self._next_k))[-MAX_GAPS:]
        before = {name: x for name, x in resumed.last.tuned.items() if name not in self._reset}
        self._tuned = {**before, **self._tuned}
        self._kept = {tick.k: tick for tick in resumed.ticks}
        self._answers.clear()
        self._answers.resume(resumed.behind, resumed.void)

    def _publish(self, t_ns: int, run: str, now_ns: int, *, restarted: bool) -> Iterator[Effect]:
        k, down = self._next_k, self._liveness.missing(now_ns)
        if self._gaps and k - self._gaps[-1][1] >= self._frames_kept:
            self._gaps = ()  # the frames before it are no longer kept
        tick = Tick(
            k=k,
            t_ns=t_ns,
            start=self._epoch_k,
            run=run,
            down=down,
            lost=self._registry.lost(now_ns) if run and run == self._run else (),
            void=self._answers.take_void(down),
            stopped=self._latch.stopped,
            released_ns=self._latch.released_ns,
            gaps=self._gaps if run else (),
            restarted=restarted,
            tuned=self._tuned if run and run == self._run else {},
        )
        self._latch.save(now_ns)
        overdue = list(self._answers.overdue(k))
        self._answers.tick_sent(k, down)
        self._kept[k] = tick
        while len(self._kept) > self._frames_kept:
            del self._kept[next(iter(self._kept))]
        self._tick, self._next_k = tick, k + 1
        self._decided.clear()
        self._fetch_budget.reset()
        yield SendMessage(topics.TICKS, tick)
        if run == self._run:  # the run of the program has begun
            for call_id in self._tunings:
                yield from self._calls.answer(call_id, k)
            self._tunings.clear()
        for server, missing in overdue:
            publisher = DSERVER.name if server in self._announcers() else server
            yield SendMessage(topics.fetches(publisher), Fetch(server=server, k=missing))

    # --- tunable params --------------------------------------------------------------------------------

    def _tune(self, call_id: CallId, arguments: Tune, now_ns: int) -> Later:
        """Change tunable params with the next tick, all or none."""
        active = () if self._active is None else self._active.tunables
        self._tuned = tuned_with(active, self._tuned, arguments.values)
        self._reset.update(name for name, value in arguments.values.items() if value is None)
        self._tunings.append(call_id)
        return LATER

    def _tunables(self, call_id: CallId, arguments: NoArguments, now_ns: int) -> tuple[TunedParam, ...]:
        active = () if self._active is None else self._active.tunables
        return tuple(TunedParam(tunable=t, value=self._tuned.get(t.name, t.initial)) for t in active)

    # --- participants ----------------------------------------------------------------------------------

    def _participants(self, call_id: CallId, arguments: object, now_ns: int) -> Participants:
        down = self._liveness.missing(now_ns)
        watched = (*self._watched_servers(), *self._announcers())
        deployment = self._active
        return Participants(
            k=self._tick.k,
            t_ns=self._tick.t_ns,
            start=self._tick.start,
            frame_ns=self._frame_ns,
            run=self._run,
            program="" if deployment is None else deployment.program,
            leader=None if self._leader is None else self._leader.connection,
            begun=deployment is not None and self._ready_by_ns is None,
            restarts=self._restarts,
            servers=tuple(ServerParticipant(server=s, up=s not in down) for s in watched),
            clients=self._registry.statuses(now_ns),
            stopped=self._latch.stopped,
            trouble=self._latch.trouble,
            read_only=self._read_only,
        )

    def _read_interface(self, call_id: CallId, arguments: object, now_ns: int) -> Interface:
        return self._interface

    def _watched_servers(self) -> tuple[str, ...]:
        """Return the robot's servers, and any other servers that the program reads."""
        additional = () if self._active is None else self._active.servers
        return tuple(dict.fromkeys((*self._servers, *additional)))

    def _announcers(self) -> tuple[str, ...]:
        modules = () if self._deployment is None else self._deployment.python_modules
        return tuple(topics.activity(DSERVER.name, m) for m in modules)
