"""The packet protocol between a user program and the bridge, without I/O: bytes in, events out.

`layout` says where every byte lies, `packets` and `vocabulary` what the packets mean, `codec` and `framing` turn one
into the other, `states` tells which packet may follow which, and `connection` is the object both ends use.
docs/reference/wire-protocol.md is the page for those who write the other end in another language.
"""

from qrobot.modecodes import Mode
from qrobot.wire.connection import Connection, InvalidSetpoint, WireEvent
from qrobot.wire.packets import (
    AnalogOutputs,
    Bye,
    Collision,
    Command,
    Hello,
    Packet,
    Payload,
    RobotState,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
)
from qrobot.wire.states import Conversation, Side
from qrobot.wire.vocabulary import (
    DEFAULT_PORT,
    LONGEST_PERIOD_US,
    MAX_JOINTS,
    SHORTEST_PERIOD_US,
    VERSION,
    ClientRole,
    CollisionReaction,
    ErrorCode,
    JointMode,
    RobotFlag,
)

__all__ = [
    "DEFAULT_PORT",
    "LONGEST_PERIOD_US",
    "MAX_JOINTS",
    "SHORTEST_PERIOD_US",
    "VERSION",
    "AnalogOutputs",
    "Bye",
    "ClientRole",
    "Collision",
    "CollisionReaction",
    "Command",
    "Connection",
    "Conversation",
    "ErrorCode",
    "Hello",
    "InvalidSetpoint",
    "JointMode",
    "Mode",
    "Packet",
    "Payload",
    "RobotFlag",
    "RobotState",
    "Side",
    "Signals",
    "State",
    "Stop",
    "Welcome",
    "WireError",
    "WireEvent",
]
