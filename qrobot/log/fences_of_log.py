"""The fences that a log carries, so that films and pages show them where the run met them."""

from __future__ import annotations

from typing import Final

from pydantic import ValidationError

from qrobot.errors import LogError
from qrobot.fences.told_fences import ToldFences
from qrobot.log.header import Attachment
from qrobot.log.read import Log

ATTACHMENT: Final = "fences.json"


def fence_attachments(told: ToldFences | None) -> list[Attachment]:
    """Attachments of a log that carries these fences; none for an arm without."""
    if told is None:
        return []
    return [Attachment(ATTACHMENT, told.model_dump_json(indent=1).encode(), "application/json")]


def fences_of_log(log: Log) -> ToldFences | None:
    """The fences that were in force; None when the log tells none. Raises LogError when what it tells is damaged."""
    content = log.attachments.get(ATTACHMENT)
    if content is None:
        return None
    try:
        return ToldFences.model_validate_json(content)
    except ValidationError as error:
        raise LogError(f"{ATTACHMENT} in {log.path} is damaged: {error.errors()[0]['msg']}") from None
