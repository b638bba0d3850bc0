"""Messages of a page, one JSON object a message. What is not exactly one of these is refused and changes nothing."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field, TypeAdapter, ValidationError

from qrobot.errors import RemoteProtocolError
from qrobot.pendant.board_messages import PageBoardForce, PageBoardInject, PageBoardRepair
from qrobot.pendant.held_press import PressTarget
from qrobot.pendant.load_messages import BackMm, PageCollision, PageLoad
from qrobot.pendant.page_message import ArmNumber, MovingMessage, PageMessage
from qrobot.pendant.procedure_messages import PageProcedureEnd, PageProcedureKeep, PageProcedureStart
from qrobot.pendant.program_messages import PageProgramEnd, PageProgramInterrupt, PageProgramSay, PageProgramStart
from qrobot.wire.vocabulary import LARGEST_OVERRIDE

MOST_SHARE: Final = 4.0  # of the speeds at which jogging begins, as `qrobot jog` has it
MOST_STEP: Final = 100.0  # [A] mm or degrees; rad or m of a joint are far below
MOST_BYTES: Final = 4096  # of a message
PressNumber = Annotated[int, Field(ge=1, le=2**53)]
PlaceName = Annotated[str, Field(min_length=1, max_length=40)]
PlaceNumber = Annotated[float, Field(ge=-100_000, le=100_000, allow_inf_nan=False, strict=False)]


class PageAlive(PageMessage):
    """The page is awake; said each second."""

    do: Literal["alive"]


class PageStop(PageMessage):
    """Stop every arm. Any page may."""

    do: Literal["stop"]


class PageTake(PageMessage):
    """Drive an arm from this page."""

    do: Literal["take"]
    arm: ArmNumber


class PageGive(PageMessage):
    """Drive an arm no longer."""

    do: Literal["give"]
    arm: ArmNumber


class PageAct(MovingMessage):
    """A request that needs no session, see `servo_requests.ACTIONS`."""

    do: Literal["act"]
    arm: ArmNumber
    name: Literal["power on", "power off", "clear", "calibrate", "tare", "pause", "resume"]


class PageOverride(MovingMessage):
    """Speed override of motions under way, 1 for the speed as programmed."""

    do: Literal["override"]
    arm: ArmNumber
    factor: float = Field(ge=0, le=LARGEST_OVERRIDE, allow_inf_nan=False, strict=False)


class PageCommand(MovingMessage):
    """Take an arm under command, with `guide` to lead it by hand, or end it.

    Attributes:
        back_mm: how far a jogged arm goes back from what it met, 0 for not at all.
    """

    do: Literal["command"]
    arm: ArmNumber
    on: bool
    guide: bool = False
    back_mm: BackMm = 0.0


class PageLed(PageMessage):
    """Write what the arm was led through, smoothed within `smooth_mm` (0 for as it was), or forget it."""

    do: Literal["led"]
    arm: ArmNumber
    keep: bool
    smooth_mm: float = Field(default=0.0, ge=0, le=MOST_STEP, allow_inf_nan=False, strict=False)


class PagePressed(MovingMessage):
    """A button that moves the arm was pressed, see `held_press.Press`."""

    do: Literal["press"]
    arm: ArmNumber
    number: PressNumber
    target: PressTarget
    name: PlaceName
    way: Literal[-1, 1] = 1
    in_base: bool = True
    frame: str = Field(default="", max_length=40)
    share: float = Field(default=1.0, gt=0, le=MOST_SHARE, allow_inf_nan=False, strict=False)
    step: float = Field(default=0.0, ge=0, le=MOST_STEP, allow_inf_nan=False, strict=False)


class PageBeat(MovingMessage):
    """The button of a press is still held."""

    do: Literal["beat"]
    arm: ArmNumber
    number: PressNumber


class PageRelease(PageMessage):
    """The button that was held is let go."""

    do: Literal["release"]


class PageHand(MovingMessage):
    """Open or close the hand."""

    do: Literal["hand"]
    arm: ArmNumber
    opened: bool


class PageRecord(PageMessage):
    """Put where the arm is under a name."""

    do: Literal["record"]
    arm: ArmNumber
    name: PlaceName


class PageRemove(PageMessage):
    """Strike a taught place out."""

    do: Literal["remove"]
    arm: ArmNumber
    name: PlaceName


class PagePlace(PageMessage):
    """Put a place under a name by its numbers: x, y, z in mm, roll, pitch, yaw in degrees, in the base.

    Attributes:
        instead: name that is given up for it, "" for none.
    """

    do: Literal["place"]
    arm: ArmNumber
    name: PlaceName
    numbers: tuple[PlaceNumber, PlaceNumber, PlaceNumber, PlaceNumber, PlaceNumber, PlaceNumber] = Field(strict=False)
    instead: str = Field(default="", max_length=40)


AnyMessage = Annotated[
    PageAlive
    | PageStop
    | PageTake
    | PageGive
    | PageAct
    | PageOverride
    | PageCommand
    | PageLed
    | PagePressed
    | PageBeat
    | PageRelease
    | PageHand
    | PageRecord
    | PageRemove
    | PagePlace
    | PageLoad
    | PageCollision
    | PageProgramStart
    | PageProgramEnd
    | PageProgramInterrupt
    | PageProgramSay
    | PageBoardForce
    | PageBoardInject
    | PageBoardRepair
    | PageProcedureStart
    | PageProcedureEnd
    | PageProcedureKeep,
    Field(discriminator="do"),
]
_MESSAGE: Final[TypeAdapter[AnyMessage]] = TypeAdapter(AnyMessage)


def decode_message(text: str) -> AnyMessage:
    """A message of a page. Raises RemoteProtocolError: it is none."""
    if len(text) > MOST_BYTES:
        raise RemoteProtocolError(f"a message of a page has at most {MOST_BYTES} characters")
    try:
        return _MESSAGE.validate_json(text)
    except ValidationError as error:
        raise RemoteProtocolError(f"no message of a page: {error.errors()[0]['msg']}") from None
