"""All arms of the pendant and all pages that look at them: who may do what, and what each page is told."""

from __future__ import annotations

import json
import logging
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any, Final

from qrobot.errors import MotionError
from qrobot.pendant.arm_station import HELD_LATE_S, ArmStation
from qrobot.pendant.board_messages import PageBoardForce, PageBoardInject, PageBoardRepair
from qrobot.pendant.frames import state_frame, vocabulary
from qrobot.pendant.load_messages import PageCollision, PageLoad
from qrobot.pendant.messages import (
    AnyMessage,
    PageAct,
    PageAlive,
    PageBeat,
    PageCommand,
    PageGive,
    PageHand,
    PageLed,
    PageOverride,
    PagePlace,
    PagePressed,
    PageRecord,
    PageRelease,
    PageRemove,
    PageStop,
    PageTake,
)
from qrobot.pendant.page_message import MovingMessage
from qrobot.pendant.procedure_messages import PageProcedureEnd, PageProcedureKeep, PageProcedureStart
from qrobot.pendant.procedure_runner import LIVE_STEPS
from qrobot.pendant.program_messages import PageProgramEnd, PageProgramInterrupt, PageProgramSay, PageProgramStart
from qrobot.pendant.servo_requests import ANYBODY, POWER_OFF
from qrobot.wire import State

_log = logging.getLogger(__name__)
MOST_FRAMES: Final = 256  # that wait for a page which does not read: some seconds of two arms, then the oldest go


class PageView:
    """Samples and changes that one page has still to be told.

    Attributes:
        number: of the page, from 1; people know it by it.
        frames: samples, oldest first.
        status_due: it has not been told of the newest changes.
        notice, notices: newest line for people at this page alone, and how many there were.
        stops: how many times it has asked for STOP.
    """

    def __init__(self, number: int, wake: Callable[[], None]) -> None:
        self.number, self.wake = number, wake
        self.frames: deque[bytes] = deque(maxlen=MOST_FRAMES)
        self.status_due = True
        self.notice, self.notices = "", 0
        self.stops = 0

    def show(self, frame: bytes) -> None:
        """A sample to be told."""
        self.frames.append(frame)
        self.wake()

    def renew(self) -> None:
        """Tell of changes."""
        self.status_due = True
        self.wake()

    def complain(self, text: str) -> None:
        """Tell the people at this page that something was not done."""
        self.notice, self.notices = text, self.notices + 1
        self.renew()


