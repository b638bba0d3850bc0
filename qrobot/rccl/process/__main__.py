"""`python -m qrobot.rccl.process CHANNEL MEMORY PROGRAM`: the process of a generator; a program starts it by itself."""

import sys

from qrobot.rccl.process.generator_host import run

run(*map(int, sys.argv[1:4]))
