"""Put photos and twins side by side: a column per object, photo above what its MJCF looks like.

    python benchmarks/looks_figure.py --pictures FOLDER [--before FOLDER]

FOLDER holds the pictures that `looks.py --pictures` or `geometry.py --pictures` left, NAME.png:
photos above, twins below, three views of either state. With --before, twins of another commit stand
between the photo and the twin. Only objects that may be shown are: MIT, BSD and Apache licences.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
FIGURE = ROOT / "docs/looks.png"
# Free licences only, in the order of the columns; which of the six views shows it best.
SHOWN = {"libero_microwave": 3, "robosuite_door": 3, "sektion_cabinet": 3,
         "libero_wooden_cabinet": 3, "bigym_dishwasher": 3, "libero_short_cabinet": 3}
WIDTHS = range(260, 100, -20)  # pixels of a column, six fill a page; narrower until it is small
MARGIN = 6  # pixels of white around the object and between pictures
MOST = 400_000  # bytes of the file
Image8 = NDArray[np.uint8]


def main() -> int:
    """Write docs/looks.png."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pictures", type=Path, required=True, help="folder of NAME.png")
    parser.add_argument("--before", type=Path, help="the same of another commit")
    parser.add_argument("--out", type=Path, default=FIGURE)
    args = parser.parse_args()
    there = [name for name in SHOWN if (args.pictures / f"{name}.png").is_file()]
    if not there:
        sys.stderr.write(f"{args.pictures}: holds none of {', '.join(SHOWN)}. Expected NAME.png of "
                         "looks.py --pictures.\n")
        return 2
    for name in SHOWN:
        if name not in there:
            sys.stderr.write(f"{name}: no picture\n")
    folders = [args.pictures] if args.before is None else [args.before, args.pictures]
    size = save([column(name, folders) for name in there], args.out)
    sys.stdout.write(f"{args.out}: {len(there)} objects, {size / 1000:.0f} kB\n")
    return 0


def column(name: str, folders: list[Path]) -> list[Image8]:
    """Return the photo of an object and its twins, of one size; white where a twin is missing."""
    views = [view(folder / f"{name}.png", SHOWN[name]) for folder in folders]
    photo = next(v[0] for v in reversed(views) if v is not None)
    twins = [np.full_like(photo, 255) if v is None else v[1] for v in views]
    box = around([photo, *twins])
    return [picture[box] for picture in (photo, *twins)]


def view(path: Path, index: int) -> tuple[Image8, Image8] | None:
    """Return photo and twin of one view of a strip, None if there is no strip."""
    if not path.is_file():
        return None
    strip = np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR), np.uint8)
    size = strip.shape[0] // 2
    one = strip[:, index * size:(index + 1) * size]
    return one[:size], one[size:]


def around(pictures: list[Image8]) -> tuple[slice, slice]:
    """Return the square that holds what is not white on any picture."""
    used = np.any([(picture < 250).any(2) for picture in pictures], 0)
    if not used.any():
        used[:] = True
    ys, xs = np.nonzero(used)
    half = (max(np.ptp(ys), np.ptp(xs)) + 1) // 2 + MARGIN
    height, width = used.shape
    half = min(half, height // 2, width // 2)
    middle = [int(np.clip((v.min() + v.max()) // 2, half, n - half))
              for v, n in ((ys, height), (xs, width))]
    return tuple(slice(m - half, m + half) for m in middle)  # type: ignore[return-value]


def figure(columns: list[list[Image8]], width: int) -> Image8:
    """Return all columns side by side on white, square pictures as wide as told."""
    size, rows = (width, width), len(columns[0])
    whole = [n * (width + MARGIN) - MARGIN for n in (rows, len(columns))]
    out = np.full((*whole, 3), 255, np.uint8)
    for x, pictures in enumerate(columns):
        for y, picture in enumerate(pictures):
            top, left = y * (width + MARGIN), x * (width + MARGIN)
            out[top:top + width, left:left + width] = cv2.resize(picture, size,
                                                                 interpolation=cv2.INTER_AREA)
    return out


def save(columns: list[list[Image8]], path: Path) -> int:
    """Write a PNG of at most MOST bytes, as wide as that allows; return its bytes."""
    for width in WIDTHS:
        cv2.imwrite(str(path), figure(columns, width), [cv2.IMWRITE_PNG_COMPRESSION, 9])
        if path.stat().st_size <= MOST:
            break
    return path.stat().st_size


if __name__ == "__main__":
    sys.exit(main())
