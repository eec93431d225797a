"""One model during a run: its state, its clock and what its checkpoint holds of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.simulation.model import Arrays, Model

STOP_REASON_BYTES = 240  # of the reason to stop in a checkpoint, whose arrays keep their shapes


@dataclass(eq=False)
class ActiveModel:
    """State of one model during a run."""

    name: str
    model: Model
    state: Any
    next_dt: float
    n_steps: int = 0
    n_rejected: int = 0
    smallest: float = math.inf
    stopped: str = ""
    divided: bool = False
    rescue_reported: bool = False
    allowed: float = math.inf  # longest part of the step under way that is tried
    shortest: float = math.inf  # taken of the step under way
    n_before: int = 0  # parts taken before the step under way
    reached: float = 0.0  # in steps
    report_progress: Callable[[], None] = field(default=lambda: None)

    def pack(self) -> Arrays:
        clock = np.array([self.next_dt, self.n_steps, self.smallest, self.n_rejected])
        reason = np.zeros(STOP_REASON_BYTES, dtype=np.uint8)
        text = self.stopped.encode()[:STOP_REASON_BYTES]
        reason[: len(text)] = np.frombuffer(text, dtype=np.uint8)
        return {"clock": clock, "stopped": reason, **self.model.pack(self.state)}

    def restore(self, arrays: Arrays) -> None:
        self.next_dt, n_steps, self.smallest, n_rejected = arrays["clock"].tolist()
        self.n_steps, self.n_rejected = int(n_steps), int(n_rejected)
        self.divided = self.rescue_reported = True
        self.stopped = reason_text(arrays["stopped"])
        self.state = self.model.unpack({k: v for k, v in arrays.items() if k not in ("clock", "stopped")})


def reason_text(packed: NDArray) -> str:
    """Why a model stopped, from its bytes in a checkpoint.

    Parameters
    ----------
    packed : (k,) ndarray of uint8

    Returns
    -------
    str
    """
    return np.asarray(packed, dtype=np.uint8).tobytes().rstrip(b"\0").decode(errors="ignore")
