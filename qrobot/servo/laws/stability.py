"""Stability of an arm's position loops: gains against servo rate, delay, velocity estimator and inertia.

Around rest the feedback of every shipped law is the linear, sampled loop

    u_k = -Kp q_k - Kv v_k          torque, held for a period; it acts `delay` cycles after the positions it answers
    v_k                             the estimator's velocity, see `servo.kernels.velocity`
    M a = u                         the arm, with the mass matrix of a pose, with and without a load

whose poles are the eigenvalues of one matrix for each pose. Gains pass when, at every pose, all poles stay inside the
unit circle with both gains doubled (6 dB of gain margin), and each pole has at least the damping `LEAST_DAMPING` with
the gains as they are. The arm's own friction is left out: it damps, but nobody knows how much, and it changes.

Behind a gateway a cycle is an exchange, and its torque acts in the next exchange or in the one after that: what the
servo posts while an exchange is under way goes with the next one. Which of the two it is, the clocks of servo and
gateway decide. With the longer delay half the margin (3 dB) is enough.

A law of a user's own may do anything with its gains: it is not judged. The built-in law is, which takes over from it
when it fails.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.faultcodes import FaultCode
from qrobot.model.inertia import mass_matrices
from qrobot.servo.kernels.velocity import Estimator, find_estimator
from qrobot.servo.laws.impedance_feedback import maybe_feedback
from qrobot.servo.settings import ServoSettings

CFG_GAIN: Final = int(FaultCode.CFG_GAIN)
GAIN_MARGIN: Final = 2.0  # [A] 6 dB, the textbook's least
LATE_MARGIN: Final = (
    1.41  # [A] 3 dB, with the longest delay: doubled gains would take an exchange of 2 ms from the PUMA
)
LEAST_DAMPING: Final = 0.1  # [A] of each pole; less rings for more than three periods before it has halved
CALCULATION_CYCLES: Final = 1  # positions of one cycle are answered by the torque that acts in the next
LATEST_EXCHANGES: Final = 2  # those of one exchange by the torque that acts in the second one after it, at the latest
ON_THE_CIRCLE: Final = 1e-9  # rounding of an eigenvalue
MODEL_LAWS: Final = (
    "computed-torque",
    "adaptive",
)  # feedback by M(q)/M0: a joint then feels the inertia M0 at any pose
SEARCHED: Final = (1e-3, 1e9)  # gains among which allowed ones are looked for, N m/rad or N m s/rad
SEARCH_POINTS: Final = 61
INWARDS: Final = 1.15  # [A] what is proposed lies so far inside: the limits of a joint alone are not quite the arm's
TOLD_JOINTS: Final = 2  # with the gains they may have; the others by number


@dataclass(frozen=True)
class Loop:
    """Numbers of a servo that decide on stability.

    Attributes:
        period_s: of a cycle. delay: cycles from a position to the torque that answers it.
        observer: velocities come from the observer, not from the filtered difference.
        bandwidth: of the estimator, rad/s.
        inertia: M0 of the observer's model. Shape (n,).
        latest: the longest delay, where it may be longer; 0 where it may not.
    """

    period_s: float
    delay: int
    observer: bool
    bandwidth: float
    inertia: Floats
    latest: int = 0


def loop_of(robot: Robot, settings: ServoSettings) -> Loop:
    """The loop of a servo: its own cycle, or that of the exchanges with a board behind a gateway where it is longer."""
    observer = find_estimator(settings.velocity) is Estimator.OBSERVER
    control, period_s = robot.control, max(settings.period_ns * 1e-9, settings.exchange_ms * 1e-3)
    hertz = control.velocity_observer_hz if observer else control.velocity_filter_hz
    in_one_cycle = (LATEST_EXCHANGES + 1) * settings.exchange_ms * 1e-3 <= settings.period_ns * 1e-9
    latest = 0 if in_one_cycle else LATEST_EXCHANGES
    return Loop(period_s, CALCULATION_CYCLES, observer, 2.0 * np.pi * hertz, np.array(control.inertia), latest)


def transitions(inertia: Floats, loop: Loop, kp: Floats, kv: Floats) -> Floats:
    """The matrices that lead the closed loop from one cycle to the next, one for each mass matrix (m, n, n).

    The gains are those of each joint (n,), or a matrix for each mass matrix (m, n, n).

    States, n of each: position, velocity, the estimator's one or three, the torques of the cycles before, newest first.
    """
    m, n, T = *inertia.shape[:2], loop.period_s
    stiffness, damping = _by_pose(kp, m), _by_pose(kv, m)
    estimator = _observer(loop) if loop.observer else _difference(loop)
    last = 1 + len(estimator)
    states = last + max(loop.delay, 1)
    of_torque = np.zeros((m, states, n, n))  # row of u, a block for each state
    of_torque[:, : last + 1] = np.stack([-damping @ block for block in estimator[0]], axis=1)
    of_torque[:, 0] -= stiffness
    acting = np.zeros_like(of_torque) if loop.delay else of_torque.copy()
    if loop.delay:
        acting[:, -1] = np.eye(n)
    pushed = np.linalg.inv(inertia)[:, None] @ acting  # (m, states, n, n)
    blocks = np.zeros((m, states, states, n, n))
    blocks[:, 0], blocks[:, 1] = 0.5 * T * T * pushed, T * pushed
    blocks[:, 0, 0] += np.eye(n)
    blocks[:, 0, 1] += T * np.eye(n)
    blocks[:, 1, 1] += np.eye(n)
    blocks[:, 2:last, : last + 1], blocks[:, last] = estimator[1:], of_torque
    for older in range(last + 1, states):
        blocks[:, older, older - 1] = np.eye(n)
    return np.asarray(blocks.transpose(0, 1, 3, 2, 4).reshape(m, states * n, states * n))


def _by_pose(gains: Floats, m: int) -> Floats:
    """Gains of each joint (n,), or of each pose (m, n, n), as the latter."""
    matrices = np.diag(gains) if gains.ndim == 1 else gains
    return np.broadcast_to(matrices, (m, *matrices.shape[-2:]))


def _difference(loop: Loop) -> Floats:
    """Rows of velocity v and memory w, a block for each state: v = w + share q/T, w' = (1 - share) v - share q/T.

    Shape (2, 4, n, n).
    """
    share, eye = 1.0 - np.exp(-loop.bandwidth * loop.period_s), np.eye(loop.inertia.size)
    rows = np.zeros((2, 4, *eye.shape))
    rows[0, 0], rows[0, 2] = share / loop.period_s * eye, eye
    rows[1] = (1.0 - share) * rows[0]
    rows[1, 0] -= share / loop.period_s * eye
    return rows


def _observer(loop: Loop) -> Floats:
    """Rows of the velocity and of the memories x, v, d of `servo.kernels.velocity.observe`. Shape (4, 6, n, n)."""
    T, z, eye = loop.period_s, float(np.exp(-loop.bandwidth * loop.period_s)), np.eye(loop.inertia.size)
    to_v, to_d = 1.5 * (1.0 - z) ** 2 * (1.0 + z) / T, (1.0 - z) ** 3 / T**2
    of_q, of_x, of_v, of_d, of_push = np.zeros((5, 6, *eye.shape))
    of_q[0] = of_x[2] = of_v[3] = of_d[4] = eye
    of_push[5] = np.diag(1.0 / loop.inertia)  # by the torque of the cycle before
    a = of_push + of_d
    residual = of_q - (of_x + T * (of_v + 0.5 * T * a))
    x, v, d = of_q - z**3 * residual, of_v + T * a + to_v * residual, of_d + to_d * residual
    return np.stack((v, x, v, d))


def spectral_radius(inertia: Floats, loop: Loop, kp: Floats, kv: Floats) -> float:
    """The largest pole over all mass matrices (m, n, n); below 1 the loop is stable."""
    return float(np.abs(np.linalg.eigvals(transitions(inertia, loop, kp, kv))).max())


def least_damping(inertia: Floats, loop: Loop, kp: Floats, kv: Floats) -> float:
    """The smallest damping ratio of a pole over all mass matrices (m, n, n); below 0 it grows."""
    return float(damping_of(np.linalg.eigvals(transitions(inertia, loop, kp, kv))).min())


def damping_of(poles: Any) -> Floats:
    """Damping ratio of poles z = exp(s T): -Re s / |s|; 1 for a pole at rest on the circle, at z = 1."""
    at_rest = np.abs(poles - 1.0) <= ON_THE_CIRCLE
    s = np.log(np.where(at_rest | (poles == 0.0), 0.5, poles).astype(np.complex128))
    return np.asarray(np.where(at_rest, 1.0, -s.real / np.abs(s)))


def are_sound(inertia: Floats, loop: Loop, kp: Floats, kv: Floats) -> bool:
    """True when gains keep all margins with every mass matrix (m, n, n). No number is no gain."""
    if not (np.isfinite(kp).all() and np.isfinite(kv).all()):
        return False
    if kp.ndim == 1 and not ((kp >= 0.0).all() and (kv > 0.0).all()):
        return False
    if not least_damping(inertia, loop, kp, kv) >= LEAST_DAMPING:
        return False
    late = replace(loop, delay=max(loop.delay, loop.latest))
    return _bears(inertia, loop, GAIN_MARGIN, kp, kv) and (
        late.delay == loop.delay or _bears(inertia, late, LATE_MARGIN, kp, kv)
    )


def _bears(inertia: Floats, loop: Loop, factor: float, kp: Floats, kv: Floats) -> bool:
    """True when all poles stay inside the unit circle with both gains so many times as large."""
    return spectral_radius(inertia, loop, factor * kp, factor * kv) <= 1.0 + ON_THE_CIRCLE


def check_gains(
    robot: Robot,
    settings: ServoSettings,
    law: str | None = None,
    gains: Floats | None = None,
    chosen: Mapping[str, float] | None = None,
) -> None:
    """Refuse gains that are not stable with margin at the servo's rate, unless somebody has signed for them.

    Args:
        robot: whose inertia counts, and whose gains do unless `gains` (3, n) are given.
        law: in force, the settings' own when left out.
        chosen: settings of that law, by name; those of the settings when `law` is left out.

    Raises:
        ConfigError: names the joint, the gains it may have, and what to do.
    """
    if settings.unchecked_gains or settings.position_drives:
        return
    kp, kv, m0 = (robot.control.kp, robot.control.kv, robot.control.inertia) if gains is None else gains
    law, chosen = (settings.law, settings.law_settings) if law is None else (law, chosen or {})
    loop, inertia = loop_of(robot, settings), _felt_inertia(robot, law, m0)
    if not are_sound(inertia, loop, kp, kv):  # of an impedance, too: they are those of the law that replaces one
        raise ConfigError(_refusal(robot, inertia, loop, kp, kv))
    feedback = maybe_feedback(robot, law, chosen, np.array([kp, kv, m0]))
    if feedback is not None and not are_sound(inertia, loop, *feedback):
        raise ConfigError(
            f"{FaultCode(CFG_GAIN).name}: law {law} with these settings is not stable with margin in cycles of "
            f"{loop.period_s * 1e3:g} ms: choose less stiffness or another damping_ratio, raise rate_hz, or sign for "
            "them with unchecked_gains = true in [arm.servo]"
        )


def _felt_inertia(robot: Robot, law: str, m0: Floats) -> Floats:
    """The arm's mass matrices, and M0 by itself under a law that makes of every joint that inertia."""
    matrices = mass_matrices(robot)
    if law not in MODEL_LAWS:
        return matrices
    if not (m0 > 0.0).all():
        raise ConfigError(
            f"{FaultCode(CFG_GAIN).name}: law {law} divides by the inertia of each joint: it must be above 0"
        )
    return np.concatenate((matrices, np.diag(m0)[None]))


