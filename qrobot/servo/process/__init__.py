"""The processes of a servo: daemon, real-time loop, guardian."""
