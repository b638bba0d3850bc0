"""The numbers on the wire and their names. They stand in programs and recordings: never renumber, only add."""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import Final

VERSION: Final = 3
MAX_JOINTS: Final = 32
SHORTEST_PERIOD_US: Final = 1_000
LONGEST_PERIOD_US: Final = 100_000
DEFAULT_PERIOD_US: Final = 28_000  # RCCL's sample period on the Mark II controller, 28 ms
DEFAULT_PORT: Final = 5600

# No joint of any robot is driven by a larger number; a larger one is a mistake of the program, like NaN.
LARGEST_SETPOINT: Final = 1e6


# Of the operator's speed override: faster than programmed a motion would have to be planned anew.
LARGEST_OVERRIDE: Final = 1.0

N_SENSORS: Final = 8  # channels of the board's converter
N_SIGNALS: Final = 8  # numbers that a program tells beside its setpoints
N_ANALOG_OUTPUTS: Final = 8
LONGEST_SIGNAL: Final = 31  # bytes of the name of one
SIGNAL_NAME_BYTES: Final = 256  # of all names, a blank between two


class ClientRole(IntEnum):
    """Rights of a client: one commander at a time, any number of observers."""

    COMMANDER = 1
    OBSERVER = 2


class JointMode(IntEnum):
    """Meaning of a joint's setpoint."""

    HOLD = 0
    POSITION = 1
    TORQUE = 2


class Hand(IntEnum):
    """Command of the pneumatic hand."""

    RELAXED = 0
    OPEN = 1
    CLOSED = 2


class HelloFlag(IntFlag):
    """Wishes of a HELLO."""

    IN_STEP = 1  # samples at whole multiples of the period on the bridge's clock, as those of other arms


class RobotFlag(IntFlag):
    """Flags of a STATE; the low byte is the servo's, the next one the bridge's."""

    POWERED = 1
    CALIBRATED = 2
    ESTOP_OK = 4
    GUARDED = 8
    AT_REST = 16
    HALTED = 32
    PAUSED = 64
    NO_TORQUES = 128
    YOU_COMMAND = 0x100
    COMMANDED = 0x200
    PATH_WAITS = 0x400
    IN_STEP = 0x800


FLAG_MEANING: Final[dict[RobotFlag, str]] = {
    RobotFlag.POWERED: "arm power is on, as the board's image shows it",
    RobotFlag.CALIBRATED: "the board's image shows calibrated counters; none has jumped, no potentiometer contradicts",
    RobotFlag.ESTOP_OK: "the emergency stop is released, as the board's last image shows it",
    RobotFlag.GUARDED: "the guardian's heartbeat goes on",
    RobotFlag.AT_REST: "the reference of every joint stands still",
    RobotFlag.HALTED: "somebody has asked for a stop, or an end of power, since the servo began to follow setpoints",
    RobotFlag.PAUSED: "the operator wants motions to stand still on their path",
    RobotFlag.NO_TORQUES: "the drives close the position loop, and nobody knows their torques: `tau` is 0",
    RobotFlag.YOU_COMMAND: "this connection commands",
    RobotFlag.COMMANDED: "somebody commands",
    RobotFlag.PATH_WAITS: "the commander's arm stands off its path, until somebody confirms that it may go back",
    RobotFlag.IN_STEP: "`seq` counts the sample periods of the bridge's clock, as HELLO has asked for",
}


class Request(IntFlag):
    """Requests of a COMMAND."""

    POWER = 1
    CLEAR_FAULT = 2
    STOP = 4
    HOLD_TO_RUN = 8
    KEY_HELD = 16
    PATH_WAITS = 32


class CollisionReaction(IntEnum):
    """Behaviour of an arm after the stop that follows a collision."""

    STOP = 0
    COMPLY = 1  # for two seconds the arm is soft


class ErrorCode(IntEnum):
    """Complaints of the bridge. Never renumber, only add."""

    MALFORMED = 1
    VERSION = 2
    WRONG_ROBOT = 3
    COMMANDER_BUSY = 4
    BAD_PERIOD = 5
    AUTHENTICATION = 6
    FULL = 7
    TIMEOUT = 8
    SERVO_GONE = 9
    INVALID_SETPOINT = 10
    SLOW_READER = 11
    PAYLOAD_REFUSED = 12
    COLLISION_REFUSED = 13
    ANALOG_REFUSED = 14
    SERVO_NEW = 15


ERROR_MEANING: Final[dict[ErrorCode, tuple[bool, str]]] = {
    ErrorCode.MALFORMED: (True, "bytes that are no packet, or a packet out of turn"),
    ErrorCode.VERSION: (True, "the client speaks another version of the protocol"),
    ErrorCode.WRONG_ROBOT: (True, "the client named another robot, or, being a commander, none"),
    ErrorCode.COMMANDER_BUSY: (True, "somebody else commands; the text says who"),
    ErrorCode.BAD_PERIOD: (True, "sample period outside 1 to 100 ms"),
    ErrorCode.AUTHENTICATION: (True, "the client may not do this from where it is"),
    ErrorCode.FULL: (True, "too many clients"),
    ErrorCode.TIMEOUT: (True, "no HELLO within 2 s, or no COMMAND from the commander for 1 s"),
    ErrorCode.SERVO_GONE: (False, "the servo does not run, or does not fit; STATE packets resume when one does"),
    ErrorCode.INVALID_SETPOINT: (False, "a setpoint is not a finite number of sane size; the frame counts as missing"),
    ErrorCode.SLOW_READER: (True, "the client has read nothing for 10 s"),
    ErrorCode.PAYLOAD_REFUSED: (False, "the arm cannot carry the payload; the one before it is still reckoned with"),
    ErrorCode.COLLISION_REFUSED: (
        False,
        "the arm takes no such thresholds of a collision; those before count",
    ),
    ErrorCode.ANALOG_REFUSED: (False, "the arm has no such analogue output, or not so many volts; none has changed"),
    ErrorCode.SERVO_NEW: (
        False,
        "the next STATEs are of a servo that knows nothing of this connection; power has to be asked for anew",
    ),
}
"""Code to (does the connection end, what it means)."""
