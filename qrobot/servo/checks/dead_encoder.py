"""Dead encoders: a joint that must have moved, by its torque or by its potentiometer, and shows no count.

A position loop whose counts have stopped sees its reference go away, and pushes. What its motor is given beyond the
load, u = tau - g(q), then passes every torque with which friction and load can hold a joint:

    -(B- + L + S |g|)  <=  u  <=  B+ + L + S |g|      a joint at rest: break-away B, unknown load L, torque scale S
    u  <=  u0 + 2 M |a_ref| + R + L s                 one that slid forwards, driven by u0, when its encoder last
                                                      counted, and whose reference has gone on that way ever since

with s the way of all references since, by which an unknown load may have turned. The second bound is the sharp one: a
sliding joint has just measured its own friction and load, so that only the rise R from sliding to break-away is open.
Both are wider, by W, while other joints accelerate: a mass matrix has M_jk^2 <= M_jj M_kk, so

    W_j = C sqrt(M_j) sum_(k != j) sqrt(M_k) |a_ref,k|

(accelerations count for as long as joints take to follow their references), and by what the heaviest load takes, at the
flange, to follow them. Past a bound the joint moves, at least by

    M dv/dt = excess        dx/dt = v

and no model that is wrong by a factor makes four counts into none. At rest nothing has been measured, and a slow joint
may be far by the time that u has passed B + L. So its potentiometer is asked. It hangs on the same motor by other
wires; while the counts stand it shows a quarter of a turn of a motor that is driven. Without a calibration table nobody
has said that it works, and it is heard before power and tried on the way, see `servo.checks.potentiometer_monitor`.

A joint that something holds fails the same way. Where its potentiometer still stands when the model is sure of half a
motor turn, both channels agree that it does: a brake that did not release, or something it presses on, which is no
fault as long as the unexplained torque is bounded. Without a potentiometer it is stopped as hard as for a dead
encoder, and gets that name.
"""

from __future__ import annotations

from typing import Final

from qrobot.realtime.jit import lean_kernel
from qrobot.servo.kernels.velocity import at_rest

SLID_COUNTS: Final = 10  # so far one way a joint has slid: backlash and presliding are behind it [A]
WRONG_INERTIA: Final = 2.0  # times that of the robot file [A]
LAG_S: Final = 0.05  # in which the joints follow their references [A]
BASE_SHARE: Final = 0.25  # of a new reading in the mean, where counts and potentiometer may go together
FAILED_TURNS: Final = 1.0  # from one reading to the next: no motor, but a potentiometer that has failed
FIRST_READINGS: Final = 4
GONE_TURNS: Final = 0.25  # of the motor, by its potentiometer: 37 units, of which noise and rounding are 7 (1 sigma)
SPREADS: Final = (
    2.0  # readings of an unknown potentiometer at rest lie within so many times less than shows a motor gone
)
TRIED_TURNS: Final = 2.0  # of the motor by its counts: a stretch on which a potentiometer is tried
TRIED_SHARE: Final = 0.5  # of it, that it may miss: slope, noise, and 0.3 turns of backlash


@lean_kernel
def lasting(peak: float, size: float, dt: float) -> float:
    """The larger of `size` and of an earlier `peak` that is forgotten with LAG_S, `dt` seconds later."""
    return at_rest(max(abs(size), peak * (1.0 - dt / LAG_S)))


@lean_kernel
def sliding_torque(torque: float, way: int, inertia: float, bend: float) -> float:
    """u0 + 2 M |a_ref| of a joint that goes the way of the sign of `way`, N m (N): what slides it, at most.

    The inertia may be twice that of the robot file, and the joint may be slowing down when its reference is not.
    """
    margin = WRONG_INERTIA * inertia * bend
    return torque + margin if way > 0 else torque - margin


