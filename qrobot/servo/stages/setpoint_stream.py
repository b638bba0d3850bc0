"""Taking setpoints: when a stream starts, what each frame has to satisfy, what a missing one becomes, when it is lost.

A stream starts playing half a frame after its first frame arrived, so that later frames may arrive a little early or
late. From then on one frame is taken per frame period. A frame that is not there, or is refused, is replaced by going
on at constant velocity, and the path is led back to the setpoints afterwards (`servo.kernels.lead_back`); a second
missing frame in a row, silence for two periods and a margin, or a refused frame ends the stream in a stop on the path.
After any stop the servo follows only a new stream.

After one lost frame the next one is due exactly two periods after the last one that came. The margin lets it be late:
by a quarter of a period, and by one cycle of the servo at least.

The sender's clock need not be ours: how long the taken frame had waited tells the phase, and the playing rate follows
it by at most `MAX_RATE_SHIFT`.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.checks.limit_checks import check_first_setpoint, check_range, check_setpoint
from qrobot.servo.checks.tip_speed import check_tip_step
from qrobot.servo.kernels.interpolator import line_through, rest_at, shift_extrapolated, shift_in
from qrobot.servo.kernels.lead_back import BEND_SLACK, lead_back, too_far_aside, turns_outside
from qrobot.servo.kernels.rounding import round_corner
from qrobot.servo.memory.setpoint_queue import (
    POSITION_SETPOINT,
    QUEUE_CAPACITY,
    TORQUE_SETPOINT,
    drop_all_frames,
    drop_frame,
    newest_arrival_ns,
    peek_frame,
)
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import (
    ServoState,
)

PLAYOUT_FRAMES: Final = 0.5
LOST_AFTER_FRAMES: Final = 2
SILENCE_MARGIN: Final = 0.25  # of a period: how late the frame after a lost one may be [A]
MAX_RATE_SHIFT: Final = 0.02
PHASE_GAIN: Final = 0.05
_PHASE_ROUNDING: Final = 1e-9  # a frame of k ticks ends at the k-th, whatever the sum of k rounded fractions

STREAM_LOST: Final = int(FaultCode.STREAM_LOST)
SP_INVALID: Final = int(FaultCode.SP_INVALID)
SP_STEP: Final = int(FaultCode.SP_STEP)
T1_LIMIT: Final = int(FaultCode.T1_LIMIT)
REFUSALS: Final = tuple(int(FaultCode[name]) for name in ("SP_INVALID", "SP_LIMIT", "SP_STEP", "START_POSE"))
SHORTEST_FRAME_NS: Final = 1_000_000
LONGEST_FRAME_NS: Final = 100_000_000


@lean_kernel
def look_at_frame(state: ServoState, mail: Any) -> bool:
    """Copy the oldest waiting frame of a living stream into the state, discarding what a stop has outdated.

    Numbers of streams grow, so whatever began before the newest stream that was ended is outdated with it.
    """
    n = state.q.size
    for _ in range(QUEUE_CAPACITY):  # no more can wait, whatever is added meanwhile
        if not peek_frame(mail, state.frame):
            return False
        if state.frame.stream > state.dead_stream:
            for j in range(n):
                state.setpoint_modes[j] = state.frame.modes[j]
                state.setpoint[j] = state.frame.values[j]
            return True
        drop_frame(mail)
    return False


@lean_kernel
def asks_for_nothing(state: ServoState) -> bool:
    """The frame holds every joint: whoever sent it only keeps in touch."""
    asked = 0
    for j in range(state.q.size):
        asked += state.setpoint_modes[j]
    return bool(asked == 0)


@lean_kernel
def stream_ready(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> tuple[bool, int, int]:
    """(play now, code, joint): while holding, watch for a stream that begins where the reference stands."""
    if not look_at_frame(state, mail):
        return False, 0, NO_JOINT
    if asks_for_nothing(state):
        drop_frame(mail)
        return False, 0, NO_JOINT
    frame_ns = state.frame.period_ns
    code, joint = check_first_setpoint(state.setpoint, state.setpoint_modes, state.q_ref, params.start_tolerance)
    if code != 0 or not SHORTEST_FRAME_NS <= frame_ns <= LONGEST_FRAME_NS:
        state.dead_stream = state.frame.stream
        return False, code if code != 0 else SP_INVALID, joint
    state.frame_ns = frame_ns
    state.play_at_ns = state.frame.t_ns + int(PLAYOUT_FRAMES * frame_ns)
    return now_ns >= state.play_at_ns, 0, NO_JOINT


@lean_kernel
def forget_waiting(state: ServoState, mail: Any) -> None:
    """A stop while no stream is followed: whatever stream was about to begin does not."""
    for _ in range(QUEUE_CAPACITY):
        if not look_at_frame(state, mail):
            return
        state.dead_stream = state.frame.stream
        drop_frame(mail)


@lean_kernel
def start_stream(params: ServoParameters, state: ServoState, now_ns: int) -> None:
    """Begin to play the stream whose first frame `stream_ready` has shown, at its time and not at the tick after it."""
    state.stream = state.frame.stream
    state.next_seq = state.frame.seq
    state.last_arrival_ns = now_ns
    state.misses = state.bridged = state.led_back = 0
    rest_at(state.knots, state.rounding, state.q_ref)
    for j in range(state.q.size):
        state.aside[j] = 0.0
    overdue_s = min(now_ns - state.play_at_ns, params.period_ns) * 1e-9
    state.rate = 1e9 / state.frame_ns
    state.phase = 1.0 + (overdue_s - state.dt) * state.rate
    state.rate_slope = 0.0


@lean_kernel
def end_stream(state: ServoState, mail: Any) -> None:
    """Follow no frame of the present stream any more."""
    state.dead_stream = max(state.dead_stream, state.stream)
    state.misses = 0
    drop_all_frames(mail)


@lean_kernel
def _follow_phase(state: ServoState, now_ns: int) -> None:
    """Let the playing rate follow the sender's clock: a frame should have waited half a period when its turn comes."""
    frame_ns = state.frame_ns
    waited = (now_ns - state.frame.t_ns) / frame_ns - state.phase
    shift = min(max(PHASE_GAIN * (waited - PLAYOUT_FRAMES), -MAX_RATE_SHIFT), MAX_RATE_SHIFT)
    state.rate = (1.0 + shift) * 1e9 / frame_ns


