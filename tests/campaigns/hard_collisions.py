"""A tool that meets a wall while a program accelerates hard: what the arm is stopped for, and when.

The bounds of the COLLISION monitor are widest then (decision 157). Legal turns of one joint, of three and of all, on
nominal and mismatched plants; a wall of steel stands up to 40 degrees aslant in the middle of a hard acceleration.
"""

from __future__ import annotations

from collections import Counter
from statistics import median

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from tests.support.hard_collision import JOINTS, HardTurn, Result, cases

LEAST_TRIED = 0.95  # of the trials come to a wall
LEAST_TOLD = 0.8  # of those are stopped as COLLISION


def campaign(times: int) -> int:
    """Run it and print a line for each set of joints; the number of trials that were not stopped as they should be.

    It is 1 where all were, but too few came to a wall or were told as what they are.
    """
    wrong, results = 0, [(case, HardTurn(case).run()) for case in cases(times)]
    for joints in JOINTS:
        met = [(case, result) for case, result in results if case.joints == joints and result is not None]
        wrong += sum(not result.honest for _, result in met)
        print(row(joints, [result for _, result in met]), flush=True)
        for case, result in met:
            if not result.honest:
                print(f"  {case}: {result}", flush=True)
    tried = [result for _, result in results if result is not None]
    told = sum(result.code is FaultCode.COLLISION for result in tried)
    print(f"{wrong} of {len(tried)} were not stopped as they should be, {told} as COLLISION", flush=True)
    return wrong or int(len(tried) < LEAST_TRIED * times or told < LEAST_TOLD * len(tried))


def name_of(result: Result) -> str:
    """The code that stopped the arm, and what it was cut for after that, if anything."""
    first, cut = result.code.name, result.mode is Mode.FAULT and result.last is not result.code
    return f"{first} then {result.last.name}" if cut else first


def row(joints: tuple[int, ...], results: list[Result]) -> str:
    """One line about these trials."""
    told = ", ".join(f"{n} x {name}" for name, n in sorted(Counter(map(name_of, results)).items()))
    after, share = (median(getattr(result, key) for result in results) for key in ("after_ms", "share"))
    latest, behind, force, pressing = (
        max(getattr(result, key) for result in results) for key in ("after_ms", "behind", "force", "pressing")
    )
    return (
        f"joints {[j + 1 for j in joints]} at {share:.2f} a_max: {told}; after {after:.0f} ms, at most {latest} ms; "
        f"behind by at most {behind:.2f} of what is allowed; up to {force:.0f} N, then {pressing:.0f} N"
    )
