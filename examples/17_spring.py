"""A control law of one's own at setpoint level: joint 1 becomes a spring with a damper, the others hold.

RCI takes the place of RCCL's trajectory generator (Lloyd, Parker and McClain 1987, section 2) by a hybrid controller:
torque on one joint and position on the rest. The spring's end is half a radian away; the arm goes there and rests.

    qrobot run --lockstep examples/17_spring.py
"""

from qrobot.rci import rci_close, rci_control, rci_create, rci_start, rci_wait

SPRING = 30.0  # N m/rad
DAMPER = 25.0  # N m s/rad
AWAY = 0.5  # rad
SAMPLES = 250  # of 28 ms
rests = {}  # where the arm stood
way = []


def hybrid(td):
    """Torque on joint 1, position on all others."""
    hold = rests.setdefault("arm", td.how.q_setpoint)
    torque = SPRING * (hold[0] + AWAY - td.how.q[0]) - DAMPER * td.how.v[0]
    td.chg.drive((torque, *hold[1:]), (True, *[False] * 5))
    way.append(td.how.q[0] - hold[0])


arm = rci_create("puma560")
rci_control(arm, hybrid)
rci_start(arm.bit)
rci_wait(lambda: arm.runs >= SAMPLES)
rci_close()
print(f"joint 1 has gone {way[-1]:.3f} rad of {AWAY}, at most {max(way):.3f}")
