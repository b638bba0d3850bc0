"""The measured part and the picture of the page on transports: `python docs/transports.py`, some minutes.

The experiment of the paper in lock-step over every transport to the board, at every rate it is good for. A transport
that changes anything at all in setpoints, torque words or positions is an error.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

import matplotlib as mpl
from matplotlib.figure import Figure

from qrobot.config import Robot, load_robot
from qrobot.log.plot import COLOURS, STYLE
from qrobot.rig.experiment import program_path, run_program
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

DOCS: Final = Path(__file__).parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

from tables import table  # noqa: E402 (found through the line above)

from tests.support.transport_comparison import TRANSPORTS, TransportRun, run_over  # noqa: E402

PAGE: Final = DOCS / "explanation/transports.md"
PICTURE: Final = DOCS / "images/transports.png"
RATES_HZ: Final = (4000, 2000, 1000, 500, 250, 125)
FASTEST_HZ: Final = {"Modbus TCP": 500, "CAN": 500}  # what the transports are good for, see docs/performance.md
DPI: Final = 100
_PART: Final = re.compile(r"(<!-- measured: transports -->\n).*?(<!-- end -->)", re.DOTALL)


@cache
def robot() -> Robot:
    """The arm of the experiment."""
    return load_robot("puma560")


@cache
def measure(transport: str, rate_hz: int) -> TransportRun:
    """The paper's experiment over one transport."""
    emulator = Emulator(robot(), physics="rigid")
    return run_over(
        transport, robot(), ServoSettings(rate_hz=rate_hz), emulator, lambda rig: run_program(rig, program_path())
    )


def measured(transport: str) -> list[TransportRun]:
    """A transport at every rate it is good for, fastest first."""
    return [measure(transport, rate) for rate in RATES_HZ if rate <= FASTEST_HZ.get(transport, RATES_HZ[0])]


def transport_errors() -> str:
    """Largest tracking error of each joint by rate, and the transports over which it is the same."""
    joints = (f"joint {j + 1}" for j in range(robot().n))
    return table(("images a second", *joints, "the same to the last bit over"), _rows())


def _rows() -> Iterator[tuple[object, ...]]:
    for plain in measured("direct"):
        others = [seen for transport in TRANSPORTS for seen in measured(transport) if seen.rate_hz == plain.rate_hz]
        if different := [seen.transport for seen in others if seen.digest != plain.digest]:
            raise SystemExit(f"{different} at {plain.rate_hz:g} Hz moved the arm otherwise than no transport at all")
        errors = (f"{error * 1e3:.2f}" for error in plain.error)
        yield (
            f"{plain.rate_hz:g}",
            *errors,
            ", ".join(seen.transport for seen in others if seen.transport != "direct"),
        )


def picture() -> Figure:
    """Largest error of the major and the minor joints against the rate, one mark for each transport."""
    with mpl.rc_context(STYLE | {"axes.titlepad": 6.0}):
        figure = Figure(figsize=(9.6, 4.4), layout="constrained")
        axes = figure.subplots()
        for size, (transport, colour) in enumerate(zip(TRANSPORTS, COLOURS, strict=False)):
            seen = measured(transport)
            rates = [each.rate_hz for each in seen]
            look = {"color": colour, "markersize": 15 - 2.5 * size, "fillstyle": "none", "markeredgewidth": 1.4}
            line = "-" if transport == "direct" else ""
            axes.plot(rates, [each.error[:3].max() * 1e3 for each in seen], "o" + line, label=transport, **look)
            axes.plot(rates, [each.error[3:].max() * 1e3 for each in seen], "s" + line, **look)
        axes.set(xscale="log", xlabel="images of the board a second", ylabel="largest tracking error (mrad)")
        axes.set_xticks(RATES_HZ, [str(rate) for rate in RATES_HZ])
        axes.minorticks_off()
        axes.set_ylim(bottom=0.0)
        axes.set_title("The paper's experiment over each transport: circles joints 1-3, squares joints 4-6")
        axes.legend(frameon=False)
    return figure


def rewrite(page: str) -> str:
    """The page with its table measured anew."""
    return _PART.sub(lambda found: f"{found[1]}\n{transport_errors()}\n\n{found[2]}", page)


def main() -> None:
    """Measure everything and rewrite the page and its picture."""
    PAGE.write_text(rewrite(PAGE.read_text()))
    picture().savefig(PICTURE, dpi=DPI)


if __name__ == "__main__":
    main()
