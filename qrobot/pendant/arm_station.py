"""One arm at the pendant: what is heard of it, what can be asked of it, and the session that moves it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from qrobot.config import Robot
from qrobot.config.deployment import DeployedArm
from qrobot.config.start_place import start_text
from qrobot.errors import MotionError
from qrobot.fences.told_fences import told_fences
from qrobot.model.arm_shape import link_frames
from qrobot.pendant.arm_watch import ArmWatch
from qrobot.pendant.board_access import BoardAccess
from qrobot.pendant.fence_facts import fence_facts, stand_facts
from qrobot.pendant.frames import arm_facts
from qrobot.pendant.free_path import led_name
from qrobot.pendant.jog_worker import JogWorker
from qrobot.pendant.lease import DriverLease
from qrobot.pendant.pause_watch import PauseWatch
from qrobot.pendant.procedure_messages import PageProcedureStart
from qrobot.pendant.procedure_runner import LIVE_STEPS, ProcedureRunner
from qrobot.pendant.program_folder import RECORDED
from qrobot.pendant.program_messages import PageProgramStart
from qrobot.pendant.program_runner import ProgramRunner
from qrobot.pendant.servo_requests import POWER_OFF, ServoRequests
from qrobot.pendant.taught_places import TaughtPlaces
from qrobot.rci.tcp import place_text
from qrobot.units import M_PER_MM, NS_PER_S
from qrobot.wire import State
from qrobot.wire.vocabulary import RobotFlag

LATE_S = 1.0  # a page's word that took longer, there and back with a sample, is not what is wanted now
HELD_LATE_S = 0.5  # [A] the same of a held button: so long, and PATIENCE_S, may the arm move on after it is let go
LEAVE_S = 3.0  # an arm that moved is at rest by then


class ArmStation:
    """Belongs to one arm of the deployment.

    Args:
        arm: of the deployment.
        robot: of the arm.
        tool_m: tip of the tool from the flange.
        taught: file of the places by name.
        on_state: takes each STATE.
        on_change: called, from any thread, when `status` is another.
        programs: of the arm.
        clock: seconds.

    Attributes:
        lease: which page drives it.
        pause: whether it is held while no page does.
        worker: the process that moves the arm.
        requests: those that need no session.
        programs: of the arm.
        places: taught ones.
        board: of the arm.
        procedures: calibration and identification.
    """

    def __init__(
        self,
        arm: DeployedArm,
        robot: Robot,
        tool_m: tuple[float, float, float],
        taught: Path,
        on_state: Callable[[State], None],
        on_change: Callable[[], None],
        programs: ProgramRunner | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.arm, self.robot = arm, robot
        self.facts = {**arm_facts(arm.name, robot, tool_m), **fence_facts(told_fences(arm, robot), robot)}
        self.facts |= stand_facts(arm.stand)
        self.requests = ServoRequests(arm.name, self.tell)
        self.programs = programs or ProgramRunner(arm.name)
        self.watch = ArmWatch(arm, robot, self._hear, on_change, self.programs.deployment)
        self.places = TaughtPlaces(taught, tuple(robot.poses), self.tell)
        self._on_state, self._on_change = on_state, on_change
        self._newest: State | None = None
        self._newest_s, self._clock = 0.0, clock  # when it was heard
        self.lease, self.pause = DriverLease(), PauseWatch(robot)
        self.worker = JogWorker(arm, taught, self.tell)
        self._notice, self._notices = "", 0
        self._commanded = False
        self.board = BoardAccess(arm, self.programs.deployment, self.tell, clock)
        self._folder = Path(arm.log.directory or "out")
        self.procedures = ProcedureRunner(arm.name, self.programs.deployment, arm.robot, self._folder, on_change)
        self._reached: Sequence[ArmStation] = ()  # by the newest program, besides its own arm

    @property
    def status(self) -> dict[str, Any]:
        """State of the arm beside its samples, for a page."""
        taught = self.places.numbers()
        return {
            "driver": self.lease.holder,
            "asker": self.lease.asker,
            "problem": self.watch.problem,
            "notice": self._notice,
            "notices": self._notices,
            "unsure": self.requests.unsure,
            "unsures": self.requests.unsures,
            "session": self.worker.session,
            "guide": self.worker.guide,
            "led": self.worker.led,
            "writes": self.worker.writes,
            "commanded": self._commanded,
            "places": [*self.robot.poses, *taught],
            "taught": taught,
            "program": self.programs.facts,
            "procedure": self.procedures.facts,
        }

    def tell(self, text: str) -> None:
        """A line for people; an empty one only says that something has changed."""
        if text:
            self._notice, self._notices = text, self._notices + 1
        self._on_change()

    def stop(self) -> None:
        """Stop the arm by bridge and servo at once, whichever answers, and let go of what is held."""
        with ExitStack() as steps:  # each is made, whatever another one fails by, from the last one up
            steps.callback(self.procedures.stop)
            steps.callback(self.programs.stop)
            steps.callback(self.worker.say, do="stop")
            steps.callback(lambda: self.requests.stop(self.watch.ask_stop()))

    def act(self, name: str) -> None:
        """Begin one of `servo_requests.ACTIONS`; power off goes by bridge and servo at once, as a stop does.

        It takes back whatever is about to power the arm; a program that commands it already is told, and may wait.
        """
        if name == POWER_OFF:
            ends = not self.commanded_by_program  # as it is before the jog or the step ends, which lets go of the arm
            self.requests.power_off(self.watch.ask_stop(power_off=True))
            self.worker.say(do="stop", power_off=True)
            self.procedures.stop()
            if ends:
                self.programs.stop()
        else:
            self.requests.act(name)

    def take_arm(self, guide: bool, back_mm: float = 0.0) -> None:
        """Begin to command the arm: to jog it, and go back from what it met, or with `guide` to lead it by hand."""
        self.worker.start()
        self.worker.say(do="on", guide=guide, back=back_mm)

    def set_load(self, mass: float, centre_mm: Sequence[float]) -> None:
        """Let the servo reckon with a load, kg, its centre in the flange's frame; told when it does. Returns at once.

        Whoever commands the arm tells it: this pendant's own process while it has taken the arm.
        """
        if self.worker.session == "ready":
            self.worker.say(do="load", mass=mass, centre=list(centre_mm))
        else:
            self.requests.load(mass, [M_PER_MM * each for each in centre_mm])

    def choose_collision(self, share: float, reaction: str) -> None:
        """Have collisions told at a share of the robot file's thresholds, and choose what follows them."""
        most = self.robot.guard.unexplained_torque_or_default
        self.requests.collision((share * most).tolist() if share < 1.0 else (), reaction)

    def keep_recording(self, smooth_mm: float) -> None:
        """Write what the arm was led through beside its logs, smoothed; told when it is, or why it cannot be."""
        name = led_name(self.arm.name)
        self.worker.say(do="keep", folder=str(self._folder), name=name, smooth=smooth_mm * M_PER_MM)

    def give_arm(self) -> None:
        """Bring the arm to rest and command it no longer; returns at once."""
        self.worker.say(do="off")

    def leave_alone(self) -> None:
        """The same when no page drives any longer, and end the step of calibration that moves it."""
        self.give_arm()
        self.procedures.stop()

    def hold_program(self, left: ArmStation) -> None:
        """Pause the program of this arm on its path, at every arm that it reaches, if it reaches one that was `left`.

        What turns out not to be held is ended.
        """
        moved = (self, *self._reached)
        if not self.programs.live or left not in moved:
            return
        for arm in moved:
            arm.pause.ask(self._clock())
            arm.requests.act("pause")
        where = f" at {' and '.join(arm.arm.name for arm in moved)}" if self._reached else ""
        self.tell(f"no page drives: the program is paused{where}; `Drive from here`, and `Go on`")

    def end_unheld_program(self) -> None:
        """End the program of this arm, and stop what it moves, if the pause does not hold an arm that no page drives.

        To be called each second.
        """
        now_s = self._clock()
        alone = [arm for arm in (self, *self._reached) if arm.lease.holder is None and (arm is self or arm._is_led)]
        unheld = {arm.arm.name: why for arm in alone if (why := arm.pause.complaint(now_s))}
        if not self.programs.live or not unheld:
            return
        why = f"no page drives, the program is ended ({'; '.join(f'{name}: {why}' for name, why in unheld.items())})"
        with ExitStack() as steps:  # each is made, whatever another one fails by, from the last one up
            steps.callback(self.tell, why)
            steps.callback(self.programs.end)
            for arm in reversed(alone):
                arm.pause.ask(now_s)  # what moves on all the same is stopped again
                steps.callback(arm.stop_because, why)

    def stop_because(self, why: str) -> None:
        """Stop the arm by bridge and servo at once; whoever looks later is told why."""
        self.requests.stop(self.watch.ask_stop(), why)

    @property
    def _is_led(self) -> bool:
        """Somebody commands the arm, and nothing of its own pendant does, as far as anybody has heard."""
        return self._commanded and self.worker.session == "no" and not (self.procedures.live or self.programs.live)

    def may_take(self, other: ArmStation) -> bool:
        """The program of this arm may still take, and power, another one."""
        return self.programs.live and other in self._reached and not other.commanded_by_program

    def end_program_before(self, off: ArmStation) -> None:
        """End the program of this arm, which might take an arm that was powered `off`."""
        self.programs.stop()
        self.tell(f"{off.arm.name} is powered off: the program that may move it is ended")

    @property
    def commanded_by_program(self) -> bool:
        """Somebody commands the arm, and it is nothing of the pendant's own that ends with its power."""
        own = self.worker.session != "no" or self.procedures.live
        return self._commanded and not own and not self.watch.problem

    @property
    def bridge(self) -> str:
        """Address of its bridge."""
        return place_text((self.arm.bridge.host, self.arm.bridge.port))

    def start_program(self, request: PageProgramStart, others: Sequence[ArmStation] = ()) -> None:
        """Start a program, which may reach those arms of `others` besides that are ready for it as this one has to be.

        Raises:
            MotionError: the arm is not ready for it, or it was not confirmed.
            ConfigError: there is no such program.
        """
        if request.manner == "live" and (why := self._why_not_live(request.confirmed)):
            raise MotionError(f"the program is not started: {why}")
        others = () if request.name.startswith(RECORDED) else others  # a recording is of one arm
        state = self._newest
        place = start_text(np.array(state.robot.q), self.robot) if state is not None and not self.watch.problem else ""
        unfit = {other: other._why_not_live(request.confirmed) for other in others}
        reached = [other for other in others if request.manner != "live" or not unfit[other]]
        self.programs.start(request, [self.bridge, *(other.bridge for other in reached)], place)
        self._reached = reached
        left = "".join(f"; not for {other.arm.name}: {unfit[other]}" for other in others if other not in reached)
        self.tell(f"{request.name} is started{left}")

    def start_procedure(self, request: PageProcedureStart) -> None:
        """Begin a step of calibration or identification. Raises MotionError, as `start_program`."""
        whole = request.step != "calibrate"  # which finds the counters, and powers the arm by itself
        if request.step in LIVE_STEPS and (why := self._why_not_live(request.confirmed, whole)):
            raise MotionError(f"not begun: {why}")
        self.procedures.start(request)

    def refuse_late(self, heard_s: float | None, most_s: float = LATE_S) -> None:
        """Raises MotionError: a page's word `is_late`, and whoever asked may stand beside the arm by now."""
        if self.is_late(heard_s, most_s):
            if self._clock() - self._newest_s > most_s:
                raise MotionError("not done: nothing is heard of the arm, so nobody knows how old your word is")
            raise MotionError("not done: it came late, by a slow connection; look at the arm, and press again")

    def is_late(self, heard_s: float | None, most_s: float) -> bool:
        """Whether a page's word that may move the arm is older than `most_s`, by the sample that the page had heard."""
        if self._newest is None:
            return False
        now_s = self._newest.robot.t_ns / NS_PER_S + self._clock() - self._newest_s  # also when no other one comes
        return heard_s is None or abs(now_s - heard_s) > most_s

    def is_faster(self, override: float) -> bool:
        """Whether motions would go faster by that speed override than they do."""
        return self._newest is not None and not override <= self._newest.robot.override

    def _why_not_live(self, confirmed: bool, whole: bool = True) -> str:
        """Reason why nothing of the pendant may move the arm now; `whole`: calibrated and powered too."""
        state = self._newest
        if state is None or self.watch.problem:
            return self.watch.problem or "nothing is known of the arm"
        flags = RobotFlag(state.robot.flags)
        reasons = (
            (not confirmed, "confirm that the arm may move"),
            (state.robot.fault != 0, "clear the fault"),
            (RobotFlag.ESTOP_OK not in flags, "the emergency stop is pressed"),
            (whole and RobotFlag.CALIBRATED not in flags, "the arm is not calibrated"),
            (whole and RobotFlag.POWERED not in flags, "power on first"),
            (self.worker.session != "no", "let go of the arm first"),
            (self.programs.live or self.procedures.live, "a program or a step moves the arm already"),
            (self._commanded, "somebody else commands the arm"),
        )
        return next((text for wrong, text in reasons if wrong), "")

    def close(self) -> None:
        """The same, and end the processes that do it."""
        self.programs.close()
        self.procedures.close()
        self.board.close()
        self.worker.close()
        self.worker.wait(LEAVE_S)
        self.places.close()

    def record(self, name: str) -> None:
        """Put where the arm is under a name into the file of places; told when it cannot be."""
        if self._newest is None or self.watch.problem:
            self.tell("nothing is known of where the arm is")
            return
        if RobotFlag.CALIBRATED not in RobotFlag(self._newest.robot.flags):
            self.tell("not recorded: the arm is not calibrated, and where it is is not known")
            return
        pose = reduce(np.matmul, link_frames(self.robot, self._newest.robot.q))  # no kernel: pages wait meanwhile
        self.places.record(name, pose)

    def _hear(self, state: State) -> None:
        self._newest, self._newest_s = state, self._clock()
        self.pause.hear(state, self._newest_s)
        if state.commanded != self._commanded:
            self._commanded = state.commanded
            self._on_change()
        self._on_state(state)


def close_all(arms: Sequence[ArmStation]) -> None:
    """Bring all arms to rest, each without waiting for another one, and end what moves them."""
    for arm in arms:
        arm.worker.close()
        arm.programs.end()
        arm.procedures.end()
    for arm in arms:
        arm.close()
