"""A check that pymodbus is installed, before anything that imports it."""

from __future__ import annotations

from importlib.util import find_spec

from qrobot.errors import ConfigError
from qrobot.extras import missing_library


def require_pymodbus() -> None:
    """Raises ConfigError when pymodbus is not installed."""
    if find_spec("pymodbus") is None:
        raise ConfigError(missing_library("pymodbus"))