def _refusal(robot: Robot, inertia: Floats, loop: Loop, kp: Floats, kv: Floats) -> str:
    alone = [inertia_alone(inertia, j) for j in range(robot.n)]
    joints = [_of_joint(loop, j) for j in range(robot.n)]
    guilty = [j for j in range(robot.n) if not are_sound(alone[j], joints[j], kp[[j]], kv[[j]])]
    told = [_joint_refusal(robot, j, alone[j], joints[j], float(kp[j]), float(kv[j])) for j in guilty[:TOLD_JOINTS]] + [
        f"joint {j + 1} likewise" for j in guilty[TOLD_JOINTS:]
    ]
    whole = "each joint is stable alone, but they are coupled, and not stable together: lower Kp of the wrist"
    return (
        f"{FaultCode(CFG_GAIN).name}: gains are not stable with margin in cycles of {loop.period_s * 1e3:g} ms: "
        f"{'; '.join(told) or whole}. Choose such gains ([control] of the robot file, `qrobot ctl gains`), raise "
        "rate_hz, or sign for yours with unchecked_gains = true in [arm.servo]"
    )


def _joint_refusal(robot: Robot, j: int, inertia: Floats, loop: Loop, kp: float, kv: float) -> str:
    of_kp = allowed_range(lambda value: are_sound(inertia, loop, np.array([value]), np.array([kv])))
    of_kv = allowed_range(lambda value: are_sound(inertia, loop, np.array([kp]), np.array([value])))
    of_both = allowed_range(lambda f: are_sound(inertia, loop, np.array([kp * f * f]), np.array([kv * f])))
    allowed = [f"Kp up to {of_kp[1] / INWARDS:.3g} with this Kv"] if of_kp else []
    allowed += [f"Kv {of_kv[0] * INWARDS:.3g} to {of_kv[1] / INWARDS:.3g} with this Kp"] if of_kv else []
    if of_both and not allowed:
        f = of_both[1] / INWARDS
        allowed = [f"for example Kp {kp * f * f:.3g} with Kv {kv * f:.3g}"]
    hint = ", or ".join(allowed) or "no Kp with this Kv and no Kv with this Kp"
    return f"joint {j + 1} ({robot.joint_names[j]}) has Kp {kp:g} and Kv {kv:g}, allowed are {hint}"


