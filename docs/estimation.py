"""The measured parts of the page on estimation and interpolation: `python docs/estimation.py`, half a minute.

Everything is measured in lock-step on the contact-free plant, so that the numbers are the same on every machine but for
rounding; `tests/golden/test_estimation_page.py` measures some of them again. A part stands in its page between
`<!-- measured: name -->` and `<!-- end -->`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from qrobot.config import Robot, load_robot
from qrobot.log.plot import COLOURS, STYLE
from qrobot.rig.experiment import PlantName, program_path, run_program
from qrobot.servo.kernels.interpolation_polynomials import FORMS, Form
from qrobot.servo.kernels.interpolator import reference, shift_in
from qrobot.servo.kernels.velocity import ESTIMATORS
from qrobot.servo.settings import ServoSettings
from qrobot.servo.stages.setpoint_stream import PLAYOUT_FRAMES
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch

DOCS: Final = Path(__file__).parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

from tables import table  # noqa: E402 (found through the line above)

from tests.support.ground_truth import GroundTruthRig, TrackedTruth  # noqa: E402

PAGE: Final = DOCS / "explanation/estimation-and-interpolation.md"
IMAGES: Final = DOCS / "images"
RATES_HZ: Final = (1000, 2000, 4000)
PLANTS: Final[tuple[PlantName, ...]] = ("nominal", "mismatched")
FRAME_MS: Final = 28.0
DPI: Final = 100
SMOOTHNESS: Final = ("position", "position and velocity", "position, velocity and acceleration")


@cache
def robot() -> Robot:
    """The arm of the experiment."""
    return load_robot("puma560")


@cache
def measure(rate_hz: int, plant: PlantName, velocity: str, interpolation: str, law: str = "qrobot") -> TrackedTruth:
    """The paper's experiment with these choices."""
    n = robot().n
    wrong = PlantMismatch.mismatched(n) if plant == "mismatched" else PlantMismatch.nominal(n)
    settings = ServoSettings(rate_hz=rate_hz, law=law, velocity=velocity, interpolation=interpolation)
    rig = GroundTruthRig(robot(), settings, Emulator(robot(), mismatch=wrong, physics="rigid"))
    run_program(rig, program_path())
    return rig.tracked_truth()


def velocity_errors() -> str:
    """Rms error and lag of both estimators, per rate and plant."""
    rows = []
    for rate, plant in ((rate, plant) for rate in RATES_HZ for plant in PLANTS):
        for velocity in ESTIMATORS:
            seen = measure(rate, plant, velocity, "quintic")
            lag_ms = f"{np.median(seen.lag_s) * 1e3:.1f}"
            rows.append((rate, plant, velocity, *(f"{error * 1e3:.1f}" for error in seen.velocity_error), lag_ms))
    return table(("Hz", "plant", "velocity", *_joints(), "lag, ms"), rows)


def torque_ripple() -> str:
    """Peak ripple of the torque in cruise."""
    rows = [
        (rate, velocity, *(f"{ripple:.2f}" for ripple in measure(rate, "nominal", velocity, "quintic").ripple))
        for rate in RATES_HZ
        for velocity in ESTIMATORS
    ]
    return table(("Hz", "velocity", *_joints()), rows)


def law_errors() -> str:
    """Tracking with either estimator, with and without acceleration feed-forward."""
    rows = []
    for law in ("qrobot", "qrobot+a"):
        for velocity in ESTIMATORS:
            seen = measure(1000, "nominal", velocity, "quintic", law)
            rows.append((f"`{law}`", velocity, *(f"{error * 1e3:.2f}" for error in seen.tracking_error)))
    return table(("law", "velocity", *_joints()), rows)


def forms() -> str:
    """Delay, continuity and exactness of every form."""
    headings = (
        "form",
        "setpoint reached after",
        "at 28 ms",
        "continuous",
        "exact for",
        "through setpoints",
        "what it is",
    )
    return table(headings, (_form_row(form) for form in FORMS.values()))


def _form_row(form: Form) -> tuple[object, ...]:
    frames = PLAYOUT_FRAMES + form.delay_frames
    return (
        f"`{form.name}`",
        f"{frames:g} frames",
        f"{frames * FRAME_MS:g} ms",
        SMOOTHNESS[form.continuity],
        ("", "constant velocity", "constant acceleration")[form.degree],
        "yes" if form.through_setpoints else "no",
        form.about,
    )


def form_errors() -> str:
    """Tracking error and roughness of every form."""
    rows = []
    for name in FORMS:
        seen = measure(1000, "nominal", "difference", name)
        errors = (f"{error * 1e3:.2f}" for error in seen.tracking_error)
        rows.append((f"`{name}`", *errors, f"{seen.largest_error.max() * 1e3:.2f}", f"{seen.torque_step[0]:.1f}"))
    return table(("form", *(f"{joint}, rms" for joint in _joints()), "largest of all", "torque step, joint 1"), rows)


