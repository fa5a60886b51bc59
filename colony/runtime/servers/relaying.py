"""The relay in DServer, which publishes the answers of modules in Python as frames."""

from __future__ import annotations

from collections.abc import Iterable

from colony.runtime.frames.assembler import BLIND, COMMAND, ERROR
from colony.runtime.frames.publishing import FRAME_BYTES, KEPT_BYTES, FetchBudget, frame_bytes
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Announcement, Effect, Fetch, Sample, Send, ServerFrame


class ActivityRelay:
    """A publisher of announcements as frames. Mutable.

    It keeps the newest `frames_kept` frames of each module, and answers fetches within a budget that each
    tick renews. It passes fetches of answers that are not kept here on to the module's process, which
    announces them again: only DServer is linked to both that process and those that fetch.
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
        self._modules = {name: module for module, name in self._names.items()}
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
        """Publish a frame again, or let the module announce it again if it is not kept."""
        module = self._modules.get(message.server)
        if module is None:
            return ()
        frame = self._frames[message.server].get(message.k)
        size = FRAME_BYTES if frame is None else frame_bytes(frame.fields)
        if not self._budget.take(message.server, message.k, size):
            return ()
        if frame is None:
            return (Send(topics.repeats(self._server, module), message),)
        return (Send(topics.frames(message.server), frame),)
