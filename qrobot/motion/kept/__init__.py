"""A path that outlives a stop of the servo, and the way back to it, for every programming library."""

from qrobot.motion.kept.kept_path import WAY_BACK_SHARE, KeptPath, kept_path
from qrobot.motion.kept.way_back import ToolPose, WayBackLimit

__all__ = ["WAY_BACK_SHARE", "KeptPath", "ToolPose", "WayBackLimit", "kept_path"]
