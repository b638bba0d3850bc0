"""Typed values of the robot files: lists in TOML, read-only float64 arrays in Python; names, of all files.

How long a list must be and which of its entries are angles depends on the robot's joints, which reach the validators
as the validation context (`JointKinds`). Joint quantities in degrees (`JointDegrees`) are degrees on revolute joints
and metres on prismatic ones.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo

from qrobot.arrays import Bools, Floats, Ints
from qrobot.units import RAD_PER_DEG

ADC_CHANNELS = 8  # of the TRC004

# [A] wider than any arm needs: what is beyond was written in another unit, as millimetres and grams.
LONGEST_LINK_M = 30.0
WIDEST_LINK_M = 10.0  # radius of gyration
LONGEST_SLIDE_M = 200.0
HEAVIEST_LINK_KG = 20_000.0
STRONGEST_GRAVITY_M_S2 = 30.0


@dataclass(frozen=True)
class JointKinds:
    """Validation context: which joints are prismatic. Shape (n,)."""

    prismatic: Bools

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.prismatic.size


def _name(value: str) -> str:
    if re.fullmatch("[a-z][a-z0-9_]*", value) is None:
        raise ValueError(f"{value!r} is no name: small letters, digits and underscores make one, a letter first")
    return value


RobotName = Annotated[str, AfterValidator(_name)]
GivenName = Annotated[str, Field(max_length=32), AfterValidator(_name)]
MaybeGivenName = Annotated[str, Field(max_length=32), AfterValidator(lambda value: value and _name(value))]
"""A name, or none: ""."""


def _scale(value: float) -> float:
    if value == 0:
        raise ValueError("0 is no scale: all it reads, or shows, would be the same")
    return value


Scale = Annotated[float, Field(allow_inf_nan=False), AfterValidator(_scale)]
"""Units by units of something else: negative where one rises while the other falls."""


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, contiguous and read-only."""
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


