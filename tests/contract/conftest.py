"""What is tested here is no machine's speed."""

from __future__ import annotations

import pytest

from qrobot.rci import tcp
from tests.support.patience import PATIENCE_S


@pytest.fixture(autouse=True)
def patient_links(monkeypatch: pytest.MonkeyPatch) -> None:
    """The far end of a socket is a thread of ours, which may stall; who tests silence is less patient."""
    monkeypatch.setattr(tcp, "ANSWER_TIMEOUT_S", PATIENCE_S)
    monkeypatch.setattr(tcp, "LINGER_S", PATIENCE_S)
