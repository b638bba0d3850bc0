"""What stands around the arm: forces in balance, walls that hold, a crank that turns as mechanics says."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError

from qrobot.config.scene import Scene, Tool
from qrobot.sim_board.mujoco_plant import load_plant
from tests.support.pressing import DT, ROBOT, STIFFNESS, HeldArm, tip_down
from tests.support.puma import arm

TABLE, PEG, CRANK = Scene(kind="table"), Scene(kind="peg"), Scene(kind="crank")


def test_a_tip_that_presses_on_the_table_feels_what_its_springs_say() -> None:
    """J' F balances the springs: K (goal - q) + J' F = 0."""
    held = HeldArm(TABLE, tip_down(0.5, 0.1, -0.295, TABLE))
    held.to(tip_down(0.5, 0.1, -0.31, TABLE), 0.3).run(0.7)
    q, force = held.plant.data.qpos[:6], held.plant.contact_force()
    J = arm().jacobian(q)
    lever = held.tip - arm().forward(q)[:3, 3]
    at_tip = J[:3] + np.cross(J[3:], lever, axisa=0, axisb=0, axisc=0)
    np.testing.assert_allclose(STIFFNESS * (held.goal - q) + at_tip.T @ force, 0.0, atol=0.1)
    assert force[2] > 20.0
    assert np.hypot(*force[:2]) <= TABLE.friction * force[2] * 1.001
    assert held.tip[2] == pytest.approx(-0.3, abs=2e-4)


STRETCHED = np.array([0.0, -0.3, 1.0, 0.0, 0.0, 0.0])
FLOOR = -ROBOT.geometry.base_height_m


def lowest_tip(kind: str, q: np.ndarray) -> float:
    """How low the tip comes in a second of free fall, in the base frame, m."""
    plant = load_plant(ROBOT, DT, scene=Scene(kind=kind), sensed=True)
    plant.place(q)
    heights = []
    for _ in range(4000):
        mujoco.mj_step(plant.model, plant.data)
        tool = plant.data.body("tool")
        heights.append(tool.xpos[2] + tool.xmat[8] * TABLE.tool.length_m + FLOOR)
    assert plant.warnings == 0
    return min(heights)


def test_a_falling_arm_is_stopped_by_the_floor_or_a_table_and_by_nothing_else() -> None:
    assert lowest_tip("empty", STRETCHED) < FLOOR - 0.05
    assert lowest_tip("floor", STRETCHED) == pytest.approx(FLOOR, abs=0.01)
    above = tip_down(0.5, 0.1, -0.2, TABLE)
    assert lowest_tip("table", above) == pytest.approx(-0.3, abs=0.01)
    assert lowest_tip("floor", above) < -0.35


def test_the_table_can_be_lowered_while_the_arm_leans_on_it() -> None:
    held = HeldArm(TABLE, tip_down(0.5, 0.1, -0.295, TABLE))
    held.to(tip_down(0.5, 0.1, -0.305, TABLE), 0.2).run(0.3)
    assert held.plant.contact_force()[2] > 5.0
    held.plant.move_scene(np.array([0.5, 0.0, -0.32]))
    held.run(0.5)
    assert held.plant.contact_force().tolist() == [0.0, 0.0, 0.0]
    assert held.tip[2] == pytest.approx(-0.305, abs=1e-3)


@pytest.mark.parametrize("aside", [0.0, 0.0007])
def test_a_peg_fits_into_its_hole_within_the_clearance_and_touches_its_bottom(aside) -> None:
    held = HeldArm(PEG, tip_down(0.5 + aside, 0.0, -0.29, PEG))
    held.to(tip_down(0.5 + aside, 0.0, -0.3 - 0.9 * PEG.depth_m, PEG), 0.4).run(0.1)
    assert np.linalg.norm(held.plant.contact_force()) < 0.01
    held.to(tip_down(0.5 + aside, 0.0, -0.3 - 1.2 * PEG.depth_m, PEG), 0.2).run(0.2)
    assert held.plant.contact_force()[2] > 5.0
    assert held.tip[2] == pytest.approx(-0.3 - PEG.depth_m, abs=5e-4)


def test_walls_keep_a_peg_in_its_hole_and_a_plate_keeps_it_out_beside_it() -> None:
    held = HeldArm(PEG, tip_down(0.5, 0.0, -0.29, PEG))
    held.to(tip_down(0.5, 0.0, -0.3 - 0.9 * PEG.depth_m, PEG), 0.4)
    held.to(tip_down(0.5, 0.02, -0.3 - 0.9 * PEG.depth_m, PEG), 0.4).run(0.3)
    assert held.plant.contact_force()[1] < -20.0
    assert held.tip[1] < 2 * PEG.clearance_m + 1e-3
    beside = HeldArm(PEG, tip_down(0.54, 0.0, -0.29, PEG))
    beside.to(tip_down(0.54, 0.0, -0.31, PEG), 0.2).run(0.3)
    assert beside.tip[2] == pytest.approx(-0.3, abs=5e-4)


def test_a_crank_that_swings_freely_is_slowed_by_its_dry_friction_alone() -> None:
    """omega(t) = omega(0) - friction / inertia * t, then it stands."""
    plant = load_plant(ROBOT, DT, scene=CRANK)
    plant.place(ROBOT.poses["park"])
    plant.data.qvel[6] = 5.0
    slowing = CRANK.crank_friction_n_m / CRANK.crank_inertia_kg_m2
    for _ in range(400):
        mujoco.mj_step(plant.model, plant.data)
    assert plant.data.qvel[6] == pytest.approx(5.0 - slowing * 0.1, rel=1e-3)
    for _ in range(600):
        mujoco.mj_step(plant.model, plant.data)
    assert plant.data.qvel[6] == pytest.approx(0.0, abs=1e-3)
    assert plant.crank_angle == pytest.approx(5.0**2 / 2 / slowing, rel=0.01)


def test_a_tool_in_the_hole_of_the_crank_turns_it_against_its_friction() -> None:
    radius = CRANK.crank_radius_m

    def on_the_circle(angle: float) -> np.ndarray:
        return tip_down(0.5 + radius * np.cos(angle), radius * np.sin(angle), -0.315, CRANK)

    held = HeldArm(CRANK, tip_down(0.5 + radius, 0.0, -0.29, CRANK))
    held.to(on_the_circle(0.0), 0.3)
    for angle in np.linspace(0.0, np.pi, 60):
        held.to(on_the_circle(angle), 0.03, 2)
    force = held.plant.contact_force()
    assert np.linalg.norm(force[:2]) == pytest.approx(CRANK.crank_friction_n_m / radius, rel=0.5)
    assert held.run(0.3).plant.crank_angle == pytest.approx(np.pi, abs=0.02)


def test_contact_goes_the_same_way_to_the_last_bit() -> None:
    runs = [
        HeldArm(PEG, tip_down(0.5, 0.0, -0.3, PEG)).to(tip_down(0.502, 0.0, -0.31, PEG), 0.1).plant.data.qpos
        for _ in range(2)
    ]
    assert runs[0].tobytes() == runs[1].tobytes()


def test_a_scene_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"too small: at least 0\.022 for its hole"):
        Scene(kind="crank", crank_radius_m=0.01)
    with pytest.raises(ValidationError, match="more than twice radius_m"):
        Tool(length_m=0.02)