def _array(value: Any, shape: tuple[int, ...], kinds: str, what: str) -> NDArray[Any]:
    """An array of that shape whose entries are of one of NumPy's `kinds`."""
    wanted = f"must be {' rows of '.join(str(size) for size in shape)} {what}"
    try:
        array = np.asarray(value)
    except ValueError as error:  # rows of unequal length
        raise ValueError(wanted) from error
    if array.dtype.kind not in kinds:
        raise ValueError(wanted)
    if array.shape != shape:
        raise ValueError(f"{wanted}, is {' x '.join(str(size) for size in array.shape) or 'one value'}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise ValueError("must be finite")
    return array


def _n(info: ValidationInfo) -> int:
    return _kinds(info).n


def _kinds(info: ValidationInfo) -> JointKinds:
    if not isinstance(info.context, JointKinds):
        raise TypeError("robot sections are validated with a JointKinds context")
    return info.context


def _numbers(*shape: int) -> Callable[[Any, ValidationInfo], Floats]:
    """Validator for float64 of shape (n, *shape)."""

    def validate(value: Any, info: ValidationInfo) -> Floats:
        return frozen(_array(value, (_n(info), *shape), "iuf", "numbers").astype(np.float64))

    return validate


def _one_or_numbers(value: Any, info: ValidationInfo) -> float | Floats:
    """One finite number for all joints, or float64 of shape (n,)."""
    if isinstance(value, list):
        return frozen(_array(value, (_n(info),), "iuf", "numbers").astype(np.float64))
    wanted = f"must be a finite number, or {_n(info)} numbers"
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(wanted)
    try:
        number = float(value)
    except OverflowError as error:
        raise ValueError(wanted) from error
    if not math.isfinite(number):
        raise ValueError(wanted)
    return number


def _degrees(value: Any, info: ValidationInfo) -> Floats:
    return frozen(_array(value, (_n(info),), "iuf", "numbers") * RAD_PER_DEG)


def _joint_degrees(value: Any, info: ValidationInfo) -> Floats:
    numbers = _array(value, (_n(info),), "iuf", "numbers")
    _within(numbers[_kinds(info).prismatic], LONGEST_SLIDE_M, "m (m/s) on sliding joints")
    return frozen(np.where(_kinds(info).prismatic, numbers, numbers * RAD_PER_DEG))


def _vector(value: Any) -> Floats:
    return frozen(_array(value, (3,), "iuf", "numbers").astype(np.float64))


def _within(numbers: Any, most: float, unit: str) -> Any:
    """The numbers themselves, or their number. Raises ValueError for one that is meant in another unit."""
    if (largest := float(np.abs(numbers).max(initial=0.0))) > most:
        raise ValueError(f"must be {unit}: {largest:g} is more than any arm has ({most:g})")
    return numbers


def _integers(value: Any, info: ValidationInfo) -> Ints:
    return frozen(_array(value, (_n(info),), "iu", "whole numbers").astype(np.int64))


def _flags(value: Any, info: ValidationInfo) -> Bools:
    return frozen(_array(value, (_n(info),), "b", "of true or false"))


def _coupling(value: Any, info: ValidationInfo) -> Floats:
    """C of r = C q, from the coefficients of its inverse: q_j = r_j - sum over i of k_ij r_i, as `{ k45 = 0.0139 }`."""
    n = _n(info)
    if not isinstance(value, dict):
        raise ValueError("must be a table of coefficients such as { k45 = 0.0139037 }")
    decoupling = np.eye(n)
    for key, k in value.items():
        motor, joint = _coupled(key, n)
        decoupling[joint, motor] = -float(_array(k, (), "iuf", "number"))
    if abs(np.linalg.det(decoupling)) < 1e-6:
        raise ValueError("the coupling cannot be inverted")
    return frozen(np.linalg.inv(decoupling))


def _coupled(key: str, n: int) -> tuple[int, int]:
    match = re.fullmatch(r"k([1-9])([1-9])", key)
    motor, joint = (int(digit) - 1 for digit in match.groups()) if match else (0, 0)
    if motor == joint or max(motor, joint) >= n:
        raise ValueError(f"{key!r} is not k<motor><joint> with two different joints of this robot")
    return motor, joint


def _positive(array: NDArray[Any]) -> NDArray[Any]:
    if not (array > 0).all():
        raise ValueError("every entry must be above zero")
    return array


def _not_negative(array: NDArray[Any]) -> NDArray[Any]:
    if not (array >= 0).all():
        raise ValueError("no entry may be below zero")
    return array


def _nonzero(array: NDArray[Any]) -> NDArray[Any]:
    if (array == 0).any():
        raise ValueError("no entry may be zero")
    return array


def _signs(array: Ints) -> Ints:
    if not (np.abs(array) == 1).all():
        raise ValueError("every entry must be 1 or -1")
    return array


def _channels(array: Ints) -> Ints:
    if not ((array >= 0) & (array < ADC_CHANNELS)).all() or np.unique(array).size != array.size:
        raise ValueError(f"must be different ADC channels, 0 to {ADC_CHANNELS - 1}")
    return array


PerJoint = Annotated[Floats, PlainValidator(_numbers())]
OneOrPerJoint = Annotated[float | Floats, PlainValidator(_one_or_numbers)]
PerJointPositive = Annotated[PerJoint, AfterValidator(_positive)]
PerJointNotNegative = Annotated[PerJoint, AfterValidator(_not_negative)]
PerJointNonzero = Annotated[PerJoint, AfterValidator(_nonzero)]
PerJointVectors = Annotated[Floats, PlainValidator(_numbers(3))]
_METRES = AfterValidator(partial(_within, most=LONGEST_LINK_M, unit="m"))
_KILOGRAMS = AfterValidator(partial(_within, most=HEAVIEST_LINK_KG, unit="kg"))
PerJointLengths = Annotated[PerJoint, _METRES]
PerJointPlaces = Annotated[PerJointVectors, _METRES]
PerJointMasses = Annotated[PerJointNotNegative, _KILOGRAMS]
LinkLength = Annotated[float, Field(allow_inf_nan=False), _METRES]
Mass = Annotated[float, Field(ge=0, allow_inf_nan=False), _KILOGRAMS]
PerJointInertia = Annotated[PerJointVectors, AfterValidator(_not_negative)]
PerJointInts = Annotated[Ints, PlainValidator(_integers)]
PerJointCounts = Annotated[PerJointInts, AfterValidator(_positive)]
PerJointSigns = Annotated[PerJointInts, AfterValidator(_signs)]
PerJointChannels = Annotated[PerJointInts, AfterValidator(_channels)]
PerJointFlags = Annotated[Bools, PlainValidator(_flags)]
Degrees = Annotated[Floats, PlainValidator(_degrees)]
JointDegrees = Annotated[Floats, PlainValidator(_joint_degrees)]
JointDegreesPositive = Annotated[JointDegrees, AfterValidator(_positive)]
_ACCELERATION = AfterValidator(partial(_within, most=STRONGEST_GRAVITY_M_S2, unit="m/s2"))
Gravity = Annotated[Floats, PlainValidator(_vector), _ACCELERATION]
Coupling = Annotated[Floats, PlainValidator(_coupling)]
ExchangePeriod = Annotated[float, Field(ge=0.2, le=100, allow_inf_nan=False)]  # ms between two images over a bus
