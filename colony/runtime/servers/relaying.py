"""How DServer hands on what modules in Python announce: whether they are active in a frame."""

from __future__ import annotations

from collections.abc import Iterable

from colony.runtime.frames.assembly import ACTIVE
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import Announcement, Effect, Fetch, Sample, Send, ServerFrame
from colony.runtime.servers.publishing import FRAME_BYTES, KEPT_BYTES, FetchBudget


class ActivityRelay:
    """Publishes each announcement as a frame, and keeps the newest `keep` of a module. Mutable: those.

    It is asked for them again by fetches to its server, and answers them within a budget that each tick
    renews. What it does not have the announcer may have, which hears those fetches too and announces again.
    """

    def __init__(self, server: str, modules: tuple[str, ...], *, keep: int) -> None:
        self._server = server
        self._most = keep
        self._budget = FetchBudget()
        self.listens = (topics.announcements(server), topics.fetches(server))
        self.deploy(modules)

    def deploy(self, modules: tuple[str, ...]) -> None:
        """From now on these are the modules whose activity it hands on."""
        self._names = {module: topics.activity(self._server, module) for module in modules}
        self._kept: dict[str, dict[int, ServerFrame]] = {name: {} for name in self._names.values()}
        self._keep = min(self._most, max(1, KEPT_BYTES // (2 * FRAME_BYTES * max(1, len(self._names)))))

    def tick(self) -> None:
        """A frame begins: fetches are answered again."""
        self._budget.renew()

    def announce(self, message: Announcement, now_ns: int) -> Iterable[Effect]:
        """Hand it on; what a stranger announces, or is announced again, is ignored."""
        name = self._names.get(message.module)
        if name is None or message.k in self._kept[name]:
            return ()
        kept = self._kept[name]
        frame = ServerFrame(server=name, k=message.k, fields={ACTIVE: Sample(message.active, now_ns)})
        kept[message.k] = frame
        if len(kept) > self._keep:
            del kept[next(iter(kept))]
        return (Send(topics.frames(name), frame),)

    def fetch(self, message: Fetch) -> Iterable[Effect]:
        """Publish a frame again, if it is here."""
        frame = self._kept.get(message.server, {}).get(message.k)
        if frame is None or not self._budget.take(message.server, message.k, 2 * FRAME_BYTES):
            return ()
        return (Send(topics.frames(message.server), frame),)
