"""Impedance: the arm as springs and dampers between its setpoint and where it is, in joint or in Cartesian space.

The stiffness is a setting of the law, and live: it may change while the arm moves and while something pushes it. The
law goes over to it with the time constant `RAMP_S`, so that its torque is continuous. A spring that becomes stiffer
while it is drawn gains energy, which nobody who touches the arm has put in; so stiffness grows no faster than with the
power that the setting `stiffening` allows. What becomes softer loses energy, and needs no limit.

Damping follows the stiffness in force: 2 zeta sqrt(k M0) on each joint, with the stiffness k that the joint feels.
Gravity is that of the whole model, with the payload; friction is that of the drives at the speed of the reference.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.config import Robot
from qrobot.servo.laws.casadi_law import CasadiLaw
from qrobot.servo.laws.law import KP, M0, SIGNALS_AT, Law, Setting

RAMP_S: Final = 0.1  # [A] the fastest change of stiffness; slower than the joints answer
ORIENTATION_MOST: Final = 2000.0  # N m/rad [A]
POSITION_MOST: Final = 50_000.0  # N/m [A]
USUAL_SHARE: Final = 0.1  # of the robot file's Kp, unless chosen otherwise [A]
MOST_SHARE: Final = 4.0  # of the robot file's Kp, as for gains
USUAL_ZETA: Final = 0.7  # gives way without ringing
DAMPED_SHARE: Final = 0.02  # of Kp: a joint with less stiffness is damped as with this [A]
DAMPED_REACH: Final = 0.05  # m/rad, rad/rad: directions in which a turn of the joints moves the tool less are lost [A]
ZETA, STIFFENING = 0, 1  # the first settings; and memory: ratio in force
STARTED: Final = 1  # memory: 1 once the law has run
JOINT_FIRST: Final = 2  # settings: stiffness of the first joint
X, Y, Z, TURN, NULL, REACH = range(2, 8)  # settings in Cartesian space
N_SPRINGS: Final = 4
CARTESIAN_SIGNALS: Final = ("stiff_x", "stiff_y", "stiff_z", "stiff_turn")

_COMMON: Final = (
    Setting("damping_ratio", USUAL_ZETA, 0.3, 2.0, "-", "of each joint; 1 does not overshoot"),
    Setting("stiffening", 5.0, 0.05, 20.0, "W", "power with which springs that are drawn may become stiffer"),
)
CARTESIAN: Final = (
    *_COMMON,
    Setting("stiffness_x", 1000.0, 0.0, POSITION_MOST, "N/m", "of the tip along x of the base"),
    Setting("stiffness_y", 1000.0, 0.0, POSITION_MOST, "N/m", "along y"),
    Setting("stiffness_z", 1000.0, 0.0, POSITION_MOST, "N/m", "along z"),
    Setting("stiffness_turn", 50.0, 0.0, ORIENTATION_MOST, "N m/rad", "of the tool's orientation, about any axis"),
    Setting("null_stiffness", 0.1, 0.0, 1.0, "-", "share of Kp with which joints are held that cannot move the tip"),
    Setting("reach", 0.0, 0.0, 2.0, "m", "from the flange to the tip, along z"),
)


def joint_settings(robot: Robot) -> tuple[Setting, ...]:
    """Settings of `joint_impedance` for a robot: a stiffness for each joint, a tenth of its Kp unless chosen."""
    rows = zip(robot.control.kp.tolist(), robot.prismatic.tolist(), strict=True)
    return (
        *_COMMON,
        *(
            Setting(
                f"stiffness_{j + 1}", USUAL_SHARE * kp, 0.0, MOST_SHARE * kp, "N/m" if slides else "N m/rad",
                f"of joint {j + 1}",
            )
            for j, (kp, slides) in enumerate(rows)
        ),
    )  # fmt: skip


def joint_impedance(robot: Robot) -> Law:
    """Make the law `joint_impedance` for a robot. Raises ConfigError when the expression cannot be built."""
    signals = tuple(f"stiff_{j + 1}" for j in range(robot.n))
    return CasadiLaw(_joint_impedance, joint_settings(robot), signals, compliant=True).for_robot(robot)


def cartesian_impedance(robot: Robot) -> Law:
    """Make the law `cartesian_impedance` for a robot. Raises ConfigError when the expression cannot be built."""
    return CasadiLaw(_cartesian_impedance, CARTESIAN, CARTESIAN_SIGNALS, compliant=True).for_robot(robot)


def _joint_impedance(
    robot: Any, arm: Any, q_ref: Any, v_ref: Any, q: Any, v: Any, friction: Any, payload: Any, gains: Any,
    settings: Any, memory: Any, dt: Any,
) -> Any:  # fmt: skip
    """Impedance in joint space: each joint is a spring and a damper about its setpoint, the model carries the rest.

    tau = K (q_ref - q) + D (v_ref - v) + g(q) + friction(v_ref), with D = 2 zeta sqrt(max(K, Kp/50) M0)

    K, zeta and `stiffening` are settings that may change at any time; the law goes over to them without a bump.
    """
    import casadi

    error = q_ref - q
    stiffness, zeta = _in_force(settings[JOINT_FIRST : JOINT_FIRST + robot.n], 0.5 * error**2, settings, memory, dt)
    damping = 2.0 * zeta * casadi.sqrt(casadi.fmax(stiffness, DAMPED_SHARE * gains[KP, :].T) * gains[M0, :].T)
    tau = stiffness * error + damping * (v_ref - v) + friction + _gravity(robot, arm, q, payload)
    return tau, _kept(memory, zeta, stiffness)


def _cartesian_impedance(
    robot: Any, arm: Any, q_ref: Any, v_ref: Any, q: Any, v: Any, friction: Any, payload: Any, gains: Any,
    settings: Any, memory: Any, dt: Any,
) -> Any:  # fmt: skip
    """Impedance of the tool: springs along the axes of the base and about all, the model carries the rest.

    tau = J' f + N (s Kp e) + D (v_ref - v) + g(q) + friction(v_ref), with f the springs' force and torque on the tip,
    e = q_ref - q, and N = 1 - J' (J J' + r^2)^-1 J, which leaves the joints that cannot move the tip. D = 2 zeta
    sqrt(k M0) with k the diagonal of J' K J + s Kp, so that no direction of a singular pose is without damping.
    """
    import casadi

    from qrobot.codegen.rigid_body import last_frame, solve_positive  # loads CasADi

    reach = robot.geometry.flange_m + settings[REACH]
    turn, tip = _tip(last_frame(arm, q), reach)
    turn_ref, tip_ref = _tip(last_frame(arm, q_ref), reach)
    jacobian = casadi.vertcat(casadi.jacobian(tip, q), _turning(turn, q))
    way = tip_ref - tip
    turned = 0.5 * sum(casadi.cross(turn[:, i], turn_ref[:, i]) for i in range(3))
    drawn = casadi.vertcat(0.5 * way**2, 0.5 * (3.0 - casadi.trace(turn.T @ turn_ref)))
    stiffness, zeta = _in_force(settings[X : X + N_SPRINGS], drawn, settings, memory, dt)
    springs = casadi.vertcat(stiffness, stiffness[3], stiffness[3])
    null = settings[NULL] * gains[KP, :].T
    felt = casadi.sum1(springs * jacobian**2).T + null
    damping = 2.0 * zeta * casadi.sqrt(casadi.fmax(felt, DAMPED_SHARE * gains[KP, :].T) * gains[M0, :].T)
    held = null * (q_ref - q)
    square = jacobian @ jacobian.T + DAMPED_REACH**2 * casadi.SX.eye(6)
    held -= jacobian.T @ solve_positive(square, jacobian @ held)
    tau = jacobian.T @ (springs * casadi.vertcat(way, turned)) + held + damping * (v_ref - v)
    return tau + friction + _gravity(robot, arm, q, payload), _kept(memory, zeta, stiffness)


_joint_impedance.__name__, _cartesian_impedance.__name__ = "joint_impedance", "cartesian_impedance"


def _in_force(goal: Any, drawn: Any, settings: Any, memory: Any, dt: Any) -> tuple[Any, Any]:
    """Stiffness of each spring and damping ratio of this cycle, on their way from those of the cycle before.

    `drawn` is the energy of each spring over its stiffness.
    """
    import casadi

    n, started = goal.numel(), memory[STARTED] > 0.5
    share = 1.0 - casadi.exp(-dt / RAMP_S)
    before = memory[SIGNALS_AT : SIGNALS_AT + n]
    step = share * (goal - before)
    gained = casadi.sum1(casadi.fmax(step, 0.0) * drawn)
    slowed = casadi.fmin(1.0, settings[STIFFENING] * dt / casadi.fmax(gained, 1e-12))
    grown = before + casadi.fmin(step, 0.0) + slowed * casadi.fmax(step, 0.0)
    zeta = memory[0] + share * (settings[ZETA] - memory[0])
    return casadi.if_else(started, grown, goal), casadi.if_else(started, zeta, settings[ZETA])


def _kept(memory: Any, zeta: Any, stiffness: Any) -> Any:
    """The next memory."""
    import casadi

    last = SIGNALS_AT + stiffness.numel()
    return casadi.vertcat(zeta, 1.0, memory[STARTED + 1 : SIGNALS_AT], stiffness, memory[last:])


def _gravity(robot: Any, arm: Any, q: Any, payload: Any) -> Any:
    """Torques that carry the arm and its payload, on all joints."""
    import casadi

    from qrobot.codegen.load import payload_torque
    from qrobot.codegen.rigid_body import inverse_dynamics

    still, gravity = casadi.SX(robot.n, 1), robot.geometry.gravity_m_s2
    return inverse_dynamics(arm, q, still, still, gravity) + payload_torque(arm, q, still, still, gravity, payload)


def _tip(frame: tuple[Any, Any], reach: Any) -> tuple[Any, Any]:
    """Rotation and position of the tip, `reach` along z of the last frame."""
    turn, origin = frame
    return turn, origin + reach * turn[:, 2]


def _turning(turn: Any, q: Any) -> Any:
    """Angular velocity of the tool in the base frame for each joint's. Shape (3, n)."""
    import casadi

    columns = []
    for j in range(q.numel()):
        rate = casadi.reshape(casadi.jacobian(casadi.vec(turn), q[j]), 3, 3) @ turn.T
        columns.append(casadi.vertcat(rate[2, 1], rate[0, 2], rate[1, 0]))
    return casadi.horzcat(*columns)