def _joints() -> list[str]:
    return [f"joint {j + 1}" for j in range(robot().n)]


PARTS: Final[dict[str, Callable[[], str]]] = {
    "velocity-errors": velocity_errors,
    "torque-ripple": torque_ripple,
    "law-errors": law_errors,
    "forms": forms,
    "form-errors": form_errors,
}
_PART: Final = re.compile(r"(<!-- measured: ([a-z-]+) -->\n).*?(<!-- end -->)", re.DOTALL)


def rewrite(page: str) -> str:
    """The page with every measured part made anew. Raises KeyError for a part nobody measures."""
    return _PART.sub(lambda found: f"{found[1]}\n{PARTS[found[2]]().strip()}\n\n{found[3]}", page)


# ---------------------------------------------------------------------------------------------------------- pictures


def velocity_picture() -> Figure:
    """True and estimated velocity of one joint through a start from rest, at the highest rate."""
    with mpl.rc_context(STYLE | {"axes.titlepad": 6.0}):
        figure = Figure(figsize=(9.6, 3.6), layout="constrained")
        axes = figure.subplots()
        for number, velocity in enumerate(ESTIMATORS):
            seen = measure(RATES_HZ[-1], "nominal", velocity, "quintic")
            times, part = _around_the_start(seen)
            axes.plot(times, seen.rows["v"][part, 0] * 1e3, color=COLOURS[1 - number], label=velocity, linewidth=1.0)
        axes.plot(times, seen.v_true[part, 0] * 1e3, color="black", label="true", linewidth=1.0)
        axes.set(xlabel="time (s)", ylabel="velocity of joint 1 (mrad/s)")
        axes.set_title("Starting from rest at 4 kHz: one encoder count per cycle is 401 mrad/s")
        axes.legend(frameon=False)
    return figure


def _around_the_start(seen: TrackedTruth) -> tuple[np.ndarray[Any, Any], slice]:
    start = int(np.argmax(np.abs(seen.v_true[:, 0]) > 0.005))
    part = slice(max(0, start - round(0.04 / seen.dt)), start + round(0.12 / seen.dt))
    return np.arange(part.stop - part.start) * seen.dt, part


def interpolation_picture() -> Figure:
    """What each form makes of setpoints that start to move from one frame to the next."""
    with mpl.rc_context(STYLE | {"axes.titlepad": 6.0}):
        figure = Figure(figsize=(9.6, 5.4), layout="constrained")
        panels = figure.subplots(3, 1, sharex=True)
        for colour, form in zip(COLOURS, FORMS.values(), strict=False):
            path = np.array(list(_play(form)))
            for axes, column in zip(panels, (1, 2, 3), strict=True):
                axes.plot(path[:, 0], path[:, column], color=colour, label=form.name, linewidth=1.2)
        _dress(panels)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center", frameon=False)
    return figure


def _play(form: Form) -> Iterator[tuple[float, float, float, float]]:
    """(frame, position, velocity, acceleration) while setpoints rest at 0, then climb by 1 a frame."""
    setpoints = [0.0] * 4 + [float(k) for k in range(1, 6)]
    knots, q, v, a = np.zeros((4, 1)), np.zeros(1), np.zeros(1), np.zeros(1)
    for frame, setpoint in enumerate(setpoints):
        shift_in(knots, np.array([setpoint]))
        for phase in np.linspace(0.0, 1.0, 40, endpoint=False):
            reference(form.table, knots, np.zeros((2, 1)), phase, 1.0, 0.0, q, v, a)
            yield frame - 3 + phase, q[0], v[0], a[0]


def _dress(panels: Any) -> None:
    positions: Axes = panels[0]
    positions.plot(range(-3, 6), [max(0, k) for k in range(-3, 6)], "k.", label="setpoint taken")
    for axes, label in zip(panels, ("position", "velocity", "acceleration"), strict=True):
        axes.set_ylabel(label)
    panels[0].set_title("A path that starts to move: setpoints climb by 1 per frame from frame 0 on")
    panels[-1].set_xlabel("frames")
    panels[-1].set_xlim(-1.5, 5.0)


def main() -> None:
    """Measure everything and rewrite the page and its pictures."""
    PAGE.write_text(rewrite(PAGE.read_text()))
    IMAGES.mkdir(exist_ok=True)
    velocity_picture().savefig(IMAGES / "velocity.png", dpi=DPI)
    interpolation_picture().savefig(IMAGES / "interpolation.png", dpi=DPI)


if __name__ == "__main__":
    main()
