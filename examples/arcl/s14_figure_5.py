"""Figure 5 of the ARCL paper: PARK, a position, PARK at 10 mm/s, off line (Corke & Kirkham, section 4).

    python examples/arcl/s14_figure_5.py +m +nolim

prints the figure to the character; `+tr` its second part, no switch its first. The paper prints no joint angles of
PARK: these are chosen so that the way from PARK takes the figure's 2425 samples. `+nolim` takes the ranges from the
joints, as the paper's run must have: joint 5 goes to 118 degrees.
"""

import sys

from qrobot.arcl import (
    ARCL_AMI,
    ARCL_ARGCV,
    ARCL_START,
    EQ,
    MOV_CONFIG,
    MOV_TIME,
    MOV_VR,
    MOV_VT,
    T6,
    TL,
    arcl_close,
    arcl_open,
    joint_pos,
    makeposition,
    move,
    new_trans_rpy,
    new_trans_tr,
)

PARK = (0.0, 90.0, -90.0, 0.0, 90.0, 0.0)  # degrees

rp = arcl_open(ARCL_ARGCV, len(sys.argv), sys.argv, ARCL_AMI, "offline", ARCL_START, PARK, 0)

base = new_trans_tr("base", 0.0, 0.0, 862.0)
tool = new_trans_tr("tool", 0.0, 0.0, 170.0)
p = new_trans_rpy("p", 500.0, 600.0, 800.0, 0.0, 30.0, 0.0)
pos = makeposition(base, T6, tool, EQ, p, TL, tool)
park = joint_pos(rp, "PARK", PARK, TL, tool)

move(rp, park, MOV_TIME, 300, 0)
move(rp, pos, MOV_VT, 10, MOV_VR, 10, 0)
move(rp, park, MOV_CONFIG, "run", 0)
arcl_close(rp)
