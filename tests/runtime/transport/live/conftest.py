"""Users behind a gateway, and somebody outside a host."""

from tests.runtime.transport.live.gateway_lab import lab as lab
from tests.runtime.transport.live.outside import outside as outside
