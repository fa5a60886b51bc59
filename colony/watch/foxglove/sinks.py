"""Where the messages of a run go: an MCAP file, or Foxglove itself, over a WebSocket on this machine."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, BinaryIO

import msgspec
from mcap.writer import CompressionType, Writer

from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.watch.foxglove.messages import RunChannel, RunMessage, RunMessages
from colony.watch.scene import PageScene

if TYPE_CHECKING:
    import foxglove

CHUNK_BYTES = 4 * 1024 * 1024


def write_mcap(file: BinaryIO, messages: RunMessages, frames: Iterable[RunFrame], library: str) -> int:
    """Write the messages of a run; return the number of frames.

    Raises:
        OSError: the file cannot be written.
    """
    writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
    writer.start(library=library)
    channels = {}
    for channel in messages.channels:
        schema = writer.register_schema(channel.schema_name, "jsonschema", _text(channel))
        channels[channel.topic] = writer.register_channel(channel.topic, "json", schema)
    count = 0
    for frame in frames:
        count += 1
        for topic, t_ns, data in messages.take(frame):
            writer.add_message(channels[topic], t_ns, data, t_ns, frame.tick.k)
    writer.finish()  # type: ignore[no-untyped-call]
    return count


class FoxgloveServer:
    """A server of one run after the other, at a port of this machine. Mutable; `close` it.

    Any user of this machine may read from it; nobody can send the robot anything through it.

    Raises:
        RuntimeError: the port is taken.
    """

    def __init__(self, port: int) -> None:
        import foxglove
        from foxglove.websocket import ServerListener

        from colony.watch.serving import LOOPBACK

        class Subscriptions(ServerListener):
            """Remembers that what does not change must be sent again; a thread of the server calls it."""

            def on_subscribe(_, client: object, channel: object) -> None:  # noqa: N805
                self.has_newcomer = True

        self._context, self._channels = foxglove.Context(), dict[str, foxglove.Channel]()
        self.has_newcomer = False
        """True if somebody subscribed since the last frame."""
        self._server = foxglove.start_server(
            name="colony",
            host=LOOPBACK,
            port=port,
            context=self._context,
            capabilities=[],
            server_listener=Subscriptions(),
        )
        self.url = f"ws://{LOOPBACK}:{self._server.port}"
        """The address to open in Foxglove."""

    def tap_for(self, program: Program, scene: PageScene) -> Callable[[RunFrame], None]:
        """Offer the topics of a run in place of the last one; return what takes its frames."""
        messages = RunMessages(program, scene)
        for channel in self._channels.values():
            channel.close()
        self._channels = channels = {c.topic: self._channel(c) for c in messages.channels}

        def log(found: Iterable[RunMessage]) -> None:
            for topic, t_ns, data in found:
                channels[topic].log(data, log_time=t_ns)

        def take(frame: RunFrame) -> None:
            if self.has_newcomer:
                self.has_newcomer = False
                log(messages.still(frame.frame.t_ns))
            log(messages.take(frame))

        return take

    def _channel(self, channel: RunChannel) -> foxglove.Channel:
        import foxglove

        schema = foxglove.Schema(name=channel.schema_name, encoding="jsonschema", data=_text(channel))
        return foxglove.Channel(channel.topic, schema=schema, message_encoding="json", context=self._context)

    def close(self) -> None:
        """Close all connections."""
        self._server.stop()


def _text(channel: RunChannel) -> bytes:
    return msgspec.json.encode(channel.schema)
