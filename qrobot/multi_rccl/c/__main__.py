"""The engine of a program that was started by itself: `python -m qrobot.multi_rccl.c`, descriptors of two channels."""

import sys

from qrobot.c_transport.engine import serve_descriptors
from qrobot.errors import ConfigError
from qrobot.multi_rccl.c.dispatcher import ManipDispatcher


def other_release(*_: object) -> ManipDispatcher:
    """Raise ConfigError: this engine is for Multi-RCCL."""
    raise ConfigError("this program does not call Multi-RCCL: compile it anew with `qrobot cc`")


if __name__ == "__main__":
    sys.exit(serve_descriptors([other_release, other_release, ManipDispatcher]))
