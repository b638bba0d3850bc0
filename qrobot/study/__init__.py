"""Campaigns over many emulated arms, none of which is what the robot file says: from one core to many hosts.

A `Study` says what is done to one arm, which its seed alone decides. `campaign` hands arms to an engine and keeps every
outcome in a results file as soon as it is there; `summary` and `figure` make of a results file what people look at.
"""
