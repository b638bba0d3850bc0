"""The experiment of the QRobot paper: from park to an end position at constant speed, and back at triple that speed.

Run it with `qrobot run examples/01_park_and_return.py`, or with plain Python while `qrobot up` runs.
"""

from qrobot import rccl

SLOW = 0.35  # rad/s of the fastest joint

with rccl.control("puma560") as arm:
    park, end = arm.pose("park"), arm.pose("end")
    journey = [
        ("to park, where the arm may be already", park, SLOW),
        ("to the end position at constant speed", end, SLOW),
        ("back to park at triple speed", park, 3 * SLOW),
    ]
    for what, position, speed in journey:
        begin = arm.time
        arm.setjvel(speed)
        arm.move(position)
        arm.waitfor(arm.completed)
        degrees = " ".join(f"{joint:7.2f}" for joint in arm.joints)
        print(f"{what:40} {(arm.time - begin) / 1000:5.2f} s, now at {degrees} deg")
