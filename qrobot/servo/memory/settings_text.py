"""Settings of a control law as one line, as the journal of laws keeps them and people see them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

SETTINGS_BYTES: Final = 512


def settings_text(settings: Mapping[str, float]) -> str:
    """Settings of a law in one line that an entry of the journal has room for."""
    text = " ".join(f"{name}={value:g}" for name, value in settings.items())
    return text.encode()[:SETTINGS_BYTES].decode(errors="ignore")
