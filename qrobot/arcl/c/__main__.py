"""The engine of a program that was started by itself: `python -m qrobot.arcl.c` and the descriptors of two channels."""

import sys

from qrobot.arcl.c.dispatcher import ArclDispatcher
from qrobot.c_transport.engine import serve_descriptors
from qrobot.errors import ConfigError


def no_rccl(*_: object) -> ArclDispatcher:
    """Raise ConfigError: this engine is for ARCL."""
    raise ConfigError("this program calls RCCL: compile it anew with `qrobot cc`")


if __name__ == "__main__":
    sys.exit(serve_descriptors([no_rccl, ArclDispatcher]))
