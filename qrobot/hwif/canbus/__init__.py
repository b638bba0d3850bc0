"""The transport over CAN: the board as a CANopen node, and the bus that a gateway drives it by.

`objects` is its object dictionary, derived from the register map; `frames` what the process data look like; `node` the
far end, `client` the near one; `interface` opens any interface of python-can. Only `node` needs the package canopen.
"""
