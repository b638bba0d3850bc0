"""A program that keeps its interpreter in a call of C while its arm moves, until a byte comes; then it computes on.

python held_interpreter.py PROCESSOR
"""

import ctypes
import sys
import time

import numpy as np

from qrobot import rccl

arm = rccl.control(processor=sys.argv[1])
goal = np.degrees(arm.how.q) + np.array([60, 0, 0, 0, 0, 0])
arm.setime(100, 20_000)
arm.move(arm.jposition("FAR", goal))
start = arm.how.q[0]
arm.waitas(lambda: arm.how.q[0] > start + 1e-3)
library = ctypes.PyDLL(None)  # whose calls keep the interpreter
sys.stdout.write("holding\n")
sys.stdout.flush()
library.read(0, ctypes.create_string_buffer(1), 1)
sys.stdout.write("let go\n")
sys.stdout.flush()
while True:
    time.sleep(1.0)
