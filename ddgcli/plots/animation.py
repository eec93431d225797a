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
from ddgcli.plots.page import RAW

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

# frames per second; viewers slow shorter GIF frames down
MIN_RATE, MAX_RATE, MAX_GIF_RATE = 0.01, 1000.0, 50.0
SHADES_PER_BLOCK = 4096  # of a picture, whose nearest colours are searched at once


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
    is_mp4 = path.lower().endswith(".mp4")
    finish = None if is_mp4 else partial(_reduce_colours, across=across, down=down)
    pixels = _pixels(plot_frames, style, across, down, progress, jobs, finish)
    if is_mp4:
        pictures = (np.ascontiguousarray(p.reshape(down, across, 4)[..., :3]) for p in pixels)
        _write_mp4(path, pictures, frames_per_second, across, down)
        return
    first, *others = (_indexed_picture(p, across, down) for p in pixels)
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
            parameter="frames_per_second",
        )
    if path.lower().endswith(".mp4"):
        if importlib.util.find_spec("imageio_ffmpeg") is None:
            raise MissingExtraError(f"{path}: .mp4 needs imageio-ffmpeg; pip install 'ddgcli[video]'")
        if size is not None and any(side % 2 for side in size):
            raise ParameterError("sides of an .mp4 are even numbers of pixels", parameter="size")
    elif importlib.util.find_spec("PIL") is None:
        raise MissingExtraError(f"{path}: animations need pillow; pip install 'ddgcli[plot]'")


def _pixels(
    plot_frames: Iterable[PlotFrame],
    style: SequenceStyle,
    across: int,
    down: int,
    progress: Callable[[int], None],
    jobs: int,
    finish: Callable[[str], None] | None,
) -> Iterator[NDArray[np.uint8]]:
    """Bytes of the file of each frame: four a pixel, or what `finish` wrote."""
    page_size = {"width": 7.0, "height": 7.0 * down / across, "dpi": across / 7.0}
    with tempfile.TemporaryDirectory() as folder:
        files = draw_frames(plot_frames, style, folder, RAW, page_size, jobs, finish)
        for k, path in enumerate(files):
            pixels = np.fromfile(path, dtype=np.uint8)
            os.unlink(path)
            yield pixels
            progress(k + 1)


def _reduce_colours(path: str, across: int, down: int) -> None:
    """Replace the pixels in a file by 256 colours and the colour index of each pixel."""
    pixels = np.fromfile(path, dtype=np.uint8).reshape(down, across, 4)
    palette, number = in_256_colours(pixels[..., :3])
    np.concatenate([palette.ravel(), number.ravel()]).tofile(path)


def in_256_colours(pixels: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Palette of a picture: a median cut of every sixteenth pixel, which takes a tenth of that of all.

    Parameters
    ----------
    pixels : (h, w, 3) ndarray of uint8

    Returns
    -------
    palette : (256, 3) ndarray of uint8
    number : (h, w) ndarray of uint8
        Index of the colour of each pixel.
    """
    from PIL import Image

    colours = Image.fromarray(pixels[::4, ::4].copy()).quantize(256).getpalette() or []
    palette = np.zeros((256, 3), dtype=np.uint8)
    palette.ravel()[: len(colours)] = colours
    red, green, blue = (pixels[..., k] >> 1 for k in range(3))
    shade = (red.astype(np.int32) << 14) | (green.astype(np.int32) << 7) | blue  # of 128 a channel
    is_used = np.zeros(1 << 21, dtype=bool)
    is_used[shade.ravel()] = True
    used = np.flatnonzero(is_used)
    number = np.zeros(len(is_used), dtype=np.uint8)
    for block in np.array_split(used, 1 + len(used) // SHADES_PER_BLOCK):
        centre = np.stack([block >> 14, (block >> 7) & 127, block & 127], axis=1) * 4 + 1
        number[block] = _nearest(centre, 2 * palette[: len(colours) // 3].astype(np.int64))
    return palette, number[shade]


def _nearest(point: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.int64]:
    """Index of the nearest of some other points for each point; in integers, so that ties are exact."""
    return np.argmin((others * others).sum(axis=1) - 2 * (point @ others.T), axis=1)


def _indexed_picture(pixels: NDArray[np.uint8], across: int, down: int) -> Picture:
    """Picture of the bytes that `_reduce_colours` wrote."""
    from PIL import Image

    palette, number = np.split(pixels, [3 * 256])
    picture = Image.fromarray(number.reshape(down, across))
    picture.putpalette(palette.tobytes())
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
