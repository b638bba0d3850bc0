"""The emulated robot: register semantics of the TRC004, motor drives, a rigid-body plant, and a process around them."""