@lean_kernel
def torque_bounds(
    slid: float, travel: int, going: bool,
    holds_up: float, holds_down: float, rise_up: float, rise_down: float, inertial: float, scale: float,
) -> tuple[float, float]:  # fmt: skip
    """(least, greatest) torque beyond the load with which a healthy joint may show no count, N m (N).

    Args:
        slid: see `sliding_torque`, when the encoder last counted. travel: counts since it turned round.
        going: the reference has gone on the same way ever since.
        holds_up, holds_down: what friction and unknown load may hold against upward and downward torque: B + L.
        rise_up, rise_down: from sliding to breaking away: R + L s. inertial: W. scale: S |g|.
    """
    least, greatest = -holds_down - scale, holds_up + scale
    if going and travel >= SLID_COUNTS:
        greatest = min(greatest, slid + rise_up)
    elif going and travel <= -SLID_COUNTS:
        least = max(least, slid - rise_down)
    return least - inertial, greatest + inertial


@lean_kernel
def predict_travel(
    torque: float, least: float, greatest: float, inertia: float, dt: float, v: float, x: float
) -> tuple[float, float]:
    """(v, x): how fast and how far a joint has moved for sure, carried on by `dt` seconds under `torque`.

    Within the bounds friction may hold it again: the speed is then not sure any more, the way is.
    """
    if torque > greatest:
        v += (torque - greatest) / inertia * dt
    elif torque < least:
        v += (torque - least) / inertia * dt
    else:
        v = 0.0
    return v, x + v * dt


@lean_kernel
def is_missing(x: float, counts: float, unit_per_count: float) -> bool:
    """True when so many counts were sure to come that did not."""
    return not abs(x) <= counts * unit_per_count


@lean_kernel
def follow_pot(
    residue: float, before: float, base: float, readings: int, free: bool, turn: float
) -> tuple[float, bool]:
    """(base, trusted) after a new reading of one potentiometer.

    Args:
        residue: reading less what the counts account for, ADC units. before: the one before. base: mean of those.
        readings: how many there were. free: counts may come, or nothing drives the motor. turn: units a motor turn.
    """
    if readings == 0:
        return residue, True
    if not abs(residue - before) <= FAILED_TURNS * turn:
        return base, False
    if readings < FIRST_READINGS:
        return base + (residue - base) / (readings + 1), True
    return base + BASE_SHARE * (residue - base) if free else base, True


@lean_kernel
def is_at_end(units: float, margin: float, track: float) -> bool:
    """True of a reading within `margin` of 0 or of `track`, ADC units: the motor may be anywhere beyond that end."""
    return units < margin or units > track - margin


@lean_kernel
def shown_residue(residue: float, counted: float, track: float) -> float:
    """Residue that a potentiometer shows whose track goes from 0 to `track`, ADC units: its own, or that of an end.

    Args:
        residue: reading less what the counts account for, on the track. counted: what they account for now.
    """
    units = residue + counted
    return residue + (min(max(units, 0.0), track) - units)


@lean_kernel
def gone_units(turn: float, spread: float, step: float) -> float:
    """Distance from its mean at which a potentiometer shows a motor that turns, ADC units.

    Args:
        turn: units a motor turn. spread: greatest less least reading at rest, 0 where its noise is known. step: of the
            converter, where one is more than noise.
    """
    return max(GONE_TURNS * turn, SPREADS * spread) + step


@lean_kernel
def has_followed(change: float, counts: float, counts_per_rev: float, turn: float) -> int:
    """Judge a potentiometer by a stretch of motion: 1 it goes with its encoder, -1 it does not, 0 too short.

    Args:
        change: of its reading less what the counts account for, ADC units. counts: of the stretch. turn: units a turn.
    """
    turns = abs(counts) / counts_per_rev
    if turns < TRIED_TURNS:
        return 0
    return 1 if abs(change) <= TRIED_SHARE * turns * turn else -1


@lean_kernel
def in_a_row(row: int, off: float, units: float) -> int:
    """Readings in a row that are `off` by more than `units` to one side, with the sign of that side."""
    if off > units:
        return max(row, 0) + 1
    if off < -units:
        return min(row, 0) - 1
    return 0
