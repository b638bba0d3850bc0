"""RCI, the robot control interface: real-time control tasks and their conversation with robots.

`link` says what a way to the robot is, `tcp` and `virtual` are the two there are, `client` is what they share, and
`blackboard` holds what was heard and what is to be said. `calls` are the papers' calls for programs of several tasks:
`schedule` says when a task is woken, `monitor` and `task_runner` run it, `robot_cycle` is its cycle around robot I/O;
`virtual_time` and `real_time` are the processors, `host_thread` and `process_processor` the two kinds of them.

What RCCL, ARCL and RCI have in common: `sample_drivers` run the one task of an arm that a programming library moves,
in a thread or on virtual time, and `program_time` is the virtual time of all that a program has.
"""

from qrobot.rci.blackboard import Chg
from qrobot.rci.calls import (
    rci_clear,
    rci_clock,
    rci_close,
    rci_control,
    rci_create,
    rci_descriptor,
    rci_device_interrupt,
    rci_free,
    rci_get_memory,
    rci_malloc,
    rci_onclock,
    rci_onfunction,
    rci_print,
    rci_processors,
    rci_receive,
    rci_release,
    rci_robot,
    rci_send,
    rci_shared_data,
    rci_shared_memory,
    rci_signal,
    rci_start,
    rci_test_and_set,
    rci_ticks,
    rci_timeout,
    rci_trigger,
    rci_wait,
)
from qrobot.rci.descriptor import TaskDescriptor, TaskState
from qrobot.rci.environment import use
from qrobot.rci.link import Link, LinkFactory, hello_for
from qrobot.rci.robot_data import RawWords, RobotData
from qrobot.rci.task_table import ALL
from qrobot.rci.tcp import TcpLink, bridge_address
from qrobot.rci.virtual import VirtualLink

__all__ = [
    "ALL",
    "Chg",
    "Link",
    "LinkFactory",
    "RawWords",
    "RobotData",
    "TaskDescriptor",
    "TaskState",
    "TcpLink",
    "VirtualLink",
    "bridge_address",
    "hello_for",
    "rci_clear",
    "rci_clock",
    "rci_close",
    "rci_control",
    "rci_create",
    "rci_descriptor",
    "rci_device_interrupt",
    "rci_free",
    "rci_get_memory",
    "rci_malloc",
    "rci_onclock",
    "rci_onfunction",
    "rci_print",
    "rci_processors",
    "rci_receive",
    "rci_release",
    "rci_robot",
    "rci_send",
    "rci_shared_data",
    "rci_shared_memory",
    "rci_signal",
    "rci_start",
    "rci_test_and_set",
    "rci_ticks",
    "rci_timeout",
    "rci_trigger",
    "rci_wait",
    "use",
]
