"""The board memory of an arm whose card the servo reaches itself: the servo process is its board side as well."""

from __future__ import annotations

from qrobot.arrays import Words
from qrobot.hwif.board_memory import BoardSegment, create_board_memory, publish_image
from qrobot.hwif.bus import NO_OPERATIONS, safe_operations
from qrobot.hwif.image import IMAGE_STATUS, make_image
from qrobot.hwif.isa.bus import PortBus


def own_board_memory(arm: str, card: Words, joints: int, period_ns: int) -> BoardSegment:
    """Find the card, make it safe, and show it as the board of `arm`.

    The vendor's driver starts without writing the DACs, which may hold any torque; here zero goes out before anything
    else. The counters and the CALIB bit stay as they are: they live on the board.

    Raises:
        ConfigError: the ports are refused to this thread.
        LinkLost: no card answers.
        LinkBusy: a board process, or another servo, serves this arm.
    """
    bus, image = PortBus(card, joints), make_image()
    facts = bus.connect()
    segment = create_board_memory(arm)
    bus.exchange(NO_OPERATIONS, image)
    bus.exchange(safe_operations(int(image[IMAGE_STATUS])), image)
    said = segment.memory.facts
    said.period_ns, said.joints, said.revision = period_ns, facts.joints, ord(facts.revision)
    publish_image(segment.memory, image)
    return segment
