"""`qrobot guardian`: the process that takes the board from a servo that has died."""

from __future__ import annotations

import signal
from contextlib import closing
from types import FrameType
from typing import Final

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, card_of_arm, choose_arm
from qrobot.cli.console import note
from qrobot.cli.option_types import Seconds
from qrobot.report import QueuedReport

LINGER_S = 5.0
LINES_PRIORITY: Final = 30  # below board and servo, above ordinary programs: the watch waits for a lock that lines hold


def guardian(deployment: str = DEFAULT_DEPLOYMENT, *, arm: str | None = None, linger: Seconds = LINGER_S) -> None:
    """Watch the servo of one arm; zero its torque and drop arm power when its heartbeat stops.

    Ends by itself when there has been no servo process for a while; the board is safe by then.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    linger
        Seconds to wait for a dead servo to be restarted.
    """
    from qrobot.realtime.setup import insist_on, leave_fifo, set_fifo
    from qrobot.realtime.signals import ending_signals
    from qrobot.realtime.startup_order import await_turn
    from qrobot.servo.process.guardian import Guardian, prepare, warm_up

    chosen = choose_arm(deployment, arm)
    warm_up()
    await_turn()
    arm_name, timeout_ms, card = chosen.name, chosen.servo.guardian_patience_ms, card_of_arm(chosen)
    with (
        QueuedReport(note, lambda: set_fifo(LINES_PRIORITY)) as told,
        closing(Guardian(arm_name, timeout_ms, told, card, slips=chosen.board.slips)) as watcher,
    ):

        def end(_signal: int, _frame: FrameType | None) -> None:
            watcher.stop[0] = 1

        def hang_up(_signal: int, _frame: FrameType | None) -> None:
            watcher.hang_up()

        for number in ending_signals():
            signal.signal(number, hang_up if number == signal.SIGHUP else end)
        insist_on(prepare(), chosen.servo.require_realtime, lambda line: told(f"guardian of {arm_name}: {line}"))
        told(f"guardian of {arm_name} acts {timeout_ms:g} ms after the servo's last heartbeat")
        watcher.run(linger)
        leave_fifo()
