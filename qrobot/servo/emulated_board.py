"""Judgement whether the board of an arm is emulated, where its deployment file says so."""

from __future__ import annotations

from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import BoardMemory, is_of_gateway


def insist_on_emulated(memory: BoardMemory, arm: str) -> None:
    """Raise ConfigError where the board of an arm that a deployment file calls emulated is one behind a gateway."""
    if is_of_gateway(memory):
        raise ConfigError(
            f"the deployment file says that the board of {arm} is emulated, and what runs under this name is a gateway "
            "to another one: name the file that `qrobot board` was started with"
        )
