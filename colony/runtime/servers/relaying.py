"""The relay in DServer, which publishes the answers of modules in Python as frames."""

from __future__ import annotations

from collections.abc import Iterable

from colony.runtime.frames.assembler import BLIND, COMMAND, ERROR
from colony.runtime.frames.publishing import KEPT_BYTES, FetchBudget, frame_bytes
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Announcement, Effect, Fetch, Sample, Send, ServerFrame


class ActivityRelay:
    """A publisher of announcements as frames. Mutable.

    It keeps the newest `frames_kept` frames of each module, and answers fetches within a budget that each
    tick renews. The module's process receives the same fetches, and announces again the answers that are not
    kept here.
    """

    def __init__(self, server: str, modules: tuple[str, ...], *, frames_kept: int) -> None:
        self._server = server
        self._max_frames = frames_kept
        self._budget = FetchBudget()
        self.listens = (topics.announcements(server), topics.fetches(server))
        self.deploy(modules)

    def deploy(self, modules: tuple[str, ...]) -> None:
        """Relay the answers of these modules from now on."""
        self._names = {module: topics.activity(self._server, module) for module in modules}
        self._frames: dict[str, dict[int, ServerFrame]] = {name: {} for name in self._names.values()}
        self._bytes = dict.fromkeys(self._frames, 0)
        self._bytes_per_module = KEPT_BYTES // max(1, len(self._names))

    def tick(self) -> None:
        """Begin a frame: renew the budget for fetches."""
        self._budget.reset()

    def announce(self, message: Announcement, now_ns: int) -> Iterable[Effect]:
        """Relay an announcement; ignore unknown modules and repeated announcements."""
        name = self._names.get(message.module)
        if name is None or message.k in self._frames[name]:
            return ()
        kept = self._frames[name]
        values, error, blind = message.answer
        fields = {
            COMMAND: None if values is None else Sample(values, now_ns),
            ERROR: Sample(error, now_ns),
            BLIND: Sample(blind, now_ns),
        }
        frame = kept[message.k] = ServerFrame(server=name, k=message.k, fields=fields)
        self._bytes[name] += frame_bytes(fields)
        while len(kept) > 1 and (len(kept) > self._max_frames or self._bytes[name] > self._bytes_per_module):
            self._bytes[name] -= frame_bytes(kept.pop(next(iter(kept))).fields)
        return (Send(topics.frames(name), frame),)

    def fetch(self, message: Fetch) -> Iterable[Effect]:
        """Publish a frame again, if it is kept."""
        frame = self._frames.get(message.server, {}).get(message.k)
        if frame is None or not self._budget.take(message.server, message.k, frame_bytes(frame.fields)):
            return ()
        return (Send(topics.frames(message.server), frame),)
