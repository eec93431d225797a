"""Animations of a motion as GIF or MP4."""

from __future__ import annotations

import importlib.util
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ddgcli.errors import MissingExtraError, ParameterError
from ddgcli.plots.motion import PlotFrame, SequenceStyle, draw_frames
from ddgcli.plots.page import RAW

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
    pictures = _pictures(plot_frames, style, across, down, progress, jobs)
    if path.lower().endswith(".mp4"):
        _write_mp4(path, pictures, frames_per_second, across, down)
        return
    first, *others = (_in_256_colours(picture) for picture in pictures)
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
) -> Iterator[NDArray[np.uint8]]:
    """(down, across, 3) picture of each frame."""
    page_size = {"width": 7.0, "height": 7.0 * down / across, "dpi": across / 7.0}
    with tempfile.TemporaryDirectory() as folder:
        files = draw_frames(plot_frames, style, folder, RAW, page_size, jobs)
        for k, path in enumerate(files):
            pixels = np.fromfile(path, dtype=np.uint8).reshape(down, across, 4)
            os.unlink(path)
            yield np.ascontiguousarray(pixels[..., :3])
            progress(k + 1)


def _in_256_colours(pixels: NDArray[np.uint8]) -> Picture:
    """Picture in the colours of a median cut of every sixteenth pixel, which takes a tenth of that of all."""
    from PIL import Image
    from scipy.spatial import KDTree

    palette = Image.fromarray(pixels[::4, ::4].copy()).quantize(256).getpalette() or []
    colours = np.array(palette).reshape(-1, 3)
    red, green, blue = (pixels[..., k] >> 1 for k in range(3))
    shade = (red.astype(np.int32) << 14) | (green.astype(np.int32) << 7) | blue  # of 128 a channel
    is_used = np.zeros(1 << 21, dtype=bool)
    is_used[shade.ravel()] = True
    used = np.flatnonzero(is_used)
    centres = np.stack([used >> 14, (used >> 7) & 127, used & 127], axis=1) * 2 + 0.5
    number = np.zeros(len(is_used), dtype=np.uint8)
    number[used] = KDTree(colours).query(centres)[1]
    picture = Image.fromarray(number[shade])
    picture.putpalette(palette)
    return picture


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