class DriveFloor:
    """Everything that pages share.

    Args:
        clock: seconds.

    Attributes:
        arms: by number; filled once by whoever builds the pendant.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.arms: list[ArmStation] = []
        self._clock = clock
        self._pages: dict[int, PageView] = {}
        self._last_page = 0

    # ------------------------------------------------------------------------------------------------------- pages

    def enter(self, wake: Callable[[], None]) -> PageView:
        """A page has come; `wake` is called when there is something to tell it."""
        self._last_page += 1
        page = PageView(self._last_page, wake)
        self._pages[page.number] = page
        return page

    def leave(self, page: PageView) -> None:
        """A page has gone, whatever the reason: what it held is let go, and it drives no longer."""
        del self._pages[page.number]
        for arm in self.arms:
            self._end_driving(page, arm)

    def hello(self, page: PageView) -> str:
        """First words to a page."""
        return json.dumps({"page": page.number, "arms": [arm.facts for arm in self.arms], **vocabulary()})

    def status(self, page: PageView) -> str:
        """Changes, as a page is told of them."""
        page.status_due = False
        arms = [arm.status for arm in self.arms]
        own = {"notice": page.notice, "notices": page.notices, "stops": page.stops}
        return json.dumps({"pages": len(self._pages), "arms": arms, **own})

    def changed(self) -> None:
        """Tell every page how things stand: something is another, or nothing was said for a second."""
        for page in list(self._pages.values()):
            page.renew()

    def sampled(self, arm: int, state: State) -> None:
        """A sample of an arm."""
        frame = state_frame(arm, state)
        for page in self._pages.values():
            page.show(frame)

    def look_at_lease(self) -> None:
        """End the driving of pages that sleep, and programs that go on alone; to be called each second."""
        for arm in self.arms:
            try:
                self._look_at_lease_of(arm)
                arm.end_unheld_program()
            except Exception:  # the other arms are looked at all the same
                _log.exception("the lease of arm %s could not be looked at", arm.arm.name)

    # ---------------------------------------------------------------------------------------------------- messages

    def obey(self, page: PageView, message: AnyMessage) -> None:
        """Do what a page says, if it may."""
        for arm in self.arms:
            arm.lease.hear(page.number, self._clock())
        if self._do_for_anybody(page, message):
            return
        if self._of(message).lease.holder == page.number:
            self._refuse_asker(page, self._of(message))
            self._drive(page, message)
        elif not isinstance(message, PageBeat):
            page.complain("only the page that drives this arm can do that: press `Drive from here`")

    def _do_for_anybody(self, page: PageView, message: AnyMessage) -> bool:
        """Do what needs no lease; False when the message is none of that."""
        match message:
            case PageStop():
                page.stops += 1
                page.renew()  # the page waits for it
                self._stop_all()
            case PageTake():
                self._take_lease(page, self._of(message))
            case PageGive():
                self._end_driving(page, self._of(message))
            case PageAlive():
                pass
            case PageRelease():
                self._release_all(page)
            case _:
                return self._end_for_anybody(message)
        return True

    def _stop_all(self) -> None:
        """Stop every arm, whatever fails at another one; a failure is raised afterwards."""
        with ExitStack() as stops:  # begins with the one that was put in last
            for arm in reversed(self.arms):
                stops.callback(arm.stop)

    def _end_for_anybody(self, message: AnyMessage) -> bool:
        """The same of what only makes an arm do less."""
        match message:
            case PageAct(name=name) if name in ANYBODY:
                self._act_for_anybody(self._of(message), name)
            case PageProgramEnd():
                self._of(message).programs.end()
            case PageProcedureEnd():
                self._of(message).procedures.end()
            case PageProgramInterrupt():
                self._of(message).programs.interrupt()
            case _:
                return False
        return True

    def _act_for_anybody(self, arm: ArmStation, name: str) -> None:
        """An action at one arm; power off takes back the programs of other arms as well that may still power it."""
        with ExitStack() as steps:  # from the last one up
            for each in self.arms if name == POWER_OFF else ():
                if each.may_take(arm):
                    steps.callback(each.end_program_before, arm)
            steps.callback(arm.act, name)

    def _drive(self, page: PageView, message: Any) -> None:
        """A message of the page that drives the arm."""
        if _moves(self._of(message), message):
            self._of(message).refuse_late(message.heard_s)
        match message:
            case PagePressed():
                self._press(page, message)
            case PageBeat():
                self._beat(self._of(message), message)
            case PageAct(name=name):
                self._of(message).act(name)
            case PageCommand(on=on, guide=guide, back_mm=back_mm):
                self._of(message).take_arm(guide, back_mm) if on else self._of(message).give_arm()
            case PageLoad(mass=mass, centre_mm=centre_mm):
                self._of(message).set_load(mass, centre_mm)
            case PageCollision(share=share, reaction=reaction):
                self._of(message).choose_collision(share, reaction)
            case PageOverride(factor=factor):
                self._of(message).requests.override(factor)
            case PageHand(opened=opened):
                self._of(message).worker.say(do="hand", opened=opened)
            case PageProgramStart():
                own = self._of(message)
                driven = [arm for arm in self.arms if arm.lease.holder == page.number]
                own.start_program(message, [arm for arm in driven if arm is not own])
            case _:
                self._work(self._of(message), message)

    def _work(self, arm: ArmStation, message: Any) -> None:
        """A message of the page that drives about places, programs or the board."""
        match message:
            case PageRecord(name=name):
                arm.record(name)
            case PageLed(keep=True, smooth_mm=smooth_mm):
                arm.keep_recording(smooth_mm)
            case PageLed():
                arm.worker.say(do="forget")
            case PageRemove(name=name):
                arm.places.remove(name)
            case PagePlace():
                arm.places.put(message)
            case PageProgramSay(line=line):
                arm.programs.say(line)
            case PageBoardForce(line=line):
                arm.board.force(line)
            case PageBoardInject(line=line):
                arm.board.inject(line)
            case PageBoardRepair():
                arm.board.repair()
            case PageProcedureStart():
                arm.start_procedure(message)
            case PageProcedureKeep(confirmed=confirmed):
                arm.tell(f"the model is {arm.procedures.keep(confirmed)}: name it as `model` in [arm.servo]")

    def _press(self, page: PageView, message: PagePressed) -> None:
        """A page moves one arm at a time: what it held at another one is let go, also where the press comes late."""
        self._release_all(page)
        self._of(message).refuse_late(message.heard_s, HELD_LATE_S)
        self._of(message).worker.say(**message.model_dump(exclude={"arm", "heard_s"}))

    def _beat(self, arm: ArmStation, message: PageBeat) -> None:
        """A beat that comes late is none: the press dies of that silence, and whoever held its button is told."""
        if not arm.is_late(message.heard_s, HELD_LATE_S):
            arm.worker.say(do="beat", number=message.number)

    def _of(self, message: Any) -> ArmStation:
        if not message.arm < len(self.arms):
            raise MotionError(f"there are {len(self.arms)} arms, none of number {message.arm + 1}")
        arm: ArmStation = self.arms[message.arm]
        return arm

    def _take_lease(self, page: PageView, arm: ArmStation) -> None:
        """Take the lease of an arm; while another page has it ask that one, or refuse whoever asks."""
        self._refuse_asker(page, arm)
        self._look_at_lease_of(arm)
        if not arm.lease.take(page.number, self._clock()) and (driver := self._pages.get(arm.lease.holder or 0)):
            driver.complain(f"page {page.number} asks to drive {arm.arm.name}: Give up driving, or Keep driving")
        self.changed()

    def _refuse_asker(self, page: PageView, arm: ArmStation) -> None:
        """A page does what only a driver does: whoever asks for the lease meanwhile is told that it does not get it."""
        refused = arm.lease.keep(page.number)
        if refused in self._pages:
            self._pages[refused].complain(f"page {page.number} keeps driving {arm.arm.name}")
            self.changed()

    def _look_at_lease_of(self, arm: ArmStation) -> None:
        before = arm.lease.holder
        if arm.lease.expire(self._clock()):
            self._leave_alone(arm)
            if (now := arm.lease.holder) is not None:
                arm.tell(f"page {before} did not answer: page {now} drives {arm.arm.name}")

    def _end_driving(self, page: PageView, arm: ArmStation) -> None:
        if arm.lease.give(page.number):
            self._leave_alone(arm)

    def _leave_alone(self, arm: ArmStation) -> None:
        """An arm that no page drives any longer."""
        arm.worker.say(do="release")
        arm.leave_alone()
        for each in self.arms:
            each.hold_program(arm)
        self.changed()

    def _release_all(self, page: PageView) -> None:
        """Let go of what a page holds."""
        for arm in self.arms:
            if arm.lease.holder == page.number:
                arm.worker.say(do="release")


def _moves(arm: ArmStation, message: Any) -> bool:
    """Whether an arm, or its hand, may move by this message, but for those of a held button, see `HELD_LATE_S`."""
    match message:
        case PageCommand(on=on):
            return bool(on)
        case PageOverride(factor=factor):
            return arm.is_faster(factor)
        case PageProgramStart(manner=manner):
            return bool(manner == "live")
        case PageProgramSay():
            return arm.programs.live
        case PageProcedureStart(step=step):
            return step in LIVE_STEPS
        case _:
            return isinstance(message, MovingMessage) and not isinstance(message, PagePressed | PageBeat)
