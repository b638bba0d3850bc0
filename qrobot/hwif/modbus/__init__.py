"""Modbus TCP: the register map of the board as a Modbus map, a server for it, and a bus that reaches one."""

import logging

# What pymodbus has to tell reaches people as our errors and counters; without a handler it would go to stderr.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())
