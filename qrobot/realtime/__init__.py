"""What compiled code needs from the machine: JIT options, atomics, shared memory, the clock, real-time set-up."""
