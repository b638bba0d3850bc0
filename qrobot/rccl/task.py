"""The trajectory task: an RCI task whose control function is the trajectory generator.

From power-up to release it goes through the cycle of every task that has a robot (`qrobot.rci.robot_cycle`). The
generator stands still while the servo begins to follow, and runs while it follows. A path that outlives a stop of the
servo waits while the arm stands, until somebody confirms that it may be led back (qrobot.motion.kept). It knows no
clock and no thread: a `SampleDriver` of RCI calls `step` once per STATE.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LinkError, LinkLost, MotionError, ServoFault
from qrobot.fences.fence_set import FenceSet
from qrobot.model.arm import Arm
from qrobot.motion import (
    FULL_SPEED,
    ArmSample,
    Blend,
    EventKind,
    ForceControl,
    Generator,
    Goal,
    kinematics_of,
    motion_limits,
)
from qrobot.motion.kept import KeptPath, Retreat, WayBackLimit, kept_path
from qrobot.motion.trajectory.setpoint_player import SetpointPlayer
from qrobot.rccl.callback_timing import CallbackTiming
from qrobot.rccl.event import Level
from qrobot.rccl.open_motions import OpenMotions
from qrobot.rccl.parameters import MoveOrder
from qrobot.rccl.setpoints import Setpoints, check_start
from qrobot.rccl.task_group import TaskGroup
from qrobot.rccl.trace import Trace
from qrobot.rci import RobotData, TaskDescriptor
from qrobot.rci.descriptor import HOST, NO_BIT, local_area
from qrobot.rci.robot_cycle import SERVO_AWAY, CycleHooks, CyclePhase, RobotCycle, may_go_back
from qrobot.wire import Command, Payload, RobotState, State

_STANDING: Final = 1e-6  # rad/s or m/s: of a setpoint that stands, but for rounding


class TrajectoryTask:
    """One program's hold of one arm.

    Args:
        robot: the arm.
        period_s: sample period.
        clear_fault: clear a latched fault at power-up.
        blend: polynomial of the transitions.
        trace: is told what happens.

    Attributes:
        robot: as given.
        td: its descriptor, as RCI knows it; not in the table of the program's own tasks.
        chg: what the next command says; the task writes setpoints and requests, a program hand and outputs.
        completed: true while the arm has nothing to do.
        period_s: sample period.
        period_number: of the newest sample on the clock that the arms of a machine share, None without one.
        force: what the arm exerts, and the joints that give way.
        motions: motions that have not ended.
        timing: the time that functional transforms take.
        override: the program's speed override, 0 to 1; that of the operator counts besides.
        paused: the program wants its motions to stand still on their path.
        keeps_path: a stop of the servo does not end the program's hold; its motions wait until somebody confirms.
        way_back: how far the arm is led back to its path.
        retract_m: how far the flange goes back after a collision, m; 0 for not at all.
        fences: that the arm keeps off, None for none.
        each_sample: called at each sample once the command is made up, before it goes out.
        group: the arms that move together with this one, None for an arm by itself.
        generated: called with the setpoints of each sample, shape (n,), when they are made.
    """

    def __init__(
        self,
        robot: Robot,
        period_s: float,
        clear_fault: bool = False,
        blend: Blend = Blend.QUARTIC,
        trace: Trace | None = None,
        fences: FenceSet | None = None,
    ) -> None:
        self.group: TaskGroup | None = None
        self.generated: Callable[[Floats], object] | None = None
        data = RobotData(robot, fences)
        self.td = TaskDescriptor(robot.name, NO_BIT, HOST, local_area(), data)
        self.chg, self._data = self.td.chg, data
        self._hooks = CycleHooks(self._hold, self._generate, self._wait, self._stopped, self._slowness)
        self.completed = Level("completed", 1)
        self._tick_before = 0  # the first sample
        self.period_number: int | None = None
        self.override, self.paused = FULL_SPEED, False
        self.keeps_path, self.way_back = False, WayBackLimit()
        self.retract_m, self._retreat = 0.0, Retreat()
        self.each_sample: Callable[[], object] | None = None
        self.robot, self._blend = robot, blend
        self._limits = self._full_limits = motion_limits(robot)
        arm = Arm(robot)
        self._kinematics, self.fences, self.motions = kinematics_of(arm), fences, OpenMotions(arm)
        self._load, self._moved = Payload(0.0), False  # joints, by `each_sample` in the sample before
        self._begin(period_s, trace, clear_fault)

    def begin(self, period_s: float, trace: Trace | None = None) -> None:
        """Take the arm anew, with this sample period."""
        self._tick_before = self.tick
        self._begin(period_s, trace, clear_fault=False)

    def _begin(self, period_s: float, trace: Trace | None, clear_fault: bool) -> None:
        adopts = self.td.heard is None  # and the generator judges its own setpoints
        self._cycle = RobotCycle(self.td, self._data, period_s, clear_fault, self._hooks, judged=False, adopts=adopts)
        self.period_s = period_s
        self.force = ForceControl(self.robot, period_s, self._kinematics)
        self.carry(self._load)
        self.timing = CallbackTiming(period_s * 1e3)
        self._generator: Generator | None = None
        self._player: SetpointPlayer | None = None  # whose setpoints go out instead of the generator's
        self._kept: KeptPath | None = None
        self._trace = trace

    # -------------------------------------------------------------------------------------------- from the program

    def carry(self, load: Payload) -> None:
        """Reckon with a payload in the forces that the arm exerts."""
        self._load = load
        self.force.carry(load.mass, np.array(load.centre), np.array(load.inertia))

    @property
    def how(self) -> RobotState | None:
        """The robot as it was heard last, None before the first sample."""
        return self.td.heard

    @property
    def tick(self) -> int:
        """Samples so far; those that nobody heard count."""
        return self._tick_before + self._cycle.samples

    def count_from(self, tick: int) -> None:
        """Let the newest sample be `tick`, unless it is later already."""
        self._tick_before += max(0, tick - self.tick)

    @property
    def follows_setpoints(self) -> bool:
        """The servo follows, so the arm is under control."""
        return self._cycle.phase is CyclePhase.FOLLOWING

    @property
    def generator(self) -> Generator:
        """The trajectory generator. Raises LinkError before the arm holds."""
        if self._generator is None:
            raise LinkError("the arm is not under control yet")
        return self._generator

    @property
    def busy(self) -> bool:
        """Motions are going on or waiting."""
        return self._player is not None or (self._generator is not None and self._generator.busy)

    @property
    def eventful(self) -> bool:
        """Events of motions are still to come; in the next sample also when a stop has left nothing to be done."""
        return self.busy or (self._generator is not None and self._generator.has_events)

    @property
    def followed(self) -> Goal | None:
        """The goal that moves to which the arm has come, and with which it stays; None for none."""
        return self.generator.goal if self.tied and not self.busy and not self.off_path else None

    @property
    def moves(self) -> bool:
        """The arm is under way on its path."""
        if self._generator is None or self.off_path:
            return False
        return self._player.moves if self._player else bool(np.abs(self._generator.state()[1]).max() > _STANDING)

    @property
    def rate(self) -> float:
        """Speed of the motion as a share of the programmed one: 0 while it stands still on its path."""
        return self.generator.rate if self._player is None or self.off_path else self._player.rate

    def push(self, order: MoveOrder) -> None:
        """Queue a motion whose course is told to its position.

        Raises what `Generator.push` raises, and for a motion that complies what `ForceControl.check` does.
        """
        if isinstance(order.request.target, Goal) and self.how is not None:
            self.force.check(order.request.target, np.array(self.how.q), self.tick)
            self.timing.watch(order.request.target.equation)
        if self._player is not None:
            raise MotionError(f"{order.request.name}: setpoints are being played; wait for `completed` first")
        self.generator.push(order.request)
        if self._trace is not None:
            self._trace.asked(order.request)
        self.motions.add(order)
        self.completed.count = 0

    def play(self, setpoints: Setpoints, label: str) -> None:
        """Send setpoints, which were judged before, one each sample. Raises MotionError: it cannot begin with them."""
        if self.eventful or (self.tied and self.moves):
            raise MotionError(f"{label}: the arm still moves; wait for `completed` first")
        q = self.generator.state()[0]
        check_start(setpoints.q[0], q, self._limits, label)
        self._stand_at(q)  # and with no goal any more
        self._player = SetpointPlayer(setpoints.q, self.period_s, self._limits)
        self.completed.count = 0

    def stop(self, seconds: float = 0.0, retreat_too: bool = True) -> None:
        """Drop all motions and come to an absolute rest, in at least `seconds`; does nothing before the arm holds."""
        if self._retreat.fault is not None:
            if retreat_too:
                self._retreat.stop()
                self.generator.stop(seconds)
        elif self._kept is not None:
            self._kept.give_up(seconds)
        elif self._player is not None:
            self._player.stop()
        elif self._generator is not None:
            self._generator.stop(seconds)

    def begin_stop(self) -> None:
        """Begin to come to rest, with all that moves together with this arm; see `TaskGroup.begin_stop`."""
        (self.stop if self.group is None else self.group.begin_stop)()

    def resume(self) -> None:
        """Let motions go on that `paused` holds, and lead the arm back to a path that is kept."""
        self.paused = False
        if self._kept is not None:
            self._kept.confirmed = True

    @property
    def kept(self) -> Exception | None:
        """Reason for which the arm stands off its kept path, until somebody confirms that it may go back."""
        return None if self._kept is None else self._kept.waits(self.paused)

    @property
    def off_path(self) -> bool:
        """The arm is not on its path: it goes back from what it met, waits, or is led to a path that is kept."""
        return self._kept is not None or self._retreat.fault is not None

    @property
    def tied(self) -> bool:
        """The arm goes to a goal that moves, or stays with it."""
        goal = None if self._generator is None else self._generator.goal
        return goal is not None and not goal.fixed

    def leave(self, power_off: bool) -> None:
        """Begin to let go of the arm, which is at rest."""
        self._cycle.leave(power_off)

    # ------------------------------------------------------------------------------------------------ once per sample

    def step(self, state: State, now_ns: int) -> Command:
        """Answer a STATE, at `now_ns` of this end's clock.

        Raises ServoFault: the servo gave up, or power is refused; MotionError: the arm is not calibrated.
        """
        self.period_number = state.seq if state.in_step else None
        command = self._cycle.step(state, now_ns, self._track)
        if self.off_path and self.group is not None:
            self.group.before_sample(self.tick)
        self._cycle.describe()
        return command

    def _hold(self) -> None:
        """The arm is held, and its setpoints are about to stream."""
        if self.how is None:
            return
        if self.group is not None:
            self.group.join(self)
        self._begin_at(np.array(self.how.q_setpoint))

    def _track(self) -> None:
        """Control function of the task: the generator's setpoints, and the program's own function behind it.

        Joints that the function moves elsewhere are judged as those of any task, and so is the first sample without.
        """
        self._generate()
        moved, self._moved = self._moved, self.each_sample is not None and self._call(self.each_sample)
        if moved or self._moved:
            self._cycle.judge()

    def _call(self, function: Callable[[], object]) -> bool:
        """Call a function of the program; True when it has moved joints elsewhere."""
        made = self.chg.modes, self.chg.setpoints
        function()
        return self.chg.modes is not made[0] or self.chg.setpoints is not made[1]

    @property
    def left(self) -> bool:
        """The arm was let go of."""
        return self._cycle.phase is CyclePhase.LEFT

    def lost(self) -> None:
        """Control of the arm has ended before its time: arms that move together with it come to rest."""
        if self.group is not None:
            self.group.lose(self)

    def _slowness(self) -> str:
        """Remark for a stop of the servo that the program itself may have caused."""
        return self.timing.complaint()

    def lose_link(self, lost: LinkError) -> None:
        """The link is broken, and may be opened anew. Raises `lost`: the path is not kept."""
        self._stopped(lost)
        self._cycle.count_anew()

    def lose_servo(self) -> None:
        """See `SampledTask.lose_servo`. Raises LinkLost, ServoFault: the arm is off a path that is not kept."""
        if self.off_path and self._cycle.phase is not CyclePhase.STOPPING:
            self._stopped(LinkLost(SERVO_AWAY))

    def insist(self) -> None:
        """Raise what has stopped the arm, when the program has given its path up."""
        if self._kept is not None and self._kept.given_up:
            raise self._kept.fault

    def _stopped(self, fault: ServoFault | LinkError) -> None:
        """The servo holds the arm, or none does: keep the path if that is wanted. Raises `fault`: it is not kept."""
        if self._cycle.phase is CyclePhase.STOPPING:
            raise fault
        if self._retreat.wanted(fault, self.retract_m if self._may_retract else 0.0):
            self._cycle.stand()
            if self.how is not None:
                self._cycle.take_again(self.how)
            return
        if self._kept is None and self.keeps_path and self._generator is not None and self._player is None:
            self._kept = kept_path(self._generator, self._kinematics, self.tick, fault)
        if self._kept is None or self._kept.given_up:
            raise fault
        self._kept.wait_again(fault)
        self._cycle.stand()
        self.chg.path_waits = True

    @property
    def _may_retract(self) -> bool:
        if self._generator is None or self.how is None or (self.group is not None and self.group.tied):
            return False  # it may hold what another one holds
        at_rest = self._generator.stopping or self.paused  # it is wanted there
        return self._kept is None and not at_rest and may_go_back(self.how)

    def _wait(self) -> None:
        """Hold whatever can be held, until somebody confirms, or the program gives the path up."""
        if self._kept is None or self.how is None:
            return
        self._kept.hear(self.how.paused, self.tick)
        self.insist()
        if self._kept.confirmed and self._kept.judge(self._way_objection):
            self._cycle.take_again(self.how)
        self.chg.path_waits = not self._kept.confirmed

    def _way_objection(self, goal: Floats) -> MotionError | None:
        if self.how is None:
            return None
        return self.way_back.objection(self.robot, self.motions.arm.forward, np.array(self.how.q), goal)

    def _generate(self) -> None:
        how, tick = self.how, self.tick
        if how is None:
            return
        if self._retreat.fault is not None:
            self._go_back(how)
            return
        if self.group is not None:
            self.group.before_sample(tick)
        if self._kept is not None:
            self._lead_back(self._kept, how)
            return
        if self._player is not None:
            self._play(self._player, how)
            return
        generator = self.generator
        seen = ArmSample(np.array(how.q), np.array(how.v), np.array(how.tau), np.array(how.q_setpoint))
        self.force.observe(seen, generator, tick)
        generator.override = self._override_in_force(how)
        output = generator.update(tick, self.force.standing)
        command = self.force.command(output.q, seen, generator, tick)
        self.chg.drive(command.setpoints, command.torque)
        if self._trace is not None:
            self._trace.sampled(output.q, seen.q, output.events)
        if output.events:
            self.motions.notify(output.events, seen.q, tick)
            if self.group is not None:
                self.group.hear(self, output.events)
            if any(event.kind is EventKind.IDLE for event in output.events):
                self.completed.signal()
        self.motions.update_progress(output)
        self._retreat.note(output.q, self.retract_m > 0.0)
        if self.generated is not None:
            self.generated(output.q)

    def _go_back(self, how: RobotState) -> None:
        """Go a little back from what was met; there the program is told, or its path waits."""
        self._send(self._retreat.step(self.tick, self.paused or how.paused), how)
        if (met := self._retreat.over) is not None and self.follows_setpoints:
            self._retreat.forget()
            self._stopped(met)
            self.chg.stop = True  # this run of setpoints has ended

    def _send(self, q: Floats, how: RobotState) -> None:
        self.chg.go_to(tuple(q.tolist()))
        if self._trace is not None:
            self._trace.sampled(q, np.array(how.q))

    def _lead_back(self, kept: KeptPath, how: RobotState) -> None:
        self._send(kept.way_back(self.tick, self._override_in_force(how)), how)
        if self.follows_setpoints and kept.reached(self.tick):
            self._kept, self._generator = None, kept.generator

    def _override_in_force(self, how: RobotState) -> float:
        """Product of the program's override and the operator's; 0 for either's pause, and while another arm waits."""
        waits = self.group is not None and self.group.waits_for_another(self)
        return 0.0 if self.paused or waits else self.override * how.motion_override

    def _play(self, player: SetpointPlayer, how: RobotState) -> None:
        q = player.step(self.tick, self._override_in_force(how))
        self._send(q, how)
        if self.generated is not None:
            self.generated(q)
        self._retreat.note(q, self.retract_m > 0.0)
        if player.done:
            self._player = None
            self._stand_at(q)
            self.completed.signal()

    def _begin_at(self, q: Floats) -> None:
        """Begin with an arm that is held at `q` (n,): anew, or with the way back to a path that was kept."""
        if self._retreat.fault is not None:
            self._retreat.begin(q, self._limits, self.period_s, self.motions.arm.forward)
        elif self._kept is None:
            self._retreat.forget()
            self._stand_at(q)
        else:
            self._kept.lead_back(self._generator_at, q)

    def _stand_at(self, q: Floats) -> None:
        """A generator that is at rest at `q` (n,), and plans within the speeds that the servo allows now."""
        if self.how is not None:
            self._limits = self._full_limits.slowed(self.how.speed_limit)
        self._generator = self._generator_at(q)

    def _generator_at(self, q: Floats) -> Generator:
        return Generator(
            self._limits, self.period_s, q, self.tick, self._blend, kinematics=self._kinematics, fences=self.fences
        )
