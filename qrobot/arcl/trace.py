"""The lines of a program's traces, to the character as in Figure 5 of the paper (Corke & Kirkham, section 4).

    base : x:0.000 y:0.000 z:862.000 RPY r:0.000 p:-0.000 y:0.000
    request pos: t=0, traj=1, Ta=100, Tseg=0, Vt=10, Vr=10
    exec(stdtg) pos: t=0.34, stat=0, j Ta1=112, Ta2=112, Tseg=0, dT=56
    ami_offl: done at t=272.048

Millimetres and degrees; a request has its time in ms, an execution and the end in s. The figure prints a blank before a
time of execution of 100 s and more, and none before a shorter one.
"""

from __future__ import annotations

from qrobot.model.orientation import rpy_angles
from qrobot.motion import Equation, Trsf
from qrobot.units import DEG_PER_RAD, MM_PER_M

STANDARD_GENERATOR = "stdtg"


def trans_line(trsf: Trsf) -> str:
    """A transform as it was made. The pitch of the identity is -0: it is the arc tangent of minus n.z."""
    x, y, z = trsf.value[:3, 3] * MM_PER_M
    r, p, w = (angle * DEG_PER_RAD for angle in rpy_angles(trsf.value[:3, :3]))
    return f"{trsf.name} : x:{x:.3f} y:{y:.3f} z:{z:.3f} RPY r:{r:.3f} p:{p:.3f} y:{w:.3f}"


def equation_line(equation: Equation) -> str:
    """A position equation as it was made; its form is ours."""
    return f"{equation.name} : {equation!r}"


def request_line(
    name: str, t_ms: float, traj: int, ta_ms: float, tseg_ms: float, vt: float, vr: float, conf: str | None
) -> str:
    """A motion as the program asked for it."""
    configuration = "" if conf is None else f", conf={conf}"
    return (
        f"request {name}: t={t_ms:.0f}, traj={traj}, Ta={ta_ms:g}, Tseg={tseg_ms:g}, Vt={vt:g}, Vr={vr:g}"
        f"{configuration}"
    )


def exec_line(
    name: str, t_s: float, stat: int, letter: str, ta1_ms: float, ta2_ms: float, tseg_ms: float, dt_ms: float
) -> str:
    """The beginning of its execution: times in whole samples."""
    blank = " " if t_s >= 100.0 else ""
    times = f"{letter} Ta1={ta1_ms:g}, Ta2={ta2_ms:g}, Tseg={tseg_ms:g}, dT={dt_ms:g}"
    return f"exec({STANDARD_GENERATOR}) {name}: t={blank}{t_s:.2f}, stat={stat}, {times}"


def done_line(machine: str, t_s: float) -> str:
    """The end of a program."""
    return f"ami_{machine}: done at t={t_s:.3f}"
