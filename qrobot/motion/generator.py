"""The trajectory generator: requests go in at any time, one setpoint per joint comes out per sample.

    generator = Generator(motion_limits(robot), 0.028, q)
    generator.push(MoveRequest("park", q_park, JointSpeed(0.35)))
    while (output := generator.update(tick)).moving:
        tick += 1

A request becomes a segment from one via point to the next, straight in its coordinates (coordinates.py). When
another request follows in time, the path turns round the via point in a transition and never reaches it; otherwise the
arm comes to rest there, relative to the goal when the goal moves, and stays with it. Position, velocity and
acceleration of the setpoints are continuous whatever happens. On joint paths they are planned within the limits; other
setpoints, whose goals may move, are checked one by one before they go out, and a joint stop takes the place of one that
fails.

Stops: `skip` ends the present request and goes on to the next, `stop` drops all requests and comes to rest, on the path
where it can (path stop), `abort` brings the joints to rest wherever they can (joint stop), as soon as they can. The
table is in phase.py.
"""

from __future__ import annotations

from contextlib import suppress
from copy import deepcopy

from qrobot.arrays import Floats
from qrobot.errors import FenceCrossed, JointLimit, MotionError, Singular, Unreachable
from qrobot.fences.fence_set import FenceSet
from qrobot.motion.event import Termination
from qrobot.motion.path.blend import Blend, Correction
from qrobot.motion.path.coordinates import JOINTS
from qrobot.motion.path.path_piece import BlendSettings
from qrobot.motion.path.phase import Phase
from qrobot.motion.path.setpoint_history import History
from qrobot.motion.planning.fence_check import FenceCheck
from qrobot.motion.planning.planner import Planner
from qrobot.motion.planning.request_queue import QUEUE_SIZE, RequestQueue
from qrobot.motion.planning.setpoint_check import joint_at_limit, judge_next, reason
from qrobot.motion.request import MoveRequest
from qrobot.motion.trajectory.output import Output
from qrobot.motion.trajectory.planned_path import PlannedPath
from qrobot.motion.trajectory.sequencer import Sequencer
from qrobot.motion.trajectory.speed_override import FULL_SPEED
from qrobot.motion.trajectory.trajectory_state import TrajectoryState
from qrobot.motion.world.equation import Goal
from qrobot.motion.world.kinematics import ArmKinematics
from qrobot.motion.world.limits import MotionLimits


