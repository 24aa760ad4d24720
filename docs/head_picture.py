"""docs/head.png: a moment of the film that `examples/head --film` writes.

.venv/bin/python docs/head_picture.py out/head/film.gif
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image

if __name__ == "__main__":
    with Image.open(sys.argv[1]) as film:
        film.seek(film.n_frames - 10)  # the last turn of the hour, held
        film.convert("RGB").save(Path(__file__).with_name("head.png"))
