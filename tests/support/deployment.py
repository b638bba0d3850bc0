"""The text of a deployment file with one arm, whose board comes after it."""

from __future__ import annotations

LEFT = """
[[arm]]
name = "left"
robot = "puma560"
bridge = { port = 5600 }
servo = { board_timeout_ms = 10 }
[arm.board]
"""
