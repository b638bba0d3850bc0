"""An emulated robot at the far end of a transport, in lock-step: it moves when operations come, and only then."""

from __future__ import annotations

from qrobot.arrays import Words
from qrobot.hwif.board_memory import Lane, local_board_memory
from qrobot.hwif.bus import BoardFacts, MemoryEndpoint, Operations
from qrobot.sim_board.emulator import Emulator, emulator_run


class SteppingEndpoint:
    """Applies each list of operations and lets one servo period pass, so that its image is that of the next cycle.

    Virtual time travels in the image, on transports that carry the board's time stamps.

    Args:
        emulator: the board and the arm behind it; connected here.
        steps: of the plant, for each list.
        now_ns: virtual time at the start.

    Attributes:
        memory: the emulator's own, with panel and trace.
        now_ns: virtual time.
    """

    def __init__(self, emulator: Emulator, steps: int, now_ns: int) -> None:
        self.emulator, self.steps, self.now_ns = emulator, steps, now_ns
        self.memory = local_board_memory()
        self._board = MemoryEndpoint(self.memory, Lane.SERVO)
        emulator.connect(self.memory, now_ns)

    def facts(self) -> BoardFacts:
        """The emulated board's, with the time between two images as its period."""
        facts = self._board.facts()
        return BoardFacts(facts.revision, facts.joints, self.steps * facts.period_ns)

    def apply(self, operations: Operations) -> None:
        """Apply them at the present instant, then move on by one servo period."""
        self._board.apply(operations)
        self.now_ns = emulator_run(self.emulator.bundle, self.memory, self.now_ns, self.steps)

    def read_image(self, image: Words) -> None:
        """The image of the present instant."""
        self._board.read_image(image)
