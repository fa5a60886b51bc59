"""What the servers of robots that come with colony offer."""

from __future__ import annotations

from colony.body.shipped import shipped_servers

ROME_SERVERS = shipped_servers("rome")
