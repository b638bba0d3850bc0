"""A suction cup carries a plate: an analogue output by its name, the load, and collisions that are told sooner.

    qrobot run --lockstep --deployment examples/val/11_vacuum.toml examples/arcl/vacuum.py

The output and its name stand in the deployment file; off line there is none.
"""

import sys

from qrobot.arcl import (
    ARCL_ARGCV,
    EQ,
    MOV_CONFIG,
    MOV_SYNC,
    MOV_TRAJ,
    MOV_VR,
    MOV_VT,
    T6,
    TL,
    TRAJ_CART,
    TRAJ_JOINT,
    ami_treal,
    arcl_close,
    arcl_collision,
    arcl_open,
    arcl_setload,
    arcl_wait,
    iod_set_value,
    makeposition,
    move,
    named_iod,
    new_trans_rpy,
    new_trans_tr,
)

SOON = [50.0, 60.0, 30.0, 4.0, 4.0, 4.0]  # N m of each joint
PLATE_KG, CENTRE_MM = 0.8, (0.0, 0.0, 60.0)
FULL_KPA, NONE_KPA = -64.0, 0.0

rp = arcl_open(ARCL_ARGCV, len(sys.argv), sys.argv, 0)
vacuum = named_iod(rp, "vacuum")
cup = new_trans_tr("cup", 0.0, 0.0, 60.0)
above = new_trans_tr("above", 0.0, 0.0, -80.0)
arcl_collision(rp, "comply", SOON)


def work(name: str, y: float, kpa: float, kg: float) -> None:
    """Go to a place from above, change the vacuum there, tell the load, and leave as it came."""
    place = new_trans_rpy(name, 450.0, y, -50.0, 0.0, 180.0, 0.0)
    near, there = makeposition(T6, cup, EQ, place, above, TL, cup), makeposition(T6, cup, EQ, place, TL, cup)
    slow = MOV_TRAJ, TRAJ_CART, MOV_VT, 100.0, MOV_VR, 60.0
    move(rp, near, MOV_TRAJ, TRAJ_JOINT, MOV_CONFIG, "ruf", 0)
    move(rp, there, *slow, MOV_SYNC, 0)
    arcl_wait(rp)
    iod_set_value(vacuum, kpa)
    end = ami_treal() + 500.0
    arcl_wait(rp, lambda: ami_treal() > end)
    arcl_setload(rp, kg, CENTRE_MM)
    move(rp, near, *slow, 0)


work("stack", 150.0, FULL_KPA, PLATE_KG)
work("tray", -150.0, NONE_KPA, 0.0)
arcl_wait(rp)
print("the plate lies on the tray")
arcl_close(rp)
