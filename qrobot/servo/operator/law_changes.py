"""Another law, other gains, other settings of a law: asked for by an operator, taken by the loop between two ticks."""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import Any

import numpy as np

from qrobot.errors import LinkError, LinkLost, LinkTimeout, QRobotError
from qrobot.modecodes import Mode, mode_name
from qrobot.servo.laws.law import KP, KV, M0, Law
from qrobot.servo.laws.law_swap import (
    NO_TORQUE,
    NOT_NOW,
    OUT_OF_BOUNDS,
    SWAPPED,
    ask_for_law,
    ask_for_settings,
    maybe_swap_result,
)
from qrobot.servo.laws.names import law_label
from qrobot.servo.laws.stability import check_gains
from qrobot.servo.laws.trial_process import tried_law
from qrobot.servo.memory.law_history import LawInForce, write_entry
from qrobot.servo.memory.published_state import ServoSnapshot
from qrobot.servo.memory.servo_memory import describe_law, journal_base
from qrobot.servo.memory.settings_text import settings_text
from qrobot.servo.operator.controlled import Controlled
from qrobot.servo.operator.gain_rows import Matrix, changed_gains
from qrobot.servo.operator.loop_wait import await_loop
from qrobot.servo.operator.messages import ChangeGains, ChangeLaw
from qrobot.servo.operator.status import floats


