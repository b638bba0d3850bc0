"""The engine of a program that was started by itself: `python -m qrobot.rccl.c` and the descriptors of two channels."""

import sys

from qrobot.c_transport.engine import serve_descriptors
from qrobot.rccl.c.program import rccl_dispatcher

if __name__ == "__main__":
    sys.exit(serve_descriptors([rccl_dispatcher()]))
