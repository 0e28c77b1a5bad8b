"""Connections of the page that cannot be held open for nothing.

Any program of this machine can connect, with no token yet. uvicorn waits for the rest of a request
as long as it takes, so that connections which say nothing would use up those that it can have.
"""
from __future__ import annotations

import asyncio
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S = 10.0           # for the head of a request, from its first byte or that of the connection
MAX_CONNECTIONS = 100   # a browser has six
GRACE_S = 1             # for answers under way when the page ends


def page_config(app: Any) -> uvicorn.Config:
    """How uvicorn serves the page.

    Parameters
    ----------
    app : ASGI application
    """
    return uvicorn.Config(app, http=TimedConnection, ws="none", log_level="critical",
                          access_log=False, timeout_graceful_shutdown=GRACE_S)


class TimedConnection(H11Protocol):
    """A connection that is closed where no request comes, or not its whole head, within a time.

    Of more than a hundred the one that has waited longest for a request gives way.
    """

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a request."""
        super().connection_made(transport)
        self._watch()
        waiting = [each for each in self.connections
                   if isinstance(each, TimedConnection) and each._late is not None]
        if len(self.connections) > MAX_CONNECTIONS and waiting:
            min(waiting, key=TimedConnection._closing_at).transport.abort()

    def data_received(self, data: bytes) -> None:
        """Take what came, and wait on where it was no whole head."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no longer."""
        self._stop_waiting()
        super().connection_lost(exc)

    def _watch(self) -> None:
        """The time runs from the first byte; what dribbles in does not begin it anew."""
        if self.cycle is not None and not self.cycle.response_complete:
            self._stop_waiting()
        elif self._late is None:
            self._late = self.loop.call_later(HEAD_S, self.transport.close)

    def _stop_waiting(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _closing_at(self) -> float:
        return float("inf") if self._late is None else self._late.when()
