"""The gateway: board memory at one end, any bus at the other, and a board that is safe when it is found."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import uuid

import pytest

from qrobot.arrays import Words
from qrobot.cli.arm_links import link_of
from qrobot.cli.arms import choose_arm
from qrobot.cli.calibrate import calibrate_arm
from qrobot.config.deployment import BoardChoice
from qrobot.errors import ConfigError, LinkLost
from qrobot.hwif.board_look import BoardLooker
from qrobot.hwif.board_memory import (
    LANE_CAPACITY,
    Lane,
    create_board_memory,
    fetch_image,
    local_board_memory,
    newest_count,
)
from qrobot.hwif.bus import BoardFacts
from qrobot.hwif.gateway import RETRY_NS, Gateway, serve
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_ENC_COUNT, IMAGE_T_NS, make_image
from qrobot.hwif.lanes import pending_operations
from qrobot.hwif.operations import OP_OUTPUTS, OP_REFERENCE, OP_WRITE
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_RELAXED,
    DISCRETE_LINES,
    DISCRETE_POWER,
    ENC_LOAD,
    N_DACS,
)
from qrobot.hwif.trace import OWN_LANE, load_head, read_trace
from qrobot.servo.emulated_board import insist_on_emulated
from tests.support.bench import PERIOD_NS, Bench, post
from tests.support.bus import BenchEndpoint, DirectBus
from tests.support.signals import default_signals

HELD_LINE = 0x10
SAFE = [(OP_WRITE, DAC + 2 * channel, DAC_ZERO) for channel in range(N_DACS)]


class Desk:
    """Board memory, gateway, bus and a board on the bench."""

    def __init__(self) -> None:
        self.memory = local_board_memory()
        self.end = BenchEndpoint(Bench())
        self.bus = DirectBus(self.end)
        self.lines: list[str] = []
        self.gateway = Gateway(self.bus, self.memory, PERIOD_NS, self.lines.append, held_lines=HELD_LINE)
        self.now_ns = 0

    def step(self, times: int = 1) -> bool:
        for _ in range(times):
            self.now_ns += PERIOD_NS
            stepped = self.gateway.step(self.now_ns)
        return stepped

    def post(self, *operations: tuple[int, int, int], lane: Lane = Lane.SERVO) -> None:
        post(self.memory, *operations, lane=lane)

    def image(self) -> Words:
        image = make_image()
        assert fetch_image(self.memory, image)
        return image

    def count(self, joint: int) -> int:
        return int(self.image()[IMAGE_ENC_COUNT + joint])


@pytest.fixture
def desk() -> Desk:
    desk = Desk()
    assert desk.step()
    desk.end.lists.clear()
    return desk


def test_a_board_that_is_found_is_made_safe_before_anything_else_and_says_what_it_is() -> None:
    desk = Desk()
    desk.end.bench.write((DISCRETE, DISCRETE_POWER | DISCRETE_CALIBRATED), (DAC, 0))
    desk.post((OP_WRITE, DAC, 7))  # by somebody who could not know
    desk.step()
    assert desk.end.lists == [[], [*SAFE, (OP_WRITE, DISCRETE, DISCRETE_CALIBRATED | DISCRETE_HAND_RELAXED)]]
    assert (desk.memory.facts.joints, chr(desk.memory.facts.revision)) == (6, "F")
    assert desk.memory.facts.period_ns == PERIOD_NS
    assert desk.gateway.dropped == 1
    assert desk.lines == ["board found at the bench: revision F, 6 joints"]


def test_the_age_of_an_image_is_told_by_our_clock_and_the_boards_own_is_left_alone(desk: Desk) -> None:
    desk.step()
    assert desk.memory.facts.taken_ns == desk.now_ns
    board_ns = desk.image()[IMAGE_T_NS]
    desk.step()
    assert desk.memory.facts.taken_ns == desk.now_ns
    assert desk.image()[IMAGE_T_NS] > board_ns


def test_images_are_numbered_by_exchanges_whatever_the_board_counts(desk: Desk) -> None:
    """The board may have made several images in an exchange; of none the number stands still, as the board does."""
    number = desk.image()[IMAGE_COUNT]
    for ticks in (0, 1, 7):
        desk.end.bench.tick(ticks)
        desk.step()
        number += 1
        assert desk.image()[IMAGE_COUNT] == number
    desk.end.standing = True
    desk.step(3)
    assert desk.image()[IMAGE_COUNT] == number
    desk.end.standing = False
    desk.step()
    assert desk.image()[IMAGE_COUNT] == number + 4


def test_the_newest_image_is_that_of_the_exchange_under_way_as_soon_as_it_begins(desk: Desk) -> None:
    """What is posted meanwhile goes with the next one."""
    number, seen = desk.image()[IMAGE_COUNT], list[int]()
    assert newest_count(desk.memory) == number
    desk.bus.spoil = lambda _image: seen.append(newest_count(desk.memory))
    desk.step()
    assert seen == [number + 1]
    desk.bus.cut = True
    desk.step()
    desk.bus.cut = False
    assert desk.step()
    assert set(seen[1:]) == {number + 3}  # the lost one had begun
    assert desk.image()[IMAGE_COUNT] == number + 3


def test_losses_of_modules_beside_the_board_stand_in_its_memory_with_the_next_image() -> None:
    memory, losses = local_board_memory(), [0]
    gateway = Gateway(DirectBus(BenchEndpoint(Bench())), memory, PERIOD_NS, module_losses=lambda: losses[0])
    assert gateway.step(1)
    losses[0] = 2
    assert gateway.step(2)
    assert memory.facts.module_losses == 2


def test_operations_reach_the_board_lane_by_lane_in_the_order_they_were_posted(desk: Desk) -> None:
    desk.post((OP_WRITE, DAC, 5), lane=Lane.GUARDIAN)
    desk.post((OP_WRITE, ENC_LOAD + 2, 77), (OP_WRITE, DAC, 3))
    desk.post((OP_WRITE, DAC, 4), lane=Lane.TOOL)
    desk.step()
    assert desk.end.lists == [
        [(OP_WRITE, ENC_LOAD + 2, 77), (OP_WRITE, DAC, 3), (OP_WRITE, DAC, 4), (OP_WRITE, DAC, 5)]
    ]
    assert desk.count(1) == 77
    assert desk.gateway.dropped == 0


def test_while_the_bus_is_away_the_image_stands_still_and_what_is_posted_is_dropped_and_counted(desk: Desk) -> None:
    before = desk.image()
    desk.bus.cut = True
    desk.post((OP_WRITE, DAC, 1), (OP_WRITE, DAC, 2))
    assert not desk.step()
    desk.post((OP_WRITE, DAC, 3))
    assert not desk.step(3)
    assert list(desk.image()) == list(before)
    assert not desk.end.lists
    assert pending_operations(desk.memory, int(Lane.SERVO)) == 0
    assert (desk.gateway.dropped, desk.gateway.losses, desk.bus.closed) == (3, 1, 2)


def test_a_lane_out_of_step_is_counted_also_while_the_board_is_away(desk: Desk) -> None:
    desk.bus.cut = True
    desk.step()
    desk.memory.lanes[Lane.SERVO].head += 2 * LANE_CAPACITY
    desk.step()
    assert desk.gateway.dropped == 1


def test_a_board_found_again_is_made_safe_and_gets_nothing_of_what_was_posted_meanwhile(desk: Desk) -> None:
    before = desk.image()[IMAGE_COUNT]
    desk.bus.cut = True
    desk.step()
    desk.post((OP_WRITE, DAC, 0))
    desk.step(2)
    desk.bus.cut = False
    desk.step(RETRY_NS // PERIOD_NS + 1)
    written = [operation for operations in desk.end.lists for operation in operations]
    assert written == [*SAFE, (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED)]
    assert desk.image()[IMAGE_COUNT] > before
    assert desk.lines[1:] == [
        "board at the bench lost: the wire is cut",
        "no board at the bench: the wire is cut",
        "board found at the bench: revision F, 6 joints",
    ]


@pytest.mark.parametrize("exchange", [0, 1])
def test_what_is_posted_while_the_board_is_being_found_does_not_reach_it_and_is_counted(exchange: int) -> None:
    desk = Desk()
    images = iter(range(2))

    def post_late(_image: Words) -> None:
        if next(images, None) == exchange:
            desk.post((OP_WRITE, DAC, 7), (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED | DISCRETE_POWER | HELD_LINE))

    desk.bus.spoil = post_late
    assert desk.step(2)
    assert (OP_WRITE, DAC, 7) not in desk.end.applied
    assert not any(offset == DISCRETE and value & DISCRETE_POWER for _, offset, value in desk.end.applied)
    assert (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED | HELD_LINE) in desk.end.applied
    assert desk.gateway.dropped == 2


@pytest.mark.parametrize("exchange", [0, 1])
def test_modules_hear_what_is_said_while_their_board_is_being_found(exchange: int) -> None:
    memory, end, images = local_board_memory(), BenchEndpoint(Bench()), iter(range(2))
    bus = ModulesBus(end)

    def say(_image: Words) -> None:
        if next(images, None) == exchange:
            post(memory, (OP_OUTPUTS, 0, 5))

    bus.spoil = say
    assert Gateway(bus, memory, PERIOD_NS).step(0)
    assert end.applied[-1] == (OP_OUTPUTS, 0, 5)


def test_what_a_board_behind_a_gateway_was_told_is_traced_with_its_lane_and_seen_in_a_look(desk: Desk) -> None:
    welcome = read_trace(desk.memory)
    assert set(welcome[:, 1]) == {OWN_LANE}
    assert welcome[:, 2:].tolist() == [*([at, word] for _, at, word in SAFE), [DISCRETE, DISCRETE_HAND_RELAXED]]
    desk.post((OP_WRITE, DAC, 0x10A00), (OP_WRITE, ENC_LOAD, 9))
    desk.post((OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED | DISCRETE_CALIBRATED), lane=Lane.TOOL)
    desk.step()
    assert read_trace(desk.memory, len(welcome)).tolist() == [
        [desk.now_ns, Lane.SERVO, DAC, 0x0A00],
        [desk.now_ns, Lane.TOOL, DISCRETE, DISCRETE_HAND_RELAXED | DISCRETE_CALIBRATED],
    ]
    look = BoardLooker(desk.memory, BoardChoice()).look()
    told = {row["name"]: row["word"] for row in look["registers"]}
    assert (told["DAC 1"], told["DAC 2"]) == (0x0A00, DAC_ZERO)
    assert [bit["on"] for bit in look["bits"] if bit["register"] == "DISCRETE" and bit["bit"] == 6] == [True]


def test_what_a_board_may_never_have_got_is_not_traced(desk: Desk) -> None:
    before = load_head(desk.memory)
    desk.bus.cut = True
    desk.post((OP_WRITE, DAC, 1))
    desk.step()
    assert load_head(desk.memory) == before


@pytest.mark.realtime
def test_a_gateway_whose_terminal_is_closed_goes_on_while_the_arm_is_driven_and_leaves_the_board_safe() -> None:
    end, exchanges = BenchEndpoint(Bench()), list[int]()
    bus = DirectBus(end)

    def driven() -> bool:
        exchanges.append(len(end.lists))
        return len(exchanges) < 5

    def close_the_terminal(_line: str) -> None:
        os.kill(os.getpid(), signal.SIGHUP)

    with default_signals(signal.SIGHUP):
        serve(f"hung{os.getpid()}", bus, PERIOD_NS, close_the_terminal, needed=driven)
    assert len(exchanges) == 5
    assert exchanges[0] < exchanges[-1] < len(end.lists)
    assert end.lists[-1] == [*SAFE, (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED)]
    assert bus.closed == 1


def test_the_board_is_left_safe(desk: Desk) -> None:
    desk.gateway.release()
    assert desk.end.lists == [[*SAFE, (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED)]]
    assert desk.bus.closed == 1


class ReferencesBus(DirectBus):
    """A bus to drives that close their own loop."""

    def connect(self) -> BoardFacts:
        return dataclasses.replace(super().connect(), references=True)


@pytest.mark.parametrize("references", [False, True])
def test_references_reach_only_a_board_that_takes_them(references: bool) -> None:
    memory, end = local_board_memory(), BenchEndpoint(Bench())
    gateway = Gateway((ReferencesBus if references else DirectBus)(end), memory, PERIOD_NS)
    assert gateway.step(PERIOD_NS)
    before = memory.facts.illegal_ops
    post(memory, (OP_REFERENCE, 1, -3), (OP_WRITE, DAC, 0x12345))
    assert gateway.step(2 * PERIOD_NS)
    reference = [(OP_REFERENCE, 1, 0xFFFFFFFD)] if references else []
    assert end.lists[-1] == [*reference, (OP_WRITE, DAC, 0x2345)]
    assert memory.facts.illegal_ops - before == (not references)


class ModulesBus(DirectBus):
    """To a board with modules beside it."""

    def connect(self) -> BoardFacts:
        return dataclasses.replace(super().connect(), outputs=True)


@pytest.mark.parametrize("modules", [False, True])
def test_outputs_reach_only_modules_and_are_no_mistake_without_any(modules: bool) -> None:
    memory, end = local_board_memory(), BenchEndpoint(Bench())
    gateway = Gateway((ModulesBus if modules else DirectBus)(end), memory, PERIOD_NS)
    assert gateway.step(PERIOD_NS)
    post(memory, (OP_OUTPUTS, 0, 5), (OP_WRITE, DAC, 1))
    assert gateway.step(2 * PERIOD_NS)
    assert end.lists[-1] == [*([(OP_OUTPUTS, 0, 5)] if modules else []), (OP_WRITE, DAC, 1)]
    assert memory.facts.illegal_ops == 0


@pytest.mark.parametrize("error", [LinkLost("it has gone"), ValueError("a mistake of ours")])
def test_whatever_goes_wrong_at_the_end_the_bus_is_closed_and_what_it_lets_go_of_is_waited_for(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    bus = DirectBus(BenchEndpoint())
    gateway = Gateway(bus, local_board_memory(), 1_000_000, settle=lambda: done.append("settled"))
    assert gateway.step(0)

    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(bus, "exchange", fail)
    monkeypatch.setattr(bus, "close", lambda: done.append("closed"))
    with contextlib.suppress(ValueError):
        gateway.release()
    assert done == ["closed", "settled"]


def test_a_board_that_is_found_again_or_let_go_keeps_the_lines_that_hold_and_no_other() -> None:
    desk = Desk()
    desk.step()
    desk.post((OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED | DISCRETE_LINES))
    desk.step()
    assert desk.end.applied[-1] == (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED | DISCRETE_LINES)
    desk.bus.cut = True
    desk.step()
    desk.bus.cut = False
    desk.now_ns += RETRY_NS
    desk.step()  # before the servo has seen any of it
    assert desk.end.applied[-1] == (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED | HELD_LINE)
    desk.gateway.release()
    assert desk.end.applied[-1] == (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED | HELD_LINE)


def test_what_held_and_was_switched_off_while_the_board_was_away_stays_off() -> None:
    desk = Desk()
    desk.step()
    desk.post((OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED | HELD_LINE))
    desk.step()
    desk.bus.cut = True
    desk.step()
    desk.post((OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED))
    desk.step()
    desk.bus.cut = False
    desk.now_ns += RETRY_NS
    desk.step()
    assert desk.end.applied[-1] == (OP_WRITE, DISCRETE, DISCRETE_HAND_RELAXED)


def test_modules_hear_what_was_said_while_their_board_was_away_and_nothing_older() -> None:
    memory, end = local_board_memory(), BenchEndpoint(Bench())
    bus = ModulesBus(end)
    gateway = Gateway(bus, memory, PERIOD_NS)
    heard = []
    for now_ns, cut, said in (
        (0, False, 7),
        (1, False, 5),
        (2, True, None),
        (3, False, None),
        (4, True, 4),
        (5, True, 0),
    ):
        if said is not None:
            post(memory, (OP_OUTPUTS, 0, said))
        bus.cut = cut
        gateway.step(now_ns * RETRY_NS)
        heard += [value for kind, _, value in end.lists[-1] if kind == OP_OUTPUTS] if not cut else []
    assert heard == [7, 5]  # found with what was said before; found again at 3 without a word
    bus.cut = False
    assert gateway.step(6 * RETRY_NS)
    assert end.lists[-1][-1] == (OP_OUTPUTS, 0, 0)


def test_a_board_behind_a_gateway_is_not_taken_for_the_emulated_one_of_a_file() -> None:
    memory = local_board_memory()
    insist_on_emulated(memory, "left")  # nothing is known of it yet
    memory.facts.now_ns = 5
    insist_on_emulated(memory, "left")
    memory.facts.now_ns, memory.facts.asked = 0, 1
    with pytest.raises(ConfigError, match="the board of left is emulated, and what runs under this name is a gateway"):
        insist_on_emulated(memory, "left")


def test_commands_for_an_emulated_arm_refuse_a_real_one_of_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """The packaged file is every command's default, and a copy of it for a real arm keeps the name."""
    name = f"t{uuid.uuid4().hex[:10]}"
    arm = choose_arm("emulator", None).model_copy(update={"name": name})
    link_of(arm)  # nobody is there
    with create_board_memory(name) as board:
        link_of(arm)
        board.memory.facts.taken_ns = 1
        with pytest.raises(ConfigError, match="name the file that `qrobot board` was started with"):
            link_of(arm)
        with pytest.raises(ConfigError, match="name the file that"):
            calibrate_arm(arm)
        link_of(arm, offline=True)
