"""Teach-record-replay: the first run asks for places by the teach pendant, the next ones go through them.

Corke & Kirkham, section 2.9: "This permits ARCL programs to emulate the teach-record-replay style of robot controller."

    qrobot run examples/24_teach_and_replay.py places.db               # first: keys move the arm, ENTER takes a place
    qrobot run --offline examples/24_teach_and_replay.py places.db     # then, also off line
"""

import sys
from pathlib import Path

from qrobot.arcl import (
    ARCL_ARGCV,
    EQ,
    MOV_NAME,
    MOV_SHARE,
    MOV_SYNC,
    OK,
    T6,
    TL,
    arcl_close,
    arcl_open,
    makeposition,
    move,
    robot_pos,
    sym_dump,
    sym_enter,
    sym_load,
    sym_lookup,
    sym_names,
    teach,
)


def learn(place, _rp):
    """Keep a place; it is called T1, T2 and so on."""
    sym_enter(place)
    print(f"{place.name}: x {place.t_p.x:.1f} y {place.t_p.y:.1f} z {place.t_p.z:.1f} mm")
    return OK


rp = arcl_open(ARCL_ARGCV, len(sys.argv), sys.argv, 0)
path = Path(sys.argv[1] if len(sys.argv) > 1 else "places.db")
if path.exists():
    sym_load(path)
else:
    teach(rp, learn)
    print(f"places in {path}: {sym_dump(path)}")
for name in sym_names():
    move(rp, makeposition(T6, EQ, sym_lookup(name), TL, T6), MOV_NAME, name, MOV_SHARE, 30, MOV_SYNC, 0)
    print(f"at {name}")
move(rp, robot_pos(rp, "park"), 0)
arcl_close(rp)
