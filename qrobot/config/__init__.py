"""Configuration: TOML files turned into frozen, validated objects. Robots are data; so is a deployment."""

from qrobot.config.deployment import DeployedArm, Deployment, deployment_path, load_deployment
from qrobot.config.robot import Robot, load_robot, robot_path

__all__ = ["DeployedArm", "Deployment", "Robot", "deployment_path", "load_deployment", "load_robot", "robot_path"]