class Generator:
    """Motion of one arm.

    Args:
        limits: of the arm.
        period_s: sample period.
        q: setpoint to begin at, at rest. Shape (n,).
        tick: number of that sample.
        blend: polynomial of the transitions.
        queue_size: how many requests may wait.
        kinematics: of the arm; without them only joint positions can be gone to.
        correction: polynomial that fades out a velocity the transition did not expect.
        fences: that the arm keeps off, None for none.
    """

    def __init__(
        self,
        limits: MotionLimits,
        period_s: float,
        q: Floats,
        tick: int = 0,
        blend: Blend = Blend.QUARTIC,
        queue_size: int = QUEUE_SIZE,
        kinematics: ArmKinematics | None = None,
        correction: Correction = Correction.SMOOTH,
        fences: FenceSet | None = None,
    ) -> None:
        self.period_s = period_s
        self._limits, self._kinematics = limits, kinematics
        self._settings = BlendSettings(period_s, blend, correction)
        self._fences = None if fences is None else FenceCheck(fences)
        self._planner = Planner(limits, self._settings, kinematics, self._fences)
        self._queue = RequestQueue(queue_size)
        self._trajectory = TrajectoryState(q, tick, self._settings, limits)
        self._override = FULL_SPEED
        self._path = self._trajectory.path
        self._sequencer = Sequencer(self._planner, limits, self._settings, self._trajectory, self._queue)

    # -------------------------------------------------------------------------------------------------- at any time

    @property
    def phase(self) -> Phase:
        """Phase of the motion at the newest sample."""
        return self._path.phase

    @property
    def waiting(self) -> int:
        """Number of requests that nobody serves yet."""
        return len(self._queue)

    @property
    def busy(self) -> bool:
        """A request is being served, or waits."""
        return self._sequencer.busy

    @property
    def stopping(self) -> bool:
        """An absolute stop is under way."""
        return self._sequencer.stopping

    @property
    def has_events(self) -> bool:
        """Events are still to be told, if only that the arm is idle; also when nothing was left to be done for them."""
        return self._sequencer.events.pending

    @property
    def goal(self) -> Goal | None:
        """Goal that is gone to, or followed, at the newest sample; None on a joint path."""
        return self._path.coordinates.goal

    @property
    def serving(self) -> MoveRequest | None:
        """The request whose segment is under way; None at rest."""
        return self._sequencer.serving

    @property
    def passing(self) -> MoveRequest | None:
        """The request whose via point is passed in the middle of the present transition; None from there on."""
        return self._sequencer.passing

    @property
    def remaining(self) -> float:
        """Samples of path time until the goal of the present segment would be reached without transition; 0 at rest."""
        segment = self._path.segment
        return 0.0 if segment is None else max(0.0, segment.end - self._trajectory.clock)

    @property
    def override(self) -> float:
        """Speed override that is asked for: 1 for the speed as programmed, 0 to stand still on the path."""
        return self._override

    @override.setter
    def override(self, factor: float) -> None:
        """Ask for another speed. Raises MotionError: it is none from 0 to 1."""
        if not 0.0 <= factor <= FULL_SPEED:
            raise MotionError(f"speed override {factor:g}: 0 to 1 are possible")
        self._override = float(factor)

    @property
    def rate(self) -> float:
        """Rate of path time at the newest sample: 1 for the speed as programmed, and in a stop of the joints."""
        return self._trajectory.rate

    @property
    def newest(self) -> Floats:
        """The newest setpoint. Shape (n,)."""
        return self._trajectory.newest

    @property
    def keepable(self) -> bool:
        """The arm may leave the path and come back to it: no goal moves or complies, and no stop is under way."""
        return self._path.coordinates.fixed and not self.stopping

    def stand_still(self, tick: int) -> None:
        """Take it that the arm has been held at the newest setpoint until sample `tick`: the path goes on from there.

        Path time stands still, and passes from rest at the samples behind `tick`, as after a pause. For a path that
        is `keepable`.
        """
        self._trajectory.stand_still(tick)

    def push(self, request: MoveRequest) -> None:
        """Queue a request; it is judged as a motion from the goal before it, from rest to rest, unless one moves.

        Raises:
            JointLimit: the goal, or a Cartesian way there, is outside the joints' range.
            Unreachable, Singular: no configuration, or not this one, reaches the goal or a place on the way.
            FenceCrossed: the way leads too near a fence.
            MotionError: the arm cannot do it in that time, or the queue is full.
        """
        start, near = self._sequencer.last_end(), self._trajectory.newest
        self._queue.push(self._planner.prepare(request, start, near, self._trajectory.tick))
        self._sequencer.events.expect()

    def judge(self, request: MoveRequest) -> None:
        """Raise what `push` would raise for a request but for a full queue; it is not queued."""
        self._planner.prepare(request, self._sequencer.last_end(), self._trajectory.newest, self._trajectory.tick)

    def follow(self, goal: Goal) -> None:
        """Stand at `goal` from now on, and go where it goes: of a generator that was made where `goal` is now.

        Raises:
            MotionError: there are no kinematics.
        """
        if self._kinematics is None:
            raise MotionError("to follow a goal the kinematics are needed, which were not given")
        self._trajectory.follow(goal, self._kinematics)

    def skip(self, code: int) -> None:
        """End the present request with `code` at the next sample: go on to the next one, or stop if none waits.

        It stops also where the next one cannot be met in motion: at another speed one that moves or complies, in a
        pause any that waits while such a goal is gone to. A goal whose velocity is still to be found is met as soon as
        that is known.

        A request that is about to begin ends without having begun. Does nothing at rest; a stop that begins before the
        next sample takes its place. A stop under way that was asked to take its time is over as soon as it can be, and
        ends its request with `code`; any other stays as it is.
        """
        self._sequencer.skip(code)

    def end_passing(self, code: int) -> None:
        """End the request that is `passing` with `code` at once; the arm is on its way to the next one already."""
        self._sequencer.end_passing(code)

    def stop(self, seconds: float = 0.0) -> None:
        """Drop all waiting requests and come to an absolute rest.

        It stays on its path, and takes at least `seconds`, or ends at its goal where that comes sooner. Where the
        joints cannot follow a Cartesian path so, and on the way to a goal that moves, it stops as soon as its joints
        can, beside the path. A stop under way that was asked to take longer becomes this one where that is over sooner.
        """
        self._sequencer.stop(seconds)

    def abort(self, code: int, why: str = "") -> None:
        """Come to an absolute rest wherever the joints can, and drop all waiting requests: what is under way must end.

        The present request ends with `code`, and `why` in words; at rest it is told that the goal which was followed is
        lost. A stop that is under way keeps its own code; on a straight line it is left for a stop of the joints, on a
        joint path it becomes as short as it can be.
        """
        self._sequencer.abort(code, why)

    def state(self) -> Floats:
        """Position, velocity and acceleration of the setpoints at the newest sample. Shape (3, n), SI units.

        Exact on joint paths; else of the parabola through the newest three setpoints.
        """
        return self._trajectory.state()

    # ---------------------------------------------------------------------------------------------- before it happens

    def plan(self) -> PlannedPath:
        """The path from the newest sample on, if nothing else is asked; this generator goes on as if nobody had asked.

        It goes at the speed as programmed, whatever the override. Monitors are not called. Takes about as long as the
        updates do whose setpoints it finds.

        Raises:
            MotionError: a goal moves, so that nobody can know the path.
        """
        return self.copy().run_to_rest()

    def copy(self) -> Generator:
        """Another generator in the same state, at the speed as programmed, which goes its own way.

        Requests and kinematics are shared.

        Raises:
            MotionError: a goal moves: its functions are to be called once for each sample.
        """
        requests = [queued.request for queued in self._queue] + self._sequencer.requests
        moving = [request.name for request in requests if isinstance(goal := request.target, Goal) and not goal.fixed]
        if moving or not self._path.coordinates.fixed:
            what = ", ".join(moving) or "the goal that is followed"
            raise MotionError(f"the path to {what} cannot be planned before it runs: the goal moves, or complies")
        targets = (request.target for request in requests)
        shared = [JOINTS, self._limits, self._kinematics, *requests, *targets]
        known: dict[int, object] = {id(thing): thing for thing in shared}
        if self._fences is not None:  # another thread may follow the twin
            known[id(self._fences.fences)] = self._fences.fences.for_one_thread()
        twin = deepcopy(self, known)
        twin.override = FULL_SPEED
        twin._trajectory.override.jump(FULL_SPEED)
        return twin

    def run_to_rest(self) -> PlannedPath:
        """Follow the path to where nothing is left to be done, without monitors."""
        trajectory = self._trajectory
        samples = [trajectory.sample(())]
        while self.busy or self.has_events:
            trajectory.advance(trajectory.tick + 1, None)
            self._sample_goals()
            output = self._sequencer.output(self._give_setpoint())
            samples.append(trajectory.sample(output.events))
        return PlannedPath(samples, self._settings)

    # ----------------------------------------------------------------------------------------------- once per sample

    def update(self, tick: int, standing: Floats | None = None) -> Output:
        """Setpoints of sample `tick`.

        Args:
            tick: its number.
            standing: where joints are that follow no setpoints, NaN on all others: what comes next begins there.
                Shape (n,).

        Raises:
            MotionError: it is not later than the sample before, or what a monitor returned is no code.
            Exception: whatever a functional transform or a monitor raised.
        """
        self._trajectory.advance(tick, standing, self._override)
        self._sample_goals()
        self._ask_monitors()
        return self._sequencer.output(self._give_setpoint())

    def _sample_goals(self) -> None:
        """Evaluate the goals that move: of the present segment, and of the request that comes next."""
        self._path.coordinates.sample(self._trajectory.tick)
        if (queued := self._queue.peek()) is not None:
            queued.sample(self._trajectory.tick)

    def _ask_monitors(self) -> None:
        """Ask the monitor of the present request, and that of the one before until it has ended."""
        if (passing := self.passing) is not None and (code := passing.ask_monitor()):
            self.end_passing(code)
        if (serving := self.serving) is not None and (code := serving.ask_monitor()):
            self.skip(code)

    def _give_setpoint(self) -> Floats:
        """The setpoint of this sample, which is given out. Shape (n,)."""
        q = self._checked_setpoint()
        self._sequencer.pass_via_points()
        self._trajectory.give_out(q)
        return q

    def _checked_setpoint(self) -> Floats:
        """The next setpoint, or that of a joint stop when it must not go out. Shape (n,)."""
        try:
            self._sequencer.advance()
            q = self._trajectory.setpoint()
        except (JointLimit, Unreachable, Singular) as error:
            return self._abort_now(reason(error), str(error))
        if not self._trajectory.on_joint_path and (code := self._judge(q)) is not Termination.NONE:
            return self._abort_now(code, self._why(code, q))
        if self._fences is not None and (why := self._fence_objection(self._fences, q)):
            return self._abort_now(Termination.FENCE, why)
        return q

    def _fence_objection(self, fences: FenceCheck, q: Floats) -> str:
        """Words for a setpoint `q` (n,) too near a fence, else ""; a stop under way is the best that can be done."""
        if self.stopping:
            return ""
        if self._path.coordinates.fixed and not self.busy:
            fences.rests_at(q)
            return ""
        try:
            if self._path.coordinates.fixed:
                fences.judge(q)
            else:
                points = self._trajectory.setpoints_with(q)
                fences.judge_stop(points, self.period_s, self._limits, self._settings.blend)
        except FenceCrossed as error:
            return str(error)
        return ""

    def _abort_now(self, code: int, why: str) -> Floats:
        self.abort(code, why)
        return self._trajectory.setpoint()

    def _judge(self, q: Floats) -> Termination:
        """Fault of the setpoint `q` (n,); that a change of speed adds to what the path asks for is none."""
        code = self._judge_points(self._trajectory.setpoints_with(q))
        if code is Termination.TOO_FAST and self._path.coordinates.fixed and not self._trajectory.at_full_speed:
            with suppress(JointLimit, Unreachable, Singular):
                code = self._judge_points(self._trajectory.points_at(self._trajectory.clock))
        if code is not Termination.TOO_FAST or self._kinematics is None:
            return code
        return Termination.SINGULAR if self._kinematics.near_singular(self._trajectory.newest) else code

    def _why(self, code: Termination, q: Floats) -> str:
        """Words for what `_judge` has found wrong with the setpoint `q` (n,): which joint is at which limit."""
        if code is not Termination.JOINT_LIMIT:
            return ""
        points = self._trajectory.setpoints_with(q)
        joint = joint_at_limit(points, self.period_s, self._limits, self._settings.blend)
        return self._limits.leaving(joint, q[joint])

    def _judge_points(self, points: History) -> Termination:
        return judge_next(points, self.period_s, self._limits, self._settings.blend)
