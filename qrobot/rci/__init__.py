"""The periodic conversation with one robot: a state in, a command out, once per sample.

`link` says what a way to the robot is, `tcp` and `virtual` are the two there are, `client` is what they share, and
`blackboard` holds what was heard and what is to be said.
"""

from qrobot.rci.blackboard import Chg
from qrobot.rci.link import Link, LinkFactory, hello_for
from qrobot.rci.tcp import TcpLink, bridge_address
from qrobot.rci.virtual import VirtualLink

__all__ = ["Chg", "Link", "LinkFactory", "TcpLink", "VirtualLink", "bridge_address", "hello_for"]
