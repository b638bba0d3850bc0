"""The content of a log, live: a WebSocket server that viewers such as Foxglove and Lichtblick connect to.

It only shows. It offers no service, takes no parameter and no message of a client; so whoever connects moves nothing.
"""

from __future__ import annotations

from typing import Final

import foxglove

from qrobot.config import Robot
from qrobot.errors import LinkError
from qrobot.fences.told_fences import ToldFences
from qrobot.log.arm_view import Point
from qrobot.log.header import LogHeader
from qrobot.log.mcap_file import LogStream
from qrobot.log.pace import Pace
from qrobot.log.status import LogStatus
from qrobot.model.arm_shape import NO_TOOL
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.telemetry import Rows

HOST: Final = "127.0.0.1"


class LiveServer:
    """Shows the rows of one servo to whoever connects; takes them as `LogWriter` does.

    Args:
        port: 0 for any.
        header: facts of the servo.
        rate_hz: rows a second that are shown.
        robot, tool_m, fences: see `ArmView`.

    Raises:
        LinkError: the port is taken.
    """

    def __init__(
        self,
        port: int,
        header: LogHeader,
        rate_hz: int,
        robot: Robot,
        tool_m: Point = NO_TOOL,
        fences: ToldFences | None = None,
    ) -> None:
        self._stream = LogStream(header, robot, tool_m, fences)
        self._pace = Pace(rate_hz)
        self.status = LogStatus()
        self.last_error, self.backlog = "", 0
        self._law: LawInForce | None = None
        try:
            self._server = foxglove.start_server(
                name=f"qrobot {header.robot}", host=HOST, port=port, capabilities=[], context=self._stream.context
            )
        except (RuntimeError, OSError) as error:
            raise LinkError(f"cannot show anything at port {port}: {error}; name another one with --port") from None

    @property
    def port(self) -> int:
        """The port it listens on."""
        return int(self._server.port)

    @property
    def heading(self) -> str:
        """Place that the rows go to, for people."""
        return f"shown at ws://{HOST}:{self.port}"

    def append(self, rows: Rows, lost: int = 0) -> None:
        """Show those of the rows, shape (m,), whose turn it is. Rows lost before them are counted."""
        self._stream.log_rows(rows[self._pace.due(rows["t_ns"])])
        now = int(rows["t_ns"][-1]) if rows.size else self.status.t_ns
        self.status = LogStatus(now, self.status.rows + rows.size, self.status.lost + lost, 0, 0)

    def append_law(self, law: LawInForce) -> None:
        """Show what is in force."""
        self._law = law
        self._stream.log_law(law, self.status.t_ns)

    def count_lost(self, rows: int) -> None:
        """Leave out rows that a servo left behind: they are no loss to who looks."""

    def flush(self) -> None:
        """Show the counts; and law and looks of the arm once more, for those who have connected since."""
        if self.status.rows:
            self._stream.log_status(self.status)
        if self._law is not None:
            self._stream.log_law(self._law, self.status.t_ns)
        self._stream.begin_part()

    def sync(self) -> None:
        """Leave out what a file needs: here is no disk."""

    def drain(self) -> None:
        """Leave out what a file needs: here is no disk."""

    def close(self) -> None:
        """End the server and every connection."""
        self._server.stop()
