"""The stages of the servo cycle: inputs, state estimates, setpoints, reference, modes, torque output, publishing."""
