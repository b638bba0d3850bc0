"""`Channel.plan`, and the keys of a trace that scripts read."""

from __future__ import annotations

import json

import numpy as np

from qrobot import rccl
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.trace import Trace


def test_a_plan_has_the_setpoints_that_the_program_then_sends() -> None:
    traces: list[Trace] = []
    with rccl.use(OfflineLink, traces), rccl.control() as arm:
        arm.move(arm.pose("ready"))
        arm.setmode("cartesian")
        arm.setime(100, 800)
        arm.move(arm.pose("end"))
        path = arm.plan()
        assert arm.nbrequest == 2
    sent = traces[0].setpoints.q
    first = len(sent) - len(path.q)
    assert (sent[first:] == path.q).all()
    assert (path.at(0.5 * path.duration_s)[1] != 0.0).any()
    np.testing.assert_array_equal(path.at(path.duration_s)[1:], 0.0)
    assert set(json.loads(traces[0].json_lines().splitlines()[0])) >= {"pace", "mode", "code", "reason"}
