"""A servo whose every store is a point at which it may die; guardian and board then go on without it.

For plain Python (NUMBA_DISABLE_JIT=1), where each store into shared memory and each access to a card tells of itself.
Between two of them nothing changes that another process could see, so a servo that dies at any instruction has died
after one of them.
"""

from __future__ import annotations

import copy
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from qrobot.hwif.board_memory import Lane, local_board_memory
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.gateway import Gateway
from qrobot.hwif.image import make_image
from qrobot.hwif.isa.card import (
    CARD_REVISION,
    FAKE_CARD,
    FAKE_HEAD,
    FAKE_RECORD,
    FAKE_WINDOW,
    NO_CARD,
    RECORD_CAPACITY,
    RECORD_FIELDS,
    make_card,
    show_card,
)
from qrobot.hwif.lanes import take_operation
from qrobot.hwif.operations import OP_FIELDS, OP_WRITE
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_POWER, N_DACS, N_INPUT_WORDS
from qrobot.servo.modes import gives_torque
from qrobot.servo.process.guardian import LOOKS_PER_TIMEOUT, N_OWN, N_SAFE_OPS, TRIPPED, look
from qrobot.servo.process.loop import one_cycle, write_card
from tests.support.servo_bench import ServoBench
from tests.support.telling_memory import Copier, Follower, Shared, SharedRecord, shared

TIMEOUT_NS = 5_000_000
LOOK_NS = TIMEOUT_NS // LOOKS_PER_TIMEOUT
PHASE_NS = 400_000  # of the guardian's looks, against the cycles
STEP_NS = 200_000
BOARD_NS = 1_000_000  # one period of a gateway, the slowest board here
BOUND_NS = TIMEOUT_NS + LOOK_NS + BOARD_NS
WATCHED_NS = 12_000_000
NO_CARD_WORDS = make_card(NO_CARD)
POSTING = {"post_operations", "pour_lane"}


class GuardianDiedError(Exception):
    """Ends the look in which it dies."""


