"""Identification: from recorded motion of an arm to its gravity and friction, with their uncertainty.

`regressor` writes the torques as linear in the parameters of the links, `base` finds which combinations of them motion
can tell, `friction` adds what the drives lose, `fit` estimates it all robustly, and `model` puts the result in words.
"""
