"""A program that keeps its interpreter while its arm moves: the trajectory generator has a process of its own.

A power of whole numbers is a call that Python does not interrupt. A generator in a thread of the program would get no
turn meanwhile, and after two sample periods without a setpoint the servo would stop the arm. Here the arm goes to one
place while the program finds out, in such a call, where the next one is.

    qrobot run --lockstep examples/23_busy_program.py    # on virtual time no time passes while a program computes
    qrobot up & qrobot run examples/23_busy_program.py
"""

from qrobot import rccl
from qrobot.rccl import EQ, TL, gentr_trsl, makeposition, newtrans, t6

PLACES = 6
EXPONENT = 1_000_000  # so that the power takes far more than two sample periods
STEP_MM = 25.0


def next_place(k: int) -> float:
    """How far down the next place is, mm: found by a call that keeps the interpreter."""
    return STEP_MM * (k % 3) + (7**EXPONENT + k).bit_length() % 2


with rccl.control("puma560", processor="aux") as arm:
    here = newtrans("HERE", "const")
    here.set(arm.measured_t6)
    arm.setmode("cartesian")
    arm.setvel(50, 20)
    for k in range(1, PLACES + 1):
        way = gentr_trsl(f"WAY{k}", 0, 0, -next_place(k))
        arm.move(makeposition(f"PLACE{k}", t6, EQ, here, way, TL, way))  # returns at once
    arm.waitfor(arm.completed)
    print(f"{PLACES} places, and no stop on the way; done at {arm.time / 1000:.2f} s")
