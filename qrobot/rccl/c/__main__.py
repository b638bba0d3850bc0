"""The engine of a program that was started by itself: `python -m qrobot.rccl.c` and the descriptors of two channels."""

import socket
import sys

from qrobot.errors import QRobotError
from qrobot.rccl.c.engine import serve


def main() -> int:
    """Serve the program at the other end; the exit status."""
    foreground, background = (socket.socket(fileno=int(word)) for word in sys.argv[1:3])
    try:
        serve(foreground, background)
    except QRobotError as error:
        print(f"motion engine: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