def inertia_alone(inertia: Floats, j: int) -> Floats:
    """Inertia of joint `j` of mass matrices (m, n, n): from the least, other joints free, to the most. Shape (5, 1, 1).

    With other joints held fast it feels M_jj, with all of them free 1 / (M^-1)_jj, and something between in a loop.
    """
    free, fast = 1.0 / np.linalg.inv(inertia)[:, j, j], inertia[:, j, j]
    return np.geomspace(free.min(), fast.max(), 5).reshape(5, 1, 1)


def _of_joint(loop: Loop, j: int) -> Loop:
    return replace(loop, inertia=loop.inertia[[j]])


def allowed_range(is_sound: Callable[[float], bool]) -> tuple[float, float] | None:
    """Ends of the widest range of a gain that is sound throughout, within `SEARCHED`; None when there is none."""
    tried = np.geomspace(*SEARCHED, SEARCH_POINTS)
    runs = [list(run) for sound, run in groupby(tried.tolist(), is_sound) if sound]
    if not runs:
        return None
    widest = max(runs, key=len)
    step = tried[1] / tried[0]
    return _edge(is_sound, widest[0], widest[0] / step), _edge(is_sound, widest[-1], widest[-1] * step)


def _edge(is_sound: Callable[[float], bool], sound: float, unsound: float) -> float:
    """The last sound gain between one that is and one that is not, to a thousandth of their distance."""
    for _ in range(10):
        middle = float(np.sqrt(sound * unsound))
        sound, unsound = (middle, unsound) if is_sound(middle) else (sound, middle)
    return sound
