"""QRobot: an open controller stack for retrofitted robots."""

__version__ = "0.1.0"
