"""The ARCL Kinematic Interface: one arm's kinematics, usable alone and chosen by name (Corke & Kirkham, section 3.1).

from qrobot.arcl.kinematics import kinematics

aki = kinematics("puma560")
T6 = aki.forward(theta)                                      # rad (m on a sliding joint); poses in m
theta = aki.inverse(T6, config_word("lun"), near=theta)
"""

from qrobot.arcl.kinematics.configuration import config_letters, config_word
from qrobot.arcl.kinematics.interface import ManipulatorKinematics
from qrobot.arcl.kinematics.registry import kinematics, kinematics_names, register_kinematics

__all__ = [
    "ManipulatorKinematics",
    "config_letters",
    "config_word",
    "kinematics",
    "kinematics_names",
    "register_kinematics",
]
