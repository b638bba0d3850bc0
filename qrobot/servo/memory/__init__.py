"""Shared memory of the servo: mailbox, setpoint queue, telemetry, records, and who commands."""
