"""One model during a run: its state, its clock and what its checkpoint holds of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ddgcli.simulation.model import Arrays, Ending, Model

ENDING_BYTES = 240  # of an ending in a checkpoint, whose arrays keep their shapes


@dataclass(eq=False)
class ActiveModel:
    """State of one model during a run."""

    name: str
    model: Model
    state: Any
    next_dt: float
    n_steps: int = 0
    n_rejected: int = 0
    n_frame_limited: int = 0  # adaptive steps that would pass the time of a frame
    smallest: float = math.inf
    ending: Ending | None = None
    divided: bool = False
    rescue_reported: bool = False
    allowed: float = math.inf  # longest part of the step under way that is tried
    shortest: float = math.inf  # taken of the step under way
    n_before: int = 0  # parts taken before the step under way
    reached: float = 0.0  # in steps
    report_progress: Callable[[], None] = field(default=lambda: None)

    def pack(self) -> Arrays:
        counts = self.n_rejected, self.n_frame_limited, self.divided, self.rescue_reported
        clock = np.array([self.next_dt, self.n_steps, self.smallest, *counts])
        return {"clock": clock, "stopped": packed_ending(self.ending), **self.model.pack(self.state)}

    def restore(self, arrays: Arrays) -> None:
        self.next_dt, n_steps, self.smallest, *counts, divided, reported = arrays["clock"].tolist()
        self.n_steps, (self.n_rejected, self.n_frame_limited) = int(n_steps), map(int, counts)
        self.divided, self.rescue_reported = bool(divided), bool(reported)
        self.ending = unpacked_ending(arrays["stopped"])
        self.state = self.model.unpack({k: v for k, v in arrays.items() if k not in ("clock", "stopped")})


def packed_ending(ending: Ending | None) -> NDArray[np.uint8]:
    """Bytes of an ending in a checkpoint: its kind and its text, a line each.

    Parameters
    ----------
    ending : Ending or None

    Returns
    -------
    (ENDING_BYTES,) ndarray of uint8
        Zero for None.
    """
    packed = np.zeros(ENDING_BYTES, dtype=np.uint8)
    if ending is not None:
        text = f"{ending.kind}\n{ending.text}".encode()[:ENDING_BYTES]
        packed[: len(text)] = np.frombuffer(text, dtype=np.uint8)
    return packed


def unpacked_ending(packed: NDArray) -> Ending | None:
    """Why a model ended its run, from its bytes in a checkpoint.

    Parameters
    ----------
    packed : (k,) ndarray of uint8

    Returns
    -------
    Ending or None
    """
    stored = np.asarray(packed, dtype=np.uint8).tobytes().rstrip(b"\0").decode(errors="ignore")
    kind, _, text = stored.rpartition("\n")
    return Ending(kind, text) if text else None
