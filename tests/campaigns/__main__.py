"""`python -m tests.campaigns NAME`: long runs in virtual time whose figures the documents give; not in the suite.

    quiet       an hour without a fault: nothing may stop the arm
    held_up     a servo that is kept from running, again and again: only what is true may be told
    encoders    cables that come off: 480 trials
    hard_collisions  a wall in the way of a tool while a program accelerates hard: 560 trials
    stops       300 stops at random instants, in each form of interpolation
    calibration 200 calibrations from random poses
    deaths      a servo that dies after any of its stores, by every cause and over every way to the board
    two_arms    400 deaths of a program, bridge, servo or board of two arms that carry one object
    val_storms  400 storms of commands and disturbances at VAL II's monitor, by RCCL and by ARCL
    val_lines   100,000 spoilt lines of VAL II: each is read, or refused with line and column

Ends with 0 when nothing went wrong.
"""

from __future__ import annotations

import argparse
import sys

from qrobot.servo.kernels.interpolation_polynomials import FORMS
from tests.campaigns import (
    calibration,
    deaths,
    encoders,
    hard_collisions,
    held_up,
    quiet,
    stops,
    two_arms,
    val_lines,
    val_storms,
)

HOUR_S = 3600.0
STOPS = 300
COLLISIONS = 560
DEATHS = 100  # of each kind
HELD_UP_DRAWS = 40  # of the mismatched plant, each with all lengths
SPOILT_LINES = 100_000
STORMS = 200  # with each library


def main() -> int:
    """Run the campaign that the command line names; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.campaigns", description=__doc__.split("\n\n", 1)[0])
    others = ["quiet", "held_up", "encoders", "hard_collisions", "stops", "calibration", "deaths", "two_arms"]
    parser.add_argument("name", choices=[*others, "val_lines", "val_storms"])
    name = parser.parse_args().name
    if name == "quiet":
        wrong = quiet.campaign(HOUR_S)
    elif name == "held_up":
        wrong = held_up.campaign(HELD_UP_DRAWS)
    elif name == "encoders":
        wrong = encoders.campaign()
    elif name == "hard_collisions":
        wrong = hard_collisions.campaign(COLLISIONS)
    elif name == "calibration":
        wrong = calibration.campaign()
    elif name == "deaths":
        wrong = deaths.campaign()
    elif name == "two_arms":
        wrong = two_arms.campaign(DEATHS)
    elif name == "val_lines":
        wrong = val_lines.campaign(SPOILT_LINES)
    elif name == "val_storms":
        wrong = val_storms.campaign(STORMS)
    else:
        wrong = sum(stops.campaign(STOPS, form) for form in FORMS)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