class Registers:
    """What of a board holds the arm: DACs and DISCRETE, as last written.

    Attributes:
        driven: some write has left them unsafe.
    """

    def __init__(self) -> None:
        self.dac, self.discrete = [DAC_ZERO] * N_DACS, 0
        self.driven = False

    def apply(self, offset: int, value: int) -> None:
        if offset == DISCRETE:
            self.discrete = value
        elif offset >= DAC:
            self.dac[(offset - DAC) // 2] = value
        self.driven = self.driven or not self.safe

    @property
    def safe(self) -> bool:
        return not self.discrete & DISCRETE_POWER and self.dac == [DAC_ZERO] * N_DACS


def posts(board: Any) -> list[tuple[int, int]]:
    """What the lanes of a board say of operations that were posted, or forgotten, so far."""
    return [(lane.head, lane.forget) for lane in board.lanes]


class MemoryWay:
    """The board takes the operations out of its memory, as the emulated one does."""

    def __init__(self) -> None:
        self.registers, self._operation = Registers(), np.zeros(OP_FIELDS, np.int64)
        self.told: list[Shared] = []
        self._posted: list[tuple[int, int]] = []

    def before_cycle(self, bench: DyingBench) -> None:
        bench.publish()

    def after_cycle(self, bench: DyingBench) -> None:
        """Nothing more is the servo's to do."""

    def step(self, board: Any, _now_ns: int) -> None:
        """The board's own turn, every STEP_NS: there is something for it when a lane is not as it was left."""
        posted = posts(board)
        if posted == self._posted:
            return
        for lane in Lane:
            while take_operation(board, int(lane), self._operation):
                kind, offset, value = self._operation.tolist()
                if kind == OP_WRITE:
                    self.registers.apply(offset, value)
        self._posted = posted

    @property
    def guardian_card(self) -> Any:
        return NO_CARD_WORDS

    def key(self) -> bytes:
        return repr((self.registers.dac, self.registers.discrete)).encode()

    def fork(self, _board: Any) -> MemoryWay:
        """The same in a world of its own."""
        return copy.deepcopy(self)


class PortWay(MemoryWay):
    """A card: servo and guardian write its registers themselves."""

    def __init__(self) -> None:
        super().__init__()
        self.servo_card = make_card(FAKE_CARD, revision="F").view(Shared)
        self._guardian_card = make_card(FAKE_CARD, revision="F").view(Shared)
        self.told = [self.servo_card]
        self._seen = {id(self.servo_card): 0, id(self._guardian_card): 0}

    def before_cycle(self, bench: DyingBench) -> None:
        bench.compose_image()
        self.servo_card[FAKE_WINDOW : FAKE_WINDOW + N_INPUT_WORDS] = bench.image_words
        show_card(self.servo_card, bench.board, bench.now_ns)
        self._follow(self.servo_card)

    def after_cycle(self, bench: DyingBench) -> None:
        params, state = bench._blocks
        write_card(params[0], state[0], bench.mail, bench.board, self.servo_card, bench.now_ns)
        self._follow(self.servo_card)

    def step(self, _board: Any, _now_ns: int) -> None:
        self._follow(self._guardian_card)

    @property
    def guardian_card(self) -> Any:
        return self._guardian_card

    def _follow(self, card: Any) -> None:
        """Let the registers have what the record of a card has that is new."""
        head, seen = int(card[FAKE_HEAD]), self._seen[id(card)]
        for i in range(seen, head):
            slot = FAKE_RECORD + i % RECORD_CAPACITY * RECORD_FIELDS
            kind, offset, _, value = (int(word) for word in card[slot : slot + RECORD_FIELDS])
            if kind == OP_WRITE:
                self.registers.apply(offset, value)
        self._seen[id(card)] = head

    def key(self) -> bytes:
        self._follow(self.servo_card)
        return super().key()

    def fork(self, _board: Any) -> MemoryWay:
        way = PortWay()
        way.registers = copy.deepcopy(self.registers)
        way._guardian_card[CARD_REVISION] = ord("F")
        return way


class RegisterBus:
    """A bus to the registers; whatever it carries acts at once."""

    name = "the registers"

    def __init__(self, registers: Registers) -> None:
        self.registers, self.image = registers, make_image()

    def connect(self) -> BoardFacts:
        return BoardFacts("F", 6)

    def exchange(self, operations: Operations, image: Any) -> None:
        for kind, offset, value in operations.tolist():
            if kind == OP_WRITE:
                self.registers.apply(offset, value)
        image[:] = self.image

    def close(self) -> None:
        """Do nothing: this bus holds no resource."""


class GatewayWay(MemoryWay):
    """A gateway takes them, once a period, over a bus."""

    def __init__(self) -> None:
        super().__init__()
        self.bus = RegisterBus(self.registers)
        self._gateway: Gateway | None = None

    def before_cycle(self, bench: DyingBench) -> None:
        bench.compose_image()
        self.bus.image[:] = bench.whole_image
        if self._gateway is None:
            self._gateway = Gateway(self.bus, bench.plain_board, BOARD_NS)
            self._gateway.step(bench.now_ns)
        self._gateway.step(bench.now_ns)

    def step(self, _board: Any, now_ns: int) -> None:
        if now_ns % BOARD_NS == STEP_NS and self._gateway is not None:
            self._gateway.step(now_ns)

    def fork(self, board: Any) -> MemoryWay:
        way = GatewayWay()
        way.registers = way.bus.registers = copy.deepcopy(self.registers)
        way.bus.image[:] = self.bus.image
        if self._gateway is not None:
            way._gateway = copy.copy(self._gateway)
            way._gateway._bus, way._gateway._memory = way.bus, board
        return way


WAYS = {"memory": MemoryWay, "port": PortWay, "gateway": GatewayWay}


class DyingBench(ServoBench):
    """A servo whose every store is a point at which it may die; a guardian and a board that go on.

    Attributes:
        points: stores looked at so far. worlds: those after which something differed for guardian or board.
        silenced: the servo was stopped, though not while it posted its list or wrote it to a card, and woke up when the
            guardian had the board.
    """

    def __init__(self, way: str = "memory", **options: Any) -> None:
        super().__init__(guarded=True, **options)
        self.beating = False
        self.way = WAYS[way]()
        self.mail, self.board = shared(self.mail), shared(self.board)
        self._mails, self._boards = Copier(self.mail), Copier(self.board)
        self._plain_mail, self._plain_board = Follower(), Follower()
        self.own, self.safe_ops = np.zeros(N_OWN, np.int64), np.zeros((N_SAFE_OPS, OP_FIELDS), np.int64)
        self.points = self.worlds = 0
        self.stall_at, self.stalled_ns, self.silenced = -1, 0, False
        self._last_key = b""

    @property
    def plain_mail(self) -> Any:
        """The servo's memory, which tells nobody."""
        return self._plain_mail.of(self.mail)

    @property
    def plain_board(self) -> Any:
        """The board's, which tells nobody."""
        return self._plain_board.of(self.board)

    # what the board shows

    def compose_image(self) -> None:
        self.discrete = self.way.registers.discrete
        board, self.board = self.board, local_board_memory()
        super()._publish()
        self.board = board

    def publish(self) -> None:
        self.discrete = self.way.registers.discrete
        super()._publish()

    @property
    def whole_image(self) -> Any:
        return self._image

    @property
    def image_words(self) -> Any:
        return self._image[-N_INPUT_WORDS:]

    # time

    def tick(self, times: int = 1) -> DyingBench:
        for _ in range(times):
            for act in self.before:
                act(self.now_ns)
            self.cycle()
            self.go_on(self.now_ns, self.now_ns + self.settings.period_ns)
            self.now_ns += self.settings.period_ns
        return self

    def cycle(self) -> None:
        if not self.frozen:
            self.way.before_cycle(self)
        params, state = self._blocks
        one_cycle(params[0], state[0], self.mail, self.mailbox.ring, self.board, self.now_ns, 0)
        self._rows.append(self._row.copy())
        self.way.after_cycle(self)
        if self.follows and gives_torque(int(self.state.mode)):
            self.q = self._q_ref.copy()

    def go_on(self, from_ns: int, until_ns: int) -> None:
        """Guardian and board, without the servo."""
        run(self.own, self.plain_mail, self.plain_board, self.way, self.safe_ops, from_ns, until_ns)

    def sleep(self, ms: int) -> None:
        self.go_on(self.now_ns, self.now_ns + ms * 1_000_000)
        self.now_ns += ms * 1_000_000

    # dying

    def sleep_beside_a_dying_guardian(self, ms: int, at: int) -> bool:
        """The servo does not run for so long, and the guardian dies after its store number `at` since it tripped.

        False when it makes fewer.
        """
        left = at

        def stored() -> None:
            nonlocal left
            left -= self.own[TRIPPED]
            if left == 0:
                raise GuardianDiedError

        for _ in range(ms * 1_000_000 // STEP_NS):
            self.now_ns += STEP_NS
            if self.own is not None and self.now_ns % LOOK_NS == PHASE_NS:
                self._look_and_tell(stored)
            self.way.step(self.plain_board, self.now_ns)
        return self.own is None

    def _look_and_tell(self, stored: Callable[[], None]) -> None:
        """One look of the guardian, which tells of its stores, and may die of one."""
        card = self.way.guardian_card
        SharedRecord.told = staticmethod(stored)
        if card is not NO_CARD_WORDS:
            card.stored = stored
        try:
            look(self.own, self.mail, self.board, card, self.safe_ops, self.now_ns, TIMEOUT_NS)
        except GuardianDiedError:
            self.own = None
        finally:
            SharedRecord.told = None
            if card is not NO_CARD_WORDS:
                card.stored = None

    @contextmanager
    def dying(self) -> Iterator[None]:
        """Inside, the servo dies after every store, each time in a world of its own."""
        with self._told(self._die):
            self._die()
            yield

    @contextmanager
    def stalling(self, at: int, ms: int) -> Iterator[None]:
        """Inside, the servo is stopped for so long after its store number `at`."""
        self.points, self.stall_at, self.stalled_ns = 0, at, ms * 1_000_000
        with self._told(self._stall):
            yield

    @contextmanager
    def _told(self, stored: Callable[[], None]) -> Iterator[None]:
        arrays = self.way.told
        wrapped, self.cycle = self.cycle, lambda: self._tell(arrays, stored, wrapped)  # type: ignore[method-assign]
        try:
            yield
        finally:
            self.cycle = wrapped  # type: ignore[method-assign]

    def _tell(self, arrays: list[Shared], stored: Callable[[], None], cycle: Callable[[], None]) -> None:
        for array in arrays:
            array.stored = stored
        SharedRecord.told = staticmethod(stored)
        try:
            cycle()
        finally:
            SharedRecord.told = None
            for array in arrays:
                array.stored = None

    def _die(self) -> None:
        self.points += 1
        key = self.mail.heartbeat.tobytes() + self.board.lanes.tobytes() + self.way.key()
        if key == self._last_key:
            return
        self._last_key = key
        self.worlds += 1
        mail, board = self._mails.copied(self.plain_mail), self._boards.copied(self.plain_board)
        own, way = self.own.copy(), self.way.fork(board)
        beat_ns = int(mail.heartbeat.t_ns) or self.now_ns
        run(own, mail, board, way, self.safe_ops, self.now_ns, max(self.now_ns, beat_ns + BOUND_NS))
        for t_ns in range(beat_ns + BOUND_NS, self.now_ns + WATCHED_NS, STEP_NS):
            assert way.registers.safe, (self.points, self.snapshot.mode, way.registers.discrete, way.registers.dac)
            run(own, mail, board, way, self.safe_ops, t_ns, t_ns + STEP_NS)

    def _stall(self) -> None:
        self.points += 1
        if self.points == self.stall_at:
            posts = not POSTING.isdisjoint(at.f_code.co_name for at, _ in traceback.walk_stack(None))
            self.sleep(self.stalled_ns // 1_000_000)
            self.silenced, self.way.registers.driven = bool(self.own[TRIPPED]) and not posts, False


def run(own: Any, mail: Any, board: Any, way: MemoryWay, ops: Any, from_ns: int, until_ns: int) -> None:
    """Guardian, unless `own` is None for a dead one, and board from one time to another."""
    for t_ns in range(from_ns - from_ns % STEP_NS + STEP_NS, until_ns + 1, STEP_NS):
        if own is not None and t_ns % LOOK_NS == PHASE_NS:
            look(own, mail, board, way.guardian_card, ops, t_ns, TIMEOUT_NS)
        way.step(board, t_ns)
