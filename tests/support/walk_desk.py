"""A walk through the board of the emulated arm, on virtual time, with an operator who turns its joints."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from qrobot.arrays import Words
from qrobot.config import Robot, load_robot
from qrobot.config.values import frozen
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.operations import OP_WRITE
from qrobot.rig.board_check import Permissions, StepResult, check_board
from qrobot.rig.board_walk import Walk
from qrobot.sim_board.emulator import Emulator
from tests.support.bus import DirectBus
from tests.support.stepping_endpoint import SteppingEndpoint

ROBOT = load_robot("puma560")
EVERYTHING = Permissions(power=True)
UNATTENDED = Permissions(power=True, hands=False)


class Desk:
    """A walk over the emulated arm, on virtual time; `spoil` changes what the bus shows, `told` is the robot file."""

    def __init__(self, told: Robot = ROBOT, **options: Any) -> None:
        self.emulator = Emulator(ROBOT, physics="rigid", **options)
        self.end = SteppingEndpoint(self.emulator, steps=8, now_ns=1_000_000_000)
        self.channels = ROBOT.n
        self.asked: list[str] = []
        self.answer: Callable[[str], bool] = lambda _question: True
        self.spoil: Callable[[Words], None] = lambda _image: None
        self.written: list[tuple[int, int]] = []
        self.bus = DirectBus(self)
        self.walk = Walk(self.bus, told, self._ask, now_ns=self.now_ns)

    def now_ns(self) -> int:
        return self.end.now_ns

    def facts(self) -> BoardFacts:
        return replace(self.end.facts(), joints=self.channels)

    def apply(self, operations: Operations) -> None:
        self.written += [(int(row[1]), int(row[2])) for row in operations if row[0] == OP_WRITE]
        self.end.apply(operations)

    def read_image(self, image: Words) -> None:
        self.end.read_image(image)
        self.spoil(image)

    def _ask(self, question: str) -> bool:
        self.asked.append(question)
        return self.answer(question)

    def check(self, leave: Permissions = UNATTENDED) -> list[StepResult]:
        return list(check_board(self.walk, leave))

    def by_hand(self, side: int) -> Callable[[str], bool]:
        """Say yes, turn the joint that is asked for, and see which way a joint went since the last question."""
        before = self.emulator.q.copy()

        def answer(question: str) -> bool:
            moved = self.emulator.q - before
            if was_pushed := re.match(r"Joint (\d) .* was pushed", question):
                return bool(moved[int(was_pushed[1]) - 1] > 0)
            before[:] = self.emulator.q
            if question.startswith("Turn joint"):
                joint = int(question.split()[2]) - 1
                self.end.memory.panel.push[joint] = side * 4_000_000
                for _ in range(100):
                    self.end.apply(np.zeros((0, 3), np.int64))
                self.end.memory.panel.push[joint] = 0
            return True

        return answer


def verdicts(findings: list[StepResult]) -> dict[str, bool | None]:
    return {finding.step: finding.ok for finding in findings}


def reversed_in(joint: int, *keys: str) -> Robot:
    """The robot with another sign of `keys` at one joint: an arm whose wires there are swapped."""
    signs = np.where(np.arange(ROBOT.n) == joint - 1, -1, 1)
    changed = {key: frozen(getattr(ROBOT.transmission, key) * signs) for key in keys}
    return ROBOT.model_copy(update={"transmission": ROBOT.transmission.model_copy(update=changed)})
