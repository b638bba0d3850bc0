"""An isolated network link: a cable between two machines on which nobody else is, as the paper's crossover cable.

Programs of another host command the arm over it without a tunnel. Nothing is encrypted there: what keeps others out is
the cable, the list of peers, and a token that both hosts have in a file.
"""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from qrobot.errors import ConfigError
from qrobot.realtime.bridge_token import LONGEST_BYTES, RANDOM_BYTES

_OTHERS: Final = 0o077


@dataclass(frozen=True)
class IsolatedLink:
    """Address at which a bridge listens beside the loopback interface, and whom it lets in there.

    Attributes:
        interface: network interface of the link; what comes by another one is not heard.
        address: of this machine on it.
        peers: addresses of the other hosts.
        token: what their programs have to show.
    """

    interface: str
    address: str
    peers: tuple[str, ...]
    token: bytes


def read_link_token(path: Path) -> bytes:
    """The token of a link, from a file that its owner alone can read.

    Raises ConfigError when it cannot be read, others can read it, or it is no token.
    """
    try:
        with path.open("rb") as file:
            found = os.fstat(file.fileno())
            token = file.read(LONGEST_BYTES + 2).strip()
    except OSError as error:
        raise ConfigError(f"token file {path}: {error.strerror}; make one with: {_RECIPE.format(path)}") from None
    if not stat.S_ISREG(found.st_mode) or found.st_mode & _OTHERS or found.st_uid not in (0, os.geteuid()):
        raise ConfigError(f"token file {path}: other accounts can reach it: chmod 600, and own it")
    if not RANDOM_BYTES <= len(token) <= LONGEST_BYTES or not token.isascii() or len(token.split()) != 1:
        raise ConfigError(
            f"token file {path}: a line of {RANDOM_BYTES} to {LONGEST_BYTES} letters and digits is needed; make one "
            f"with: {_RECIPE.format(path)}"
        )
    return token


_RECIPE: Final = "(umask 77; head -c 32 /dev/urandom | base64 > {})"
