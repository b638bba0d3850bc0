"""Services of the machine for compiled code: JIT options, atomics, shared memory, the clock, real-time set-up."""
