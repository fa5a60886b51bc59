"""One page and its WebSocket: what it asks for, and what it is sent.

At most one snapshot is under way to a page. A page that does not read is sent nothing, and then the newest
one: what waits for it is bounded by the buffers of its socket.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine
from contextlib import nullcontext, suppress
from typing import Annotated, Any, assert_never

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket

from colony.watch.snapshot import FrameMark
from colony.watch.store import SnapshotStore, history_to, path_to, timeline_of
from colony.watch.watched import Watched

# --- player --------------------------------------------------------------------------------------------
#
# The position of one page in a run: it plays, pauses, follows the newest frame, or jumps. No I/O.


MIN_SPEED, MAX_SPEED = 0.05, 100.0
"""Bounds of the speed, in seconds of the run a second."""


class Player:
    """A position in a store. Mutable. Times `now` are in seconds of any monotonic clock."""

    def __init__(self, store: SnapshotStore, *, follows: bool) -> None:
        self._store = store
        self.speed = 1.0
        self.is_following = follows
        self.is_playing = not follows
        self._anchor: tuple[float, float] | None = None  # a clock time, and the time in the run then
        self._index = 0

    def index(self, now: float) -> int | None:
        """Return the frame to show now, None while there is none."""
        span = self._store.span
        if span.first == span.end:
            return None
        if self.is_following:
            self._index = span.end - 1
        elif self.is_playing:
            self._index = self._store.index_at(self._time(now))
            if self._index >= span.end - 1:
                self._anchor = now, self._store.time(span.end - 1)
                self.is_playing = not self._store.is_complete
        self._index = min(max(self._index, span.first), span.end - 1)
        return self._index

    def _time(self, now: float) -> float:
        if self._anchor is None:
            self._anchor = now, self._store.time(self._index)
        began, t = self._anchor
        return t + (now - began) * self.speed

    def play(self, now: float, speed: float) -> None:
        """Play from here, at a speed; from the beginning if this is the end."""
        span = self._store.span
        if self._index >= span.end - 1 and self._store.is_complete:
            self._index = span.first
        self.speed = min(max(speed, MIN_SPEED), MAX_SPEED)
        self._go(now, self._index)
        self.is_playing = True

    def pause(self) -> None:
        """Stay at this frame."""
        self.is_playing = self.is_following = False

    def seek(self, now: float, t: float) -> None:
        """Go to a time in the run."""
        self._go(now, self._store.index_at(t))

    def step(self, now: float, frames: int) -> None:
        """Go some frames forward, or back, and stay there."""
        self.pause()
        span = self._store.span
        self._go(now, min(max(self._index + frames, span.first), max(span.end - 1, 0)))

    def jump(self, now: float, kinds: FrameMark, *, backward: bool) -> bool:
        """Go to the nearest frame in which one of these begins, and stay there; return False if none does."""
        found = self._store.next_marked(self._index, kinds, backward=backward)
        if found is None:
            return False
        self.pause()
        self._go(now, found)
        return True

    def follow(self) -> None:
        """Follow the newest frame."""
        self.is_following, self.is_playing = True, False

    def _go(self, now: float, index: int) -> None:
        self.is_following = False
        self._index = index
        span = self._store.span
        self._anchor = (now, self._store.time(index)) if span.first < span.end else None


# --- requests ------------------------------------------------------------------------------------------
#
# What a page asks for, checked as it comes in.


MAX_REQUEST_BYTES = 4096
"""Maximum size of a request of a page."""

_ALL_MARKS = int(
    FrameMark.WINNER
    | FrameMark.BREACH
    | FrameMark.FAULT
    | FrameMark.LATE
    | FrameMark.OUTSIDE
    | FrameMark.RESTART
)

Name = Annotated[str, msgspec.Meta(max_length=1000)]


class _Request(msgspec.Struct, frozen=True, kw_only=True, tag_field="do", tag=str.lower):
    """A request; its name, in lower case, is the member `do`."""


class Play(_Request, frozen=True, kw_only=True):
    """Play from here at `speed` times the speed of the run."""

    speed: Annotated[float, msgspec.Meta(gt=0, le=1000)] = 1.0


class Pause(_Request, frozen=True, kw_only=True):
    """Stay at this frame."""


class Seek(_Request, frozen=True, kw_only=True):
    """Go to a time in seconds."""

    t: float


class StepFrames(_Request, frozen=True, kw_only=True, tag="step"):
    """Go some frames forward, or back."""

    frames: Annotated[int, msgspec.Meta(ge=-10_000, le=10_000)]


class Jump(_Request, frozen=True, kw_only=True):
    """Go to the next frame in which something begins: a sum of `FrameMark`s."""

    kinds: Annotated[int, msgspec.Meta(ge=1, le=_ALL_MARKS)]
    backward: bool = False


class Follow(_Request, frozen=True, kw_only=True):
    """Follow the newest frame."""


class AskWhy(_Request, frozen=True, kw_only=True, tag="ask"):
    """Ask why a module did, or did not, command in a frame."""

    module: Name
    k: int


class Stop(_Request, frozen=True, kw_only=True):
    """Stop the robot in an emergency."""


class TuneParam(_Request, frozen=True, kw_only=True, tag="tune"):
    """Give a tunable param a value in its declared unit."""

    param: Name
    value: float


Request = Play | Pause | Seek | StepFrames | Jump | Follow | AskWhy | Stop | TuneParam

_decoder: msgspec.json.Decoder[Request] = msgspec.json.Decoder(Request)


def read_request(text: str | bytes) -> Request:
    """Return a request.

    Raises:
        msgspec.MsgspecError: it is none.
    """
    return _decoder.decode(text)


# --- viewer --------------------------------------------------------------------------------------------


PERIOD_S = 1.0 / 60.0
"""Seconds between two checks for a new frame: pages show at most 60 frames a second."""

GAP_S = 5.0
"""Largest step forward, in seconds of the run, after which a page is not sent the history and path again."""

TIMELINE_S = 1.0
"""Seconds between two timelines of a run that goes on."""

REPLACED_S = 0.1
"""Seconds between two checks whether another run is to be shown."""

UNSUPPORTED = 1003
"""Code with which a WebSocket is closed that sends a binary message."""

_encode = msgspec.json.Encoder().encode


class Viewer:
    """A page. Mutable.

    Args:
        socket: its WebSocket, accepted.
        watched: the run.
    """

    def __init__(self, socket: WebSocket, watched: Watched) -> None:
        self._socket, self._watched = socket, watched
        self._player = Player(watched.store, follows=watched.is_live)
        self._changed = asyncio.Event()
        self._asked: AskWhy | None = None
        self._is_asked = asyncio.Event()
        self._tuned: dict[str, float] = {}  # what the robot was not yet asked for
        self._is_tuned = asyncio.Event()
        self._shown: int | None = None
        self._shown_s = 0.0
        self._state: object = None
        self._timeline_due = 0.0
        self._timeline_size = -1
        self._answers_shown = 0

    async def serve(self, is_shown: Callable[[], bool]) -> None:
        """Serve the page until its connection ends, or its run is no longer shown."""
        watched = self._watched
        await self._send(
            scene=watched.scene,
            live=watched.is_live,
            may_stop=watched.stop is not None,
            may_ask=watched.explain is not None,
            may_tune=watched.tune is not None,
        )
        with nullcontext() if watched.asker is None else watched.asker.page():
            await _first_of(
                self._show(), self._receive(), self._answer(), self._tune(), _until_replaced(is_shown)
            )

    async def _send(self, **members: Any) -> None:
        await self._socket.send_text(_encode(members).decode())

    # --- to the page ---------------------------------------------------------------------------------

    async def _show(self) -> None:
        while True:
            now = time.monotonic()
            await self._show_frame(now)
            await self._show_timeline(now)
            await self._show_seen()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._changed.wait(), PERIOD_S)
            self._changed.clear()

    async def _show_frame(self, now: float) -> None:
        player, store = self._player, self._watched.store
        i = player.index(now)
        state = (player.is_playing, player.is_following, player.speed, store.problem)
        if i is None:
            if state != self._state:
                self._state = state
                await self._send(waiting=True, problem=store.problem)
            return
        if i == self._shown and state == self._state:
            return
        t = store.time(i)
        if self._shown is None or i < self._shown or t - self._shown_s > GAP_S:
            await self._send(history=history_to(store, i + 1), path=path_to(store, i + 1))
        self._shown, self._shown_s, self._state = i, t, state
        members = {"playing": player.is_playing, "following": player.is_following, "speed": player.speed}
        await self._send(snapshot=msgspec.Raw(store.read(i)), player=members, problem=store.problem)

    async def _show_timeline(self, now: float) -> None:
        store = self._watched.store
        end = store.span.end + store.is_complete
        if now < self._timeline_due or end == self._timeline_size:
            return
        timeline = await run_in_threadpool(timeline_of, store)
        self._timeline_size = end
        self._timeline_due = time.monotonic() + TIMELINE_S
        await self._send(timeline=timeline)

    async def _show_seen(self) -> None:
        """Send what is seen now to a page that shows the newest frame."""
        asker = self._watched.asker
        answers = None if asker is None else asker.answers
        if answers is not None and answers.number != self._answers_shown and self._player.is_following:
            self._answers_shown = answers.number
            await self._send(seen=answers.seen)

    # --- from the page -------------------------------------------------------------------------------

    async def _receive(self) -> None:
        while True:
            try:
                text = await self._socket.receive_text()
            except KeyError:  # the message is binary
                await self._socket.close(UNSUPPORTED)
                return
            try:
                request = read_request(text)
            except msgspec.MsgspecError as problem:
                await self._send(refused=str(problem))
                continue
            await self._serve(request)
            self._changed.set()

    async def _serve(self, request: Request) -> None:
        player, now = self._player, time.monotonic()
        match request:
            case Play(speed=speed):
                player.play(now, speed)
            case Pause():
                player.pause()
            case Seek(t=t):
                player.seek(now, t)
            case StepFrames(frames=frames):
                player.step(now, frames)
            case Jump(kinds=kinds, backward=backward):
                if not player.jump(now, FrameMark(kinds), backward=backward):
                    await self._send(refused="nothing of that kind in this direction")
            case Follow():
                player.follow()
            case AskWhy():
                self._asked = request
                self._is_asked.set()
            case Stop():
                await self._stop()
            case TuneParam():
                self._tuned[request.param] = request.value
                self._is_tuned.set()
            case _:
                assert_never(request)

    async def _answer(self) -> None:
        """Answer the newest question; no other request waits for the answer, above all no stop."""
        explain = self._watched.explain
        while True:
            await self._is_asked.wait()
            self._is_asked.clear()
            assert self._asked is not None
            module, k = self._asked.module, self._asked.k
            if explain is None or module not in self._watched.scene.modules:
                await self._send(refused=f"nobody can say why of `{module}`")
                continue
            lines = await run_in_threadpool(explain, k, module)
            await self._send(answer={"module": module, "k": k, "lines": lines})

    async def _stop(self) -> None:
        stop = self._watched.stop
        if stop is None:
            await self._send(refused="this page may not stop the robot")
            return
        await self._send(stop=await run_in_threadpool(stop))

    async def _tune(self) -> None:
        """Give params their values; no other request waits for the robot, above all no stop."""
        tune = self._watched.tune
        while True:
            await self._is_tuned.wait()
            self._is_tuned.clear()
            values, self._tuned = self._tuned, {}
            if tune is None:
                await self._send(refused="this page may not change params")
                continue
            await self._send(tuned=await run_in_threadpool(tune, values))


async def _until_replaced(is_shown: Callable[[], bool]) -> None:
    while is_shown():
        await asyncio.sleep(REPLACED_S)


async def _first_of(*jobs: Coroutine[Any, Any, None]) -> None:
    """Do several jobs until one of them ends, also because the connection is gone."""
    tasks = [asyncio.create_task(job) for job in jobs]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
