"""What is tested here is no machine's speed."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def patient(patient_links: None) -> None:
    """See `patient_links`, for all tests here."""
