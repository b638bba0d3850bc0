"""The arm as mathematics: transforms, kinematics, transmission, dynamics. Pure: no clock, no input or output."""