@lean_kernel
def take_frame(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> tuple[int, int]:
    """(code, joint): make the next frame, or what replaces it, the newest knot."""
    while look_at_frame(state, mail) and state.frame.stream == state.stream:
        if state.frame.seq < state.next_seq:  # came after its substitute, or twice
            drop_frame(mail)
            continue
        if state.frame.seq > state.next_seq:  # the frame before it is lost
            break
        code, joint = _judge_frame(params, state)
        if code == 0:
            _accept_frame(params, state, now_ns)
        else:
            go_on_straight(params, state)
        state.next_seq += 1
        drop_frame(mail)
        return code, joint
    state.next_seq += 1
    state.misses += 1
    state.missed_frames += 1
    state.bridged = 1
    go_on_straight(params, state)
    return (STREAM_LOST, NO_JOINT) if state.misses >= LOST_AFTER_FRAMES else _judge_substitute(params, state)


@lean_kernel
def _judge_substitute(params: ServoParameters, state: ServoState) -> tuple[int, int]:
    """(code, joint) of what stands for a missing frame: it does not lead out of the range, where only a stop helps."""
    code, joint = check_range(state.knots[3], state.range_min, state.range_max, params.range_margin)
    led_by_position = code != 0 and state.joint_modes[joint] == POSITION_SETPOINT
    return (STREAM_LOST, joint) if led_by_position else (0, NO_JOINT)


@lean_kernel
def _fill_in(params: ServoParameters, state: ServoState) -> None:
    """Give joints that come back from torque a path, and those that the frame does not speak of their newest knot."""
    for j in range(state.q.size):
        if state.joint_modes[j] == TORQUE_SETPOINT and state.setpoint_modes[j] != TORQUE_SETPOINT:
            # back to a position: from where the joint is, at the speed it has
            line_through(
                state.knots,
                state.rounding,
                params.first_knot,
                j,
                state.phase + 1.0,
                state.q[j],
                state.v[j] / state.rate,
            )
        if state.setpoint_modes[j] == 0:
            state.setpoint_modes[j], state.setpoint[j] = POSITION_SETPOINT, state.knots[3, j] - state.aside[j]


@lean_kernel
def _lead_setpoints_back(params: ServoParameters, state: ServoState) -> bool:
    """Lead the setpoints back to their places after a lost frame; whether they are on that way, or at its end."""
    was_led = state.led_back != 0
    led = lead_back(
        state.setpoint, state.setpoint_modes, state.knots, state.aside, state.bridged,
        state.range_min, state.range_max, params.v_max, params.a_setpoint, state.frame_ns * 1e-9,
    )  # fmt: skip
    state.led_back = 1 if led else 0
    return bool(led or was_led)  # the one after the last that was led ends its bend


@lean_kernel
def _judge_frame(params: ServoParameters, state: ServoState) -> tuple[int, int]:
    """(code, joint) of the frame looked at, once each joint has its setpoint."""
    if state.frame.period_ns != state.frame_ns:
        return SP_INVALID, NO_JOINT
    _fill_in(params, state)
    led, period_s = _lead_setpoints_back(params, state), state.frame_ns * 1e-9
    code, joint = check_setpoint(
        state.setpoint, state.setpoint_modes, state.knots, state.range_min, state.range_max,
        params.v_setpoint, params.a_setpoint, params.tau_setpoint, period_s, BEND_SLACK if led else 1.0,
    )  # fmt: skip
    if code == 0 and led:
        joint = too_far_aside(state.aside, params.following_error, params.a_setpoint, period_s)
        if joint == NO_JOINT:
            joint = turns_outside(
                state.setpoint, state.setpoint_modes, state.knots, state.range_min, state.range_max, params.range_margin
            )
        code = STREAM_LOST if joint != NO_JOINT else 0
    if code == 0:
        code = check_tip_step(
            state.setpoint, state.setpoint_modes, state.knots, period_s,
            params.dynamics.chain, params.tip, params.tool_speed, state.scratch,
        )  # fmt: skip
    if led and code in (SP_STEP, T1_LIMIT):  # not the program asked for so much, but the way back
        code = STREAM_LOST
    return code, joint


@lean_kernel
def _accept_frame(params: ServoParameters, state: ServoState, now_ns: int) -> None:
    for j in range(state.q.size):
        state.joint_modes[j] = state.setpoint_modes[j]
        if state.setpoint_modes[j] == TORQUE_SETPOINT:
            state.torque_setpoint[j] = state.setpoint[j]
            state.setpoint[j] = state.q[j]
        else:
            state.torque_setpoint[j] = 0.0
    shift_in(state.knots, state.setpoint)
    round_corner(params.form, state.knots, state.rounding, params.v_max, state.frame_ns * 1e-9)
    _follow_phase(state, now_ns)
    state.last_arrival_ns = min(state.frame.t_ns, now_ns)  # no frame has come from the future
    state.misses = 0
    state.bridged = 2 if state.bridged == 1 else 0


@lean_kernel
def go_on_straight(params: ServoParameters, state: ServoState) -> None:
    """Go on at the last velocity, by one frame."""
    shift_extrapolated(state.knots)
    round_corner(params.form, state.knots, state.rounding, params.v_max, state.frame_ns * 1e-9)


@lean_kernel
def longest_silence(frame_ns: int, cycle_ns: int) -> int:
    """Nanoseconds after a frame at which its stream is lost: one frame may be missing, and the next one be late."""
    return LOST_AFTER_FRAMES * frame_ns + max(int(SILENCE_MARGIN * frame_ns), cycle_ns)


@lean_kernel
def stream_silent(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> bool:
    """True when nothing has arrived for longer than one lost frame explains; what waits has arrived."""
    newest = max(state.last_arrival_ns, newest_arrival_ns(mail, state.stream))
    return bool(now_ns - newest > longest_silence(state.frame_ns, params.period_ns))


@lean_kernel
def take_path_time(params: ServoParameters, state: ServoState) -> float:
    """Seconds by which the path goes on in this cycle: as many as have passed since the one before.

    Drives that close the position loop have stood meanwhile at their last reference: after a long cycle they are led on
    from there, by two periods, and the path, with a stop that has begun, is as much later.
    """
    most = 2.0 * params.period_ns * 1e-9
    if params.position_drives == 0 or state.dt <= most:
        return state.dt
    state.stop_since_ns = min(state.stop_since_ns + int((state.dt - most) * 1e9), state.t_ns)
    return most


@lean_kernel
def advance_phase(state: ServoState, dt: float) -> None:
    """Move along the path by one tick."""
    state.phase += state.rate * dt


@lean_kernel
def frame_is_over(state: ServoState) -> bool:
    """True when a frame boundary was passed; the phase then counts from there. Several may pass in one long tick."""
    if state.phase >= 1.0 - _PHASE_ROUNDING:
        state.phase -= 1.0
        return True
    return False
