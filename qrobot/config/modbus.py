"""The transport over Modbus TCP in a deployment file."""

from __future__ import annotations

from pydantic import Field

from qrobot.config.document import Table
from qrobot.config.values import ExchangePeriod


class ModbusTransport(Table):
    """Address of the board's Modbus server, and the period at which the image is exchanged with it.

    One exchange is one request. One that has no answer after `timeout_ms` has failed. `device_id` matters only behind a
    gateway to other devices.
    """

    host: str = "127.0.0.1"
    port: int = Field(default=502, ge=1, le=65535)
    device_id: int = Field(default=1, ge=0, le=255)
    period_ms: ExchangePeriod = 2.0
    timeout_ms: float = Field(default=50.0, gt=0, le=1000, allow_inf_nan=False)

    @property
    def places(self) -> frozenset[str]:
        """The device behind its server."""
        host = "127.0.0.1" if self.host == "localhost" else self.host
        return frozenset([f"device {self.device_id} at {host}:{self.port}"])
