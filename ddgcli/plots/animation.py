"""Animations of a motion as GIF or MP4."""

from __future__ import annotations

import importlib.util
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MissingExtraError, ParameterError
from ddgcli.plots.motion import PlotFrame, SequenceStyle, draw_frames

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

# frames per second; viewers slow shorter GIF frames down
MIN_RATE, MAX_RATE, MAX_GIF_RATE = 0.01, 1000.0, 50.0


def draw_animation(
    path: str,
    plot_frames: Iterable[PlotFrame],
    style: SequenceStyle,
    frames_per_second: float,
    size: tuple[int, int] | None = None,
    progress: Callable[[int], None] = lambda n_frames: None,
    jobs: int = 1,
) -> None:
    """Write a looping animated GIF or an MP4 (H.264).

    Parameters
    ----------
    path : str
        .gif or .mp4.
    plot_frames : iterable of PlotFrame
        One at least.
    style : SequenceStyle
    frames_per_second : float
    size : (int, int), optional
        Width and height in pixels; default 1280 x 960.
    progress : callable (n_frames) -> None
        Called after each frame with the number of frames so far.
    jobs : int
        Processes that draw.
    """
    across, down = size or (1280, 960)
    drawn = partial(_pictures, plot_frames, style, across, down, progress, jobs)
    if path.lower().endswith(".mp4"):
        pictures = (
            np.ascontiguousarray(np.asarray(picture.convert("RGB"))[:down, :across])
            for picture in drawn(None)
        )
        _write_mp4(path, pictures, frames_per_second, across, down)
        return
    first, *others = drawn((across, down))
    first.save(
        path, format="GIF", save_all=True, append_images=others, loop=0,
        duration=round(1000 / frames_per_second), optimize=False,
    )  # fmt: skip


def check_animation(path: str, size: tuple[int, int] | None, frames_per_second: float | None = None) -> None:
    """Raise an error for an animation that cannot be written.

    Parameters
    ----------
    path : str
        .gif or .mp4.
    size : (int, int) or None
        Width and height in pixels.
    frames_per_second : float, optional

    Raises
    ------
    MissingExtraError
        The package that writes the format is not installed.
    ParameterError
        A rate that the format does not allow, or an odd side of an .mp4.
    """
    most = MAX_RATE if path.lower().endswith(".mp4") else MAX_GIF_RATE
    if frames_per_second is not None and not MIN_RATE <= frames_per_second <= most:
        suffix = path[path.rindex(".") :]
        raise ParameterError(
            f"{frames_per_second:g}: a {suffix} shows {MIN_RATE:g} to {most:g} frames per second",
            parameter="fps",
        )
    if path.lower().endswith(".mp4"):
        if importlib.util.find_spec("imageio_ffmpeg") is None:
            raise MissingExtraError(f"{path}: .mp4 needs imageio-ffmpeg; pip install 'ddgcli[video]'")
        if size is not None and any(side % 2 for side in size):
            raise ParameterError("sides of an .mp4 are even numbers of pixels", parameter="size")
    elif importlib.util.find_spec("PIL") is None:
        raise MissingExtraError(f"{path}: animations need pillow; pip install 'ddgcli[plot]'")


def _pictures(
    plot_frames: Iterable[PlotFrame],
    style: SequenceStyle,
    across: int,
    down: int,
    progress: Callable[[int], None],
    jobs: int,
    palette_size: tuple[int, int] | None,
) -> Iterator[Picture]:
    """Picture of each frame, at least `across` by `down` pixels."""
    from PIL import Image

    page_size = {"width": 7.0, "height": 7.0 * down / across, "dpi": across / 7.0}
    with tempfile.TemporaryDirectory() as folder:
        files = draw_frames(plot_frames, style, folder, ".png", page_size, jobs, palette_size)
        for k, path in enumerate(files):
            picture = Image.open(path)
            picture.load()  # and close the file
            os.unlink(path)
            yield picture
            progress(k + 1)


def _write_mp4(path: str, pictures: Iterable[NDArray], rate: float, across: int, down: int) -> None:
    import imageio_ffmpeg

    # one thread and no dates, so that equal pictures give equal bytes
    exact = ["-threads", "1", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1"]
    writer = imageio_ffmpeg.write_frames(
        path, (across, down), fps=rate, codec="libx264", pix_fmt_out="yuv420p", quality=8,
        macro_block_size=2, output_params=[*exact, "-movflags", "+faststart"],
    )  # fmt: skip
    writer.send(None)
    try:
        for picture in pictures:
            writer.send(picture)
    finally:
        writer.close()
