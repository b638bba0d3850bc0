"""A weld with a weave: a functional transform swings the tool while it goes along the seam (Corke & Kirkham, 2.5).

The function is called at each sample with its transform and the motion that it is part of; `m.t0` is the time at which
that motion was taken out of the queue.
"""

import sys
from math import pi, sin

from qrobot.arcl import (
    ARCL_ARGCV,
    EQ,
    FNDEF,
    MOV_CONFIG,
    MOV_SYNC,
    MOV_TIME,
    MOV_TRAJ,
    MOV_VR,
    MOV_VT,
    T6,
    TL,
    TRAJ_CART,
    TRAJ_JOINT,
    ami_treal,
    arcl_close,
    arcl_open,
    makeposition,
    move,
    new_trans,
    new_trans_rpy,
    new_trans_tr,
)

WEAVE_AMP = 10.0  # mm
WEAVE_FREQ = 2.0  # Hz


def weave_func(weave, m):
    """The swing at this instant. It grows within the first half second: the tool has no speed yet."""
    elapsed = ami_treal() - m.t0
    theta = 2.0 * pi * elapsed * WEAVE_FREQ / 1000.0
    weave.t_p.x = WEAVE_AMP * sin(theta) * min(elapsed / 500.0, 1.0) ** 3


rp = arcl_open(ARCL_ARGCV, len(sys.argv), sys.argv, 0)
torch = new_trans_tr("torch", 0.0, 0.0, 150.0)
seam = new_trans_rpy("seam", 500.0, -100.0, 0.0, 0.0, 180.0, 0.0)
along = new_trans_tr("along", 0.0, 200.0, 0.0)
weave = new_trans("weave", FNDEF, weave_func)

begin = makeposition(T6, torch, EQ, seam, TL, torch)
welded = makeposition(T6, torch, EQ, seam, along, weave, TL, torch)

move(rp, begin, MOV_TRAJ, TRAJ_JOINT, MOV_CONFIG, "ruf", MOV_TIME, 4000, MOV_SYNC, 0)
move(rp, welded, MOV_TRAJ, TRAJ_CART, MOV_VT, 40, MOV_VR, 30, MOV_SYNC, 0)
arcl_close(rp)
