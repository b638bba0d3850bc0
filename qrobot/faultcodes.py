"""Codes of everything that stops an arm or is worth counting: one number, one name, one sentence, one way out.

The numbers travel on the wire and stand in logs: never renumber, only add.
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import Final

NO_JOINT: Final = -1
"""In place of the number of a joint (from 0), wherever a code speaks of none: in memory, on the wire, in logs."""


class FaultCode(IntEnum):
    """Reasons for which the servo stopped, or refused to start."""

    NONE = 0
    # feedback
    ENC_STUCK = 1
    ENC_JUMP = 2
    ENC_SIGN = 3
    CAL_MISMATCH = 5
    CAL_VOTE = 6
    CAL_INDEX = 7
    ENC_LOSS = 8
    BOARD_GONE = 9
    BOARD_JOINTS = 80
    BOARD_CLOCK = 82
    VEL_LIMIT = 10
    # actuators and power
    DAC_STUCK = 11
    RUNAWAY = 12
    POWER_LOST = 14
    POWER_NO_ACK = 15
    POWER_STOPPED = 81
    BRAKE_STUCK = 16
    BRAKE_SLIP = 17
    SATURATED = 18
    COLLISION = 19
    # timing and processes
    OVERRUN = 21
    GUARD_TRIP = 22
    RT_BUDGET = 25
    PAGEFAULT = 26
    GUARD_LOST = 36
    MOVING_AT_START = 39
    LAW_NAN = 41
    LAW_SLOW = 42
    LAW_BOUNDS = 78
    RATE = 46
    # configuration
    CFG_GAIN = 44
    # the stream of setpoints
    STREAM_LOST = 28
    SP_INVALID = 53
    SP_LIMIT = 54
    SP_STEP = 55
    START_POSE = 50
    # the arm against its limits
    JOINT_LIMIT = 65
    FOLLOWING = 66
    # 67 was reserved and never raised: not to be used for anything else
    T1_LIMIT = 52
    FENCE = 79
    # calibration, beside 5, 6 and 7
    CAL_BLOCKED = 70
    CAL_ROOM = 71
    CAL_STOPPED = 72
    CAL_MOVED = 73
    CAL_NO_TABLE = 74
    # beside the board
    IO_LOST = 75
    # operator
    ESTOP = 47
    HOLD_TO_RUN = 51
    RESET_DENIED = 49


class Quantity(Enum):
    """Meaning and unit of the value and the limit of a code."""

    NOTHING = "nothing"
    POSITION = "position"
    SPEED = "speed"
    TOOL_SPEED = "tool speed"
    DISTANCE = "distance"
    TORQUE = "torque"
    CYCLES = "cycles"
    SECONDS = "seconds"
    FAULTS = "page faults"


_QUANTITY: dict[FaultCode, Quantity] = {
    FaultCode.VEL_LIMIT: Quantity.SPEED,
    FaultCode.RUNAWAY: Quantity.SPEED,
    FaultCode.FOLLOWING: Quantity.POSITION,
    FaultCode.JOINT_LIMIT: Quantity.POSITION,
    FaultCode.BRAKE_SLIP: Quantity.POSITION,
    FaultCode.START_POSE: Quantity.POSITION,
    FaultCode.ENC_STUCK: Quantity.TORQUE,
    FaultCode.ENC_SIGN: Quantity.TORQUE,
    FaultCode.DAC_STUCK: Quantity.TORQUE,
    FaultCode.BRAKE_STUCK: Quantity.TORQUE,
    FaultCode.COLLISION: Quantity.TORQUE,
    FaultCode.SATURATED: Quantity.SECONDS,
    FaultCode.LAW_SLOW: Quantity.SECONDS,
    FaultCode.OVERRUN: Quantity.CYCLES,
    FaultCode.T1_LIMIT: Quantity.TOOL_SPEED,
    FaultCode.FENCE: Quantity.DISTANCE,
    FaultCode.HOLD_TO_RUN: Quantity.SECONDS,
    FaultCode.PAGEFAULT: Quantity.FAULTS,
}


EXPLANATION: dict[FaultCode, tuple[str, str]] = {
    FaultCode.NONE: ("no fault", "nothing to do"),
    FaultCode.ENC_STUCK: (
        "an encoder counts nothing although its motor is driven",
        "check the encoder cable (or its brake, or what jams the joint), `qrobot ctl clear`, then `qrobot calibrate`",
    ),
    FaultCode.ENC_JUMP: (
        "encoder counts jumped further than the joint can move",
        "check the encoder cable, then `qrobot ctl clear`",
    ),
    FaultCode.ENC_SIGN: (
        "a joint accelerates against its torque",
        "check encoder and motor polarity before powering again, then `qrobot calibrate`",
    ),
    FaultCode.CAL_MISMATCH: (
        "a potentiometer contradicts the counters or the calibration table, or does not answer",
        "check its wiring and the table, then `qrobot calibrate`",
    ),
    FaultCode.CAL_VOTE: (
        "the readings of a potentiometer do not agree on one place in the calibration table",
        "check its wiring and the table, then calibrate again with more indexes",
    ),
    FaultCode.CAL_INDEX: (
        "an index pulse was missing, or came where none can be",
        "check the encoder cable, then calibrate again",
    ),
    FaultCode.ENC_LOSS: (
        "an encoder has lost or gained counts: an index pulse came elsewhere than it must",
        "check the encoder cable, `qrobot ctl clear`, then `qrobot calibrate`",
    ),
    FaultCode.BOARD_GONE: (
        "the board does not answer or its data are stale",
        "check the board or its process, then `qrobot ctl clear` where it was a fault, and power on",
    ),
    FaultCode.BOARD_CLOCK: (
        "the clock of the board's time stamps goes faster than ours, so that its joints seem slower than they are",
        "let its images carry nanoseconds, then `qrobot ctl clear` where it was a fault",
    ),
    FaultCode.BOARD_JOINTS: (
        "the board has fewer encoder channels than the robot has joints",
        "put right the robot, board or drives of the deployment file, then ask for power again",
    ),
    FaultCode.VEL_LIMIT: ("a joint moved faster than its limit", "lower the commanded speed, then `qrobot ctl clear`"),
    FaultCode.DAC_STUCK: (
        "a torque nobody commanded outlasted a controlled stop: the arm is held or pushed, or a motor does not obey",
        "clear what pushes or holds the arm; if nothing does, check DAC, amplifier and motor; then `qrobot ctl clear`",
    ),
    FaultCode.RUNAWAY: ("a joint runs away from its command", "check DAC and amplifier before powering again"),
    FaultCode.POWER_LOST: ("arm power dropped while in use", "find what cut it, then `qrobot ctl clear` and power on"),
    FaultCode.POWER_NO_ACK: ("arm power did not come on in time", "press ARM POWER, release the E-stop, try again"),
    FaultCode.BRAKE_STUCK: (
        "a driven joint has not moved since power came on, as encoder and potentiometer say: its brake did not release",
        "check the brake supply, then `qrobot ctl clear`",
    ),
    FaultCode.BRAKE_SLIP: ("the arm moved with closed brakes", "support the arm and service the brake"),
    FaultCode.SATURATED: (
        "torque stayed at its limit for too long, or while its joint fell behind its setpoints",
        "lower acceleration or payload, then start the program again",
    ),
    FaultCode.COLLISION: (
        "something pushes a joint harder than its model can explain",
        "clear the obstacle, or, where nothing was hit, check the load and that joint's motor and encoder; "
        "then start the program again",
    ),
    FaultCode.OVERRUN: (
        "too many cycles were late or skipped",
        "see `qrobot doctor`, lower the rate or relax [arm.servo] overrun, then `qrobot ctl clear`",
    ),
    FaultCode.GUARD_TRIP: ("the guardian cut the torque because the servo's heartbeat stopped", "`qrobot ctl clear`"),
    FaultCode.GUARD_LOST: (
        "the guardian is gone",
        "restart the guardian, then `qrobot ctl clear` where it was a fault, and power on",
    ),
    FaultCode.MOVING_AT_START: (
        "the arm moves although it should be at rest",
        "wait until it stands still, then ask for power again",
    ),
    FaultCode.LAW_NAN: ("the control law returned no finite torque", "correct the law, then `qrobot ctl clear`"),
    FaultCode.LAW_SLOW: (
        "the cycle with its law took more than half its period (a warning) or all of it (a stop with the built-in law)",
        "make the law faster or lower the rate",
    ),
    FaultCode.RT_BUDGET: (
        "the loop would use more processor time than the kernel leaves real-time threads",
        "lower the rate, or raise kernel.sched_rt_runtime_us (see `qrobot doctor`)",
    ),
    FaultCode.PAGEFAULT: (
        "the loop had to wait for a page of memory",
        "let it lock its memory (see `qrobot doctor`); nothing is stopped",
    ),
    FaultCode.RATE: (
        "this machine does not keep the servo rate",
        "lower rate_hz to the rate that the message names, or free the processor of other work",
    ),
    FaultCode.CFG_GAIN: (
        "gains outside the range in which the loop is stable at this rate",
        "use gains inside the range that the message names, or sign them off with `unchecked_gains`",
    ),
    FaultCode.LAW_BOUNDS: (
        "the control law wrote past the end of an array",
        "correct the law, then `qrobot ctl clear`: the law before it is in force again",
    ),
    FaultCode.STREAM_LOST: (
        "setpoints stopped arriving, or no way led back to them after a lost one",
        "restart the program; it begins from where the arm stands",
    ),
    FaultCode.SP_INVALID: ("a setpoint was not a finite number", "correct the program"),
    FaultCode.SP_LIMIT: ("a setpoint lies outside the joint's range", "correct the program"),
    FaultCode.SP_STEP: ("a setpoint asks for more speed or acceleration than the joint has", "correct the program"),
    FaultCode.START_POSE: ("the first setpoint is far from where the arm stands", "start from the measured position"),
    FaultCode.JOINT_LIMIT: (
        "a joint left its range",
        "`qrobot ctl clear` and jog back; or support the arm, release its brakes and move the joint back by hand",
    ),
    FaultCode.FOLLOWING: (
        "a joint lags behind its setpoint by more than allowed",
        "clear obstacles, or lower acceleration or payload, then `qrobot ctl clear`",
    ),
    FaultCode.T1_LIMIT: (
        "the tool would move faster than the reduced speed allows",
        "lower speed, override or acceleration of the program, lead the arm more slowly, or start the servo without "
        "reduced speed",
    ),
    FaultCode.FENCE: (
        "the arm would enter a fence of the deployment file, or come too near another arm, or one that is not heard of",
        "`qrobot ctl fences` tells which; move away, and correct the program or the deployment file; "
        "another arm has to be up and calibrated",
    ),
    FaultCode.CAL_BLOCKED: (
        "a joint needed too much torque to creep",
        "clear what is in its way, then calibrate again",
    ),
    FaultCode.CAL_ROOM: (
        "a joint came to the end of its range while it was calibrated",
        "move it towards its middle by hand, then calibrate again; or use fewer indexes",
    ),
    FaultCode.POWER_STOPPED: (
        "somebody stopped the arm before its power was on",
        "find out why, then ask for power anew: start the program again",
    ),
    FaultCode.CAL_STOPPED: (
        "the calibration was stopped on request, or `qrobot calibrate` was killed",
        "calibrate again",
    ),
    FaultCode.CAL_MOVED: (
        "the arm did not stay at rest while its counters were loaded",
        "keep it free from touch, then calibrate again",
    ),
    FaultCode.CAL_NO_TABLE: (
        "the servo has no calibration table",
        "name one with `calibration_table` in the deployment file",
    ),
    FaultCode.IO_LOST: (
        "a remote module beside the board does not answer, its inputs read as safe; or a sensor's CAN interface fails",
        "check the module, or the interface, and its cable; it is used again as soon as it answers",
    ),
    FaultCode.ESTOP: (
        "the emergency stop is pressed",
        "release it, then `qrobot ctl clear` where it was a fault, and power on",
    ),
    FaultCode.HOLD_TO_RUN: (
        "the key that lets the arm move was released, or its signal stayed away",
        "hold the key to go on",
    ),
    FaultCode.RESET_DENIED: ("the cause of the fault persists", "remove the cause first"),
}


def quantity_of(code: int) -> Quantity:
    """Meaning and unit of the value and the limit of a code."""
    return _QUANTITY.get(code, Quantity.NOTHING)  # type: ignore[call-overload, no-any-return]


def of_joint(joint: int) -> str:
    """Beginning of a line for people about `joint` (from 0): "joint 3: "; empty for NO_JOINT."""
    return "" if joint == NO_JOINT else f"joint {joint + 1}: "


def fault_name(code: int) -> str:
    """Name of a fault code, also of one that this version does not know: a log may be of a later one."""
    try:
        return FaultCode(code).name
    except ValueError:
        return f"fault {code}"


def explain(code: int, joint: int = NO_JOINT) -> str:
    """One line for people: the joint (from 0) if the code speaks of one, name, what happened, what to do."""
    try:
        fault = FaultCode(code)
    except ValueError:
        return f"{of_joint(joint)}{fault_name(code)} (unknown to this version)"
    what, remedy = EXPLANATION[fault]
    return f"{of_joint(joint)}{fault.name}: {what}; {remedy}"
