"""Calibration: from counters that mean nothing to exact joint positions."""
