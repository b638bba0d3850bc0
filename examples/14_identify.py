"""Identify an arm from a recording, one step after the other.

The arm is emulated, but nobody told the controller of it: masses, centres and friction are up to 30 % off the robot
file, and there is something in its hand. Run it with plain Python; `examples/14_identify.ipynb` is the same as a
notebook.
"""

# %% [markdown]
# # Identify an arm
#
# What an arm weighs and how it rubs, from a recording of its motion.

# %%
import numpy as np

from qrobot.config.identified import with_model
from qrobot.ident.base import base_of_robot
from qrobot.ident.compact_recording import load_recording
from qrobot.ident.model import identify
from qrobot.ident.observe import Observer, steady_passes
from qrobot.ident.regressor import gravity_regressor, known_parameters
from qrobot.ident.result import model_of
from qrobot.ident.session import identify_log, inertia_of_log

# %% [markdown]
# ## The recording
#
# One row for each cycle of the servo, as in its log. Passes at constant speed are what is looked at.

# %%
recording = load_recording("unknown_arm")
robot, rows = recording.robot, recording.rows
passes = steady_passes(rows, recording.period_s)
print(f"{rows.size * recording.period_s:.0f} s of {robot.name}, {len(passes)} steady passes")

# %% [markdown]
# ## What can be told
#
# Of the masses and centres of all links, only some combinations show in the torques.

# %%
regressor = gravity_regressor(robot)
base = base_of_robot(robot, regressor)
for index, name in enumerate(base.leaders):
    print(f"{name:4} stands for {base.combination(index)}")

# %% [markdown]
# ## Observations, and a fit
#
# Each pass becomes one equation for every motor that turned: a mean torque, and what multiplies the unknowns.

# %%
observations = Observer(robot, regressor, base).observe(rows, recording.period_s)
first = identify(robot, base, regressor, observations)
print(f"{len(observations)} equations; condition {first.fit.condition:.1f}")

# %% [markdown]
# ## Once more, with better links
#
# `identify_log` does all of this twice: what inertia takes is at first the robot file's, then that of the links found.

# %%
found = identify_log(robot, rows, recording.period_s)
for value in found.values[:5]:
    print(f"{value.name:4} {value.value:8.4f} ± {value.half_width:.4f} {value.unit}, robot file {value.before:7.4f}")
print("held-back passes, error in N m:", found.held_back_rms.round(4), "robot file:", found.before_rms.round(2))

# %% [markdown]
# ## A model for the servo
#
# The combinations become links with positive masses. `write_model` puts them into a file for `qrobot servo --model`.

# %%
model = model_of(found, rows, "2026-11-21")
known = with_model(robot, model)
print("masses in kg:", known.links.mass.round(2), "robot file:", robot.links.mass)

# %% [markdown]
# ## The truth
#
# Only an emulated arm has one to compare with.

# %%
q = np.random.default_rng(0).uniform(robot.limits.q_min, robot.limits.q_max, (500, robot.n))
links = recording.facts["links"]
truth = regressor(q) @ np.array([links[name] for name in regressor.names])
for name, belief in (("robot file", robot), ("identified", known)):
    error = regressor(q) @ known_parameters(belief, regressor) - truth
    print(f"gravity by the {name}: error {np.sqrt((error**2).mean(axis=0)).max():.4f} N m")

# %% [markdown]
# ## Inertia
#
# What acceleration takes is told by a second recording, in which the same arm moves fast.

# %%
fast = load_recording("unknown_arm_fast")
inertial = inertia_of_log(found, fast.rows, fast.period_s)
for name in ("Izz1", "Izz2", "Izz3"):
    value = next(value for value in inertial.values if value.name == name)
    print(f"{value.name} {value.value:7.3f} ± {value.half_width:.3f} {value.unit}, robot file {value.before:7.3f}")
print("held-back run, error in N m:", inertial.held_back_rms.round(2), "robot file:", inertial.before_rms.round(2))
