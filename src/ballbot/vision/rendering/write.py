"""Writing a test video with a real codec."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError

#: fourcc by suffix: lossless, and the two lossy codecs that every build of OpenCV can write
LOSSLESS, MPEG4, MOTION_JPEG = "HFYU", "mp4v", "MJPG"


def write_video(
    path: str | Path, frames: Iterable[NDArray[np.uint8]], *, frame_rate: float, codec: str = LOSSLESS
) -> int:
    """Write frames (height, width, 3) as a video, whole or not at all, and return how many they were.

    Parameters
    ----------
    path : str or Path
        .avi for HFYU and MJPG, .mp4 for mp4v.
    frames : iterable of ndarray
    frame_rate : float
        [Hz]
    codec : str
        A fourcc.

    Raises
    ------
    InputError
        Where OpenCV cannot write such a file.
    """
    path = Path(path)
    partial = path.with_name(f".{path.stem}.part{path.suffix}")
    count = 0
    try:
        writer: cv2.VideoWriter | None = None
        for frame in frames:
            if writer is None:
                size = (frame.shape[1], frame.shape[0])
                writer = cv2.VideoWriter(str(partial), cv2.VideoWriter.fourcc(*codec), frame_rate, size)
                if not writer.isOpened():
                    raise InputError(f"{path} cannot be written with the codec {codec}.")
            writer.write(frame)
            count += 1
        if writer is not None:
            writer.release()
            partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return count
