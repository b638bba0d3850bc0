"""Slow a motion down while it is under way, hold it on its path, and let it go on: the places stay the same.

qrobot run --offline examples/21_override.py
"""

from qrobot import rccl

with rccl.control("puma560") as arm:
    arm.move(arm.pose("end"))
    arm.waitas(lambda: arm.time > 1000)  # on the way
    arm.override(25)
    arm.waitas(lambda: arm.time > 3000)
    arm.pause()
    arm.waitas(lambda: arm.rate == 0.0)
    print(f"held on its path after {arm.time:.0f} ms, waist at {arm.joints[0]:.1f} deg")
    arm.waitas(lambda: arm.time > 4500)
    arm.override(100)
    arm.resume()
    arm.waitfor(arm.completed)
    print(f"at the end after {arm.time:.0f} ms")
    arm.move(arm.pose("park"))
