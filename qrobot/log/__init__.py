"""Logs: every cycle of a servo in an MCAP file that stays readable whatever dies, and what can be made of it."""