class LawChanges:
    """The laws of a servo since it began, of which one is in force."""

    def __init__(self, servo: Controlled) -> None:
        self._servo = servo
        self._kept = {servo.law.address: (servo.law, servo.law_name)}  # the loop may still be in one: no code is let go
        self._names_told, self._names_noted = 0, ""
        self._late: tuple[Law, str, str] | None = None  # asked for, while the loop did not run, and in words
        self._changing = threading.Lock()  # what is in force changes, or is compared with what was told
        self._note_swap()

    def change_law(self, request: ChangeLaw, given_up: threading.Event) -> None:
        """Try the law beside the loop, which goes on, then ask for the swap, unless whoever wanted it has gone."""
        servo = self._servo
        with self._changing:
            self._await_swap()
            self._note_law_before(servo.mailbox.snapshot())
            if servo.law.compliant and request.name == servo.law_name:
                self._change_settings(request)
                return
        mode = servo.mailbox.snapshot().mode
        if mode not in (Mode.OFF, Mode.HOLDING):  # before the law is loaded: that may take seconds
            raise _not_now(mode)
        law = tried_law(request.name, servo.robot, request.settings, servo.mailbox.info.period_ns, given_up)
        if given_up.is_set():
            raise LinkLost("whoever asked for the law has gone: it has not been taken")
        with self._changing:
            self._note_law_before(servo.mailbox.snapshot())
            self._swap(law, request.name, np.array(servo.swap.gains))

    def _change_settings(self, request: ChangeLaw) -> None:
        """Give a compliant law other settings, in any mode; those left out stay."""
        servo = self._servo
        law = servo.law.with_settings(request.settings)
        check_gains(servo.robot, servo.settings, servo.law_name, np.array(servo.swap.gains), law.chosen)
        ask_for_settings(servo.swap, law)
        if self._result(law, servo.law_name, f"other settings of law {servo.law_name}") != SWAPPED:
            raise QRobotError(f"law {servo.law_name} has failed meanwhile: its settings have not been taken")
        self._take(law, servo.law_name)
        servo.say(f"law {servo.law_name}: {settings_text(law.chosen)}")

    def change_gains(self, request: ChangeGains) -> None:
        """Take other gains for the law in force, as that takes a law. Raises QRobotError for gains that do not fit."""
        servo = self._servo
        with self._changing:
            self._await_swap()
            self._note_law_before(servo.mailbox.snapshot())
            gains = changed_gains(servo.robot.control, np.array(servo.swap.gains), request)
            self._swap(servo.law, servo.law_name, gains, f"other gains of law {servo.law_name}")

    def _swap(self, law: Law, name: str, gains: Matrix, what: str = "") -> None:
        servo = self._servo
        mode = servo.mailbox.snapshot().mode
        if mode not in (Mode.OFF, Mode.HOLDING):  # before the gains are judged: that takes a moment
            raise _not_now(mode)
        check_gains(servo.robot, servo.settings, name, gains, law.chosen)
        self._note_names(servo.mailbox.snapshot())
        self._kept.setdefault(law.address, (law, name))
        ask_for_law(servo.swap, law, gains)
        result = self._result(law, name, what or f"law {name}")
        if result == NOT_NOW:
            raise _not_now(servo.mailbox.snapshot().mode)
        if result == NO_TORQUE:
            raise QRobotError(f"law {name} gives no finite torque where the arm stands: it has not been taken")
        if result == OUT_OF_BOUNDS:
            raise QRobotError(f"law {name} writes past the end of an array where the arm stands: it has not been taken")
        self._take(law, name)
        servo.say(f"law {name}, gains Kp {_listed(gains[KP])} Kv {_listed(gains[KV])}")

    def _take(self, law: Law, name: str) -> None:
        """Note that the loop has taken a law, or other numbers of the one in force."""
        servo = self._servo
        servo.law, servo.law_name = self._kept[law.address] = law, name
        describe_law(servo.mailbox.words, law_label(name))
        self._note_swap()

    def _await_swap(self) -> None:
        """Wait for an earlier request that still stands. Raises LinkTimeout when the loop does not run."""
        if self._late is not None:
            await_loop(lambda: maybe_swap_result(self._servo.swap) is not None)
            self._note_late_swap()

    def _result(self, law: Law, name: str, what: str) -> int | None:
        """Result of the request for `what`. Raises LinkTimeout when the loop does not run: the request stands then."""
        swap = self._servo.swap
        try:
            await_loop(lambda: maybe_swap_result(swap) is not None)
        except LinkTimeout as error:
            self._late = law, name, what
            raise LinkTimeout(f"{error}; should it go on, it takes {what}") from error
        return maybe_swap_result(swap)

    def _note_late_swap(self) -> None:
        """Tell what became of a request whose answer came too late for whoever had made it."""
        result = maybe_swap_result(self._servo.swap)
        if self._late is None or result is None:
            return
        (law, name, what), self._late = self._late, None
        if result == SWAPPED and int(self._servo.swap.law_at) == law.address:
            self._take(law, name)
            self._servo.say(f"taken late, for the loop did not run: {what}")

    def note_fallback(self) -> None:
        """Tell people and readers once the servo has gone back to the law before, because the one in force failed.

        Readers also hear of new names of a program's numbers. While something is being changed nothing is looked at.
        """
        if not self._changing.acquire(blocking=False):
            return
        try:
            with suppress(LinkError):  # the loop was interrupted while it wrote: the next look will do
                now = self._servo.mailbox.snapshot()
                self._note_names(now)
                self._note_law_before(now)
        finally:
            self._changing.release()

    def _note_names(self, now: ServoSnapshot) -> None:
        mailbox = self._servo.mailbox
        told = int(mailbox.memory.command.names_told)
        if told != self._names_told and " ".join(mailbox.signal_names()) != self._names_noted:
            self._note(now.t_ns, now.tick)
        self._names_told = told

    def _note_law_before(self, now: ServoSnapshot) -> None:
        self._note_late_swap()
        servo, address = self._servo, int(self._servo.swap.law_at)
        if address == servo.law.address:
            return
        law, servo.law_name = self._kept[address]
        servo.law = law.with_values(np.array(servo.swap.settings))  # those that it was left with
        self._kept[address] = servo.law, servo.law_name
        describe_law(servo.mailbox.words, law_label(servo.law_name))
        self._note(now.t_ns, now.tick)
        servo.say(f"law {servo.law_name} is in force again: the one after it has failed")

    def _note_swap(self) -> None:
        """Tell whoever keeps a log what is in force since the last swap, or from the start."""
        self._note(int(self._servo.swap.done_t_ns), int(self._servo.swap.done_tick))

    def _note(self, t_ns: int, tick: int) -> None:
        servo, swap = self._servo, self._servo.swap
        kp, kv, inertia = (floats(swap.gains[row]) for row in (KP, KV, M0))
        label, settings = law_label(servo.law_name), settings_text(servo.law.chosen)
        signals, program = " ".join(servo.law.signals), " ".join(servo.mailbox.signal_names())
        self._names_noted = program
        entry = LawInForce(t_ns, tick, label, settings, kp, kv, inertia, signals, program)
        write_entry(servo.mailbox.words, journal_base(servo.mailbox.info.n), entry)


def _not_now(mode: int) -> QRobotError:
    return QRobotError(f"not in mode {mode_name(mode)}: laws and gains change while the arm holds, or without power")


def _listed(vector: Any) -> str:
    return " ".join(f"{value:g}" for value in np.asarray(vector).tolist())
