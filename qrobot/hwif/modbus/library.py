"""The one place that says what to do when pymodbus is missing."""

from __future__ import annotations

from importlib.util import find_spec

from qrobot.errors import ConfigError


def require_pymodbus() -> None:
    """Raises ConfigError when pymodbus is not installed."""
    if find_spec("pymodbus") is None:
        raise ConfigError("Modbus needs pymodbus: pip install 'qrobot[modbus]'")
