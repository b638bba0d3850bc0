"""How a study compares what was identified with the arm as it is."""

from __future__ import annotations

import numpy as np

from qrobot.ident.model import identify
from qrobot.rig.perturbed_arm import PerturbedArm
from qrobot.study.identification import compared
from tests.support.observations import PUMA, generated, puma_base


def test_errors_of_friction_that_the_arm_has_none_of_are_numbers() -> None:
    name = PUMA.control.friction_preset
    smooth = PUMA.friction[name].model_copy(update={"viscous": np.zeros(PUMA.n)})
    arm = PerturbedArm.drawn(PUMA.model_copy(update={"friction": {**PUMA.friction, name: smooth}}), 1)
    regressor, base = puma_base()
    beta = base.K @ arm.parameters(regressor)
    found = identify(PUMA, base, regressor, generated(beta, arm.friction, 0.01, 1))
    error = np.array(compared(arm, found, 1)["friction_error"])
    assert np.isfinite(error).all()
    assert np.abs(error[:, 1:]).max() < 0.05
