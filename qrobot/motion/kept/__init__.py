"""Ways back of an arm that the servo has stopped, for every library: to its path, and from what it has met."""

from qrobot.motion.kept.kept_path import WAY_BACK_SHARE, KeptPath, kept_path
from qrobot.motion.kept.retreat import Retreat
from qrobot.motion.kept.way_back import ToolPose, WayBackLimit

__all__ = ["WAY_BACK_SHARE", "KeptPath", "Retreat", "ToolPose", "WayBackLimit", "kept_path"]
