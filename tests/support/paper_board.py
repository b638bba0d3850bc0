"""A board of paper at the far end of a transport: words in, words out, no kernels; for tests of the transport alone."""

from __future__ import annotations

from qrobot.arrays import Words
from qrobot.errors import LinkBusy, LinkError
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_INPUTS, IMAGE_T_NS
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import ENC_COUNT, ENC_LOAD, N_INPUT_WORDS, STATUS

Row = tuple[int, int, int]


class PaperBoard:
    """An endpoint.

    Attributes:
        inputs: the sixteen input words; counters take their loads.
        applied: every operation so far.
        gone, full: there is no board; it takes no operations.
        lag: by how many images the inputs show an operation late.
    """

    def __init__(self, revision: str = "F") -> None:
        self.inputs = [0] * N_INPUT_WORDS
        self.applied: list[Row] = []
        self.gone = self.full = False
        self.revision = revision
        self.lag = 0
        self._count = 0
        self._loads: list[tuple[int, int, int]] = []  # count of the image that shows it, place, value

    @property
    def status(self) -> int:
        """The STATUS word."""
        return self.inputs[STATUS // 2]

    @status.setter
    def status(self, word: int) -> None:
        self.inputs[STATUS // 2] = word

    def facts(self) -> BoardFacts:
        self._insist()
        return BoardFacts(self.revision, 6, 250_000)

    def apply(self, operations: Operations) -> None:
        self._insist()
        if self.full:
            raise LinkBusy("the board takes no operations")
        for kind, offset, value in operations.tolist():
            self.applied.append((kind, offset, value))
            if kind == OP_WRITE and ENC_LOAD <= offset < ENC_LOAD + 12:
                self._loads.append((self._count + self.lag, (ENC_COUNT + offset - ENC_LOAD) // 2, value))
        self.show()

    def show(self) -> None:
        """Make one more image."""
        self._count += 1
        for count, place, value in self._loads:
            if count <= self._count:
                self.inputs[place] = value
        self._loads = [load for load in self._loads if load[0] > self._count]

    def read_image(self, image: Words) -> None:
        self._insist()
        image[IMAGE_T_NS], image[IMAGE_COUNT] = 1_000_000 * self._count, self._count
        image[IMAGE_INPUTS:] = self.inputs

    def _insist(self) -> None:
        if self.gone:
            raise LinkError("there is no board")
