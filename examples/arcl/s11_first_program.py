"""The program of the ARCL paper: a position equation, and ways to move to it (Corke & Kirkham, sections 2.1 to 2.3).

Run it with `qrobot run examples/arcl/s11_first_program.py`, with `--lockstep`, or with `--offline`; `+tr` and `+m`
behind it print what the paper's switches print. "lun", the last configuration, needs joint 1 at 180 degrees, which no
PUMA 560 reaches: an error for the program's handler, which goes on.
"""

import sys

from qrobot.arcl import (
    ARCL_ARGCV,
    EQ,
    MOV_CONFIG,
    MOV_SYNC,
    MOV_TIME,
    MOV_TRAJ,
    OK,
    T6,
    TL,
    TRAJ_CART,
    TRAJ_JOINT,
    arcl_close,
    arcl_errproc,
    arcl_open,
    arcl_wait,
    makeposition,
    move,
    new_trans_rotvec,
    new_trans_tr,
    where,
    yunit,
)


def on_error(event, _rp, error):
    """Tell the error, and go on with the next motion."""
    print(f"{event.name}: {error}")
    return OK


rp = arcl_open(ARCL_ARGCV, len(sys.argv), sys.argv, 0)
arcl_errproc(on_error)

base = new_trans_tr("base", 0.0, 0.0, 300.0)
tool = new_trans_tr("tool", 0.0, 0.0, 170.0)
stand = new_trans_tr("stand", 600.0, 100.0, 500.0)
work = new_trans_rotvec("work", -100.0, 50.0, 345.0, yunit, 30.0)
pos = makeposition(base, T6, tool, EQ, stand, work, TL, tool)

move(rp, pos, MOV_CONFIG, "run", 0)
move(rp, pos, MOV_TRAJ, TRAJ_CART, 0)
move(rp, pos, MOV_TRAJ, TRAJ_JOINT, MOV_TIME, 2000, MOV_SYNC, 0)
move(rp, pos, MOV_TRAJ, TRAJ_JOINT, MOV_TIME, 2000, MOV_CONFIG, "lun", 0)
arcl_wait(rp)
print("T6 at", " ".join(f"{number:.1f}" for number in where(rp).t_p), "mm")
arcl_close(rp)
