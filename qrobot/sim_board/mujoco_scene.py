"""Things to touch, as geometry for MuJoCo: a table, a plate with a hole, a crank; and the tool that touches them.

Nothing but the tool collides, and only with what stands around. Whatever stands there hangs on one body that can be
put elsewhere while the plant runs. A hole is eight boxes around an axis: the inscribed circle of their octagon is as
wide as the tool and its clearance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from qrobot.config.scene import Scene, Tool

if TYPE_CHECKING:
    import mujoco

FURNITURE, TOOL, WRIST, CRANK = "furniture", "tool", "wrist", "crank"

_TABLE_HALF_M: Final = (0.3, 0.5, 0.02)  # [A]
_PLATE_WIDTH_M: Final = 0.06  # [A] around the hole of the plate
_RIM_WIDTH_M: Final = 0.012  # [A] around the hole of the crank
_BOTTOM_M: Final = 0.01  # [A] thickness below a hole
_WALLS: Final = 8
_FULL_CONTACT: Final = (0.95, 0.99, 0.0005, 0.5, 2.0)  # solimp: fully hard half a millimetre deep [A]
_AT_REST: Final = 1e-3  # s, time constant of dry friction in the crank's hinge [A]


def set_contact_options(spec: mujoco.MjSpec) -> None:
    """Friction cones that are round, and hold: in the default of MuJoCo things creep under a steady side force."""
    import mujoco

    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0


def add_tool(last_link: Any, tool: Tool, flange_m: float) -> None:
    """The tool as a body of its own, so that a sensor can sit between it and the flange."""
    import mujoco

    body = last_link.add_body(name=TOOL, pos=[0.0, 0.0, flange_m], explicitinertial=True)
    lengthwise, across = 0.5 * tool.mass_kg * tool.radius_m**2, tool.mass_kg * tool.length_m**2 / 12
    body.mass, body.ipos = tool.mass_kg, [0.0, 0.0, 0.5 * tool.length_m]
    body.inertia = [across + 0.5 * lengthwise, across + 0.5 * lengthwise, lengthwise]  # a cylinder's
    body.add_site(name=WRIST)
    rod = body.add_geom(name=TOOL, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[tool.radius_m, 0.0, 0.0])
    rod.fromto = [0.0, 0.0, tool.radius_m, 0.0, 0.0, tool.length_m - tool.radius_m]
    rod.contype, rod.conaffinity = 1, 0


def add_furniture(spec: mujoco.MjSpec, scene: Scene, base_height_m: float) -> None:
    """Floor and whatever the scene is called after."""
    import mujoco

    _add_thing(spec.worldbody, scene, mujoco.mjtGeom.mjGEOM_PLANE, [2.0, 2.0, 0.1], [0.0, 0.0, 0.0])
    place = np.add(scene.position_m, [0.0, 0.0, base_height_m])
    body = spec.worldbody.add_body(name=FURNITURE, pos=place, mocap=True)
    if scene.kind == "table":
        depth = _TABLE_HALF_M[2]
        _add_thing(body, scene, mujoco.mjtGeom.mjGEOM_BOX, list(_TABLE_HALF_M), [0.0, 0.0, -depth])
    elif scene.kind == "peg":
        _add_hole(body, scene, 0.0, _PLATE_WIDTH_M)
    elif scene.kind == "crank":
        _add_hole(_add_crank(body, scene), scene, scene.crank_radius_m, _RIM_WIDTH_M)


def add_wrist_sensor(spec: mujoco.MjSpec) -> None:
    """Force, then torque, of the tool on the flange."""
    import mujoco

    for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
        spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=WRIST)


def _add_crank(body: Any, scene: Scene) -> Any:
    """A body on a vertical hinge with dry friction."""
    crank = body.add_body(name=CRANK, explicitinertial=True)
    crank.mass, crank.ipos, crank.inertia = 1.0, [0.0, 0.0, 0.0], [scene.crank_inertia_kg_m2] * 3
    hinge = crank.add_joint(name=CRANK, axis=[0.0, 0.0, 1.0])
    hinge.frictionloss, hinge.solref_friction = scene.crank_friction_n_m, [_AT_REST, 1.0]
    return crank


def _add_hole(body: Any, scene: Scene, x: float, width: float) -> None:
    """Walls and bottom of a hole whose mouth is at (x, 0, 0)."""
    import mujoco

    box, radius, depth = mujoco.mjtGeom.mjGEOM_BOX, scene.tool.radius_m + scene.clearance_m, scene.depth_m
    outside, middle = radius + width, radius + 0.5 * width
    side = outside * np.tan(np.pi / _WALLS)
    for angle in np.arange(_WALLS) * 2.0 * np.pi / _WALLS:
        place = [x + middle * np.cos(angle), middle * np.sin(angle), -0.5 * depth]
        wall = _add_thing(body, scene, box, [0.5 * width, side, 0.5 * depth], place)
        wall.quat = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
    _add_thing(body, scene, box, [outside, outside, 0.5 * _BOTTOM_M], [x, 0.0, -depth - 0.5 * _BOTTOM_M])


def _add_thing(body: Any, scene: Scene, shape: Any, size: list[float], place: list[float]) -> Any:
    geom = body.add_geom(type=shape, size=size, pos=place)
    geom.contype, geom.conaffinity, geom.priority = 0, 1, 1
    geom.friction = [scene.friction, 0.005, 0.0001]  # sliding; the others play no part with contacts of points
    geom.solref, geom.solimp = [scene.contact_s, 1.0], list(_FULL_CONTACT)
    return geom
