"""`qrobot guardian`: the process that takes the board from a servo that has died."""

from __future__ import annotations

import signal
from types import FrameType

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, card_of_arm, choose_arm
from qrobot.cli.console import note
from qrobot.cli.option_types import Seconds
from qrobot.errors import QRobotError

LINGER_S = 5.0


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
    from qrobot.realtime.setup import insist_on, leave_fifo
    from qrobot.realtime.startup_order import await_turn
    from qrobot.servo.process.guardian import Guardian, prepare, warm_up

    chosen = choose_arm(deployment, arm)
    warm_up()
    await_turn()
    watcher = Guardian(
        chosen.name, chosen.servo.guardian_timeout_ms, note, card_of_arm(chosen), slips=chosen.board.slips
    )

    def end(_signal: int, _frame: FrameType | None) -> None:
        watcher.stop[0] = 1

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, end)
    try:
        insist_on(prepare(), chosen.servo.require_realtime, lambda line: note(f"guardian of {chosen.name}: {line}"))
    except QRobotError:
        watcher.close()
        raise
    note(f"guardian of {chosen.name} acts {chosen.servo.guardian_timeout_ms:g} ms after the servo's last heartbeat")
    watcher.run(linger)
    leave_fifo()
    watcher.close()
