"""Encoders whose cable comes off, over joints, speeds, ways and plants: how far the joint goes, and after how long."""

from __future__ import annotations

from itertools import product

from qrobot.faultcodes import FaultCode
from tests.support.dead_encoder import Case, run_case

SPEEDS = (0.02, 0.05, 0.1, 0.3, 1.0)
WAYS = (1.0, -1.0)
DRAWS = (None, 0, 3, 13)  # None is the nominal arm; the others are mismatched and carry 2.5 kg of which nobody knows
JOINTS = (1, 2, 3)


def campaign() -> int:
    """Run it and print the worst of each speed; the number of trials in which the power was not cut as ENC_STUCK."""
    missed = 0
    for table, moving, speed in product((True, False), (True, False), SPEEDS):
        cases = [Case(joint, way * speed, moving, table, draw) for joint, way, draw in product(JOINTS, WAYS, DRAWS)]
        results = [(case, run_case(case)) for case in cases]
        missed += sum(result.code is not FaultCode.ENC_STUCK for _, result in results)
        degrees, seconds = (max(results, key=lambda each: getattr(each[1], key)) for key in ("degrees", "seconds"))
        print(
            f"{'table' if table else 'no table':8} {'moving' if moving else 'at rest':7} {speed:5.2f} rad/s:"
            f" {degrees[1].degrees:6.2f} deg (joint {degrees[0].joint}), {seconds[1].seconds * 1e3:5.0f} ms",
            flush=True,
        )
    print(f"{missed} missed", flush=True)
    return missed
