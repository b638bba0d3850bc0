"""Shared test profile: no hypothesis deadline (compiling is not a slow example), derandomised for bit-identical CI."""

from hypothesis import settings

settings.register_profile("qrobot", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("qrobot")
