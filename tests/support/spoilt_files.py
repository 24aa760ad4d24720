"""Valid logs of every format that `ecm import` reads, and spoilt copies of their bytes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
from scipy.io import savemat

from support.neck import csv_text, neck_columns
from support.ros import stamped, typestore

ROWS = 24


def _columns() -> dict[str, np.ndarray]:
    return neck_columns(ROWS) | {"time_s": 0.7 * np.arange(ROWS)}


def _bag(folder: Path, name: str) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: PLC0415 - of the extra logs

    plugin = StoragePlugin.MCAP if name.endswith("mcap") else StoragePlugin.SQLITE3
    with Writer(folder / f"{name}-bag", version=9, storage_plugin=plugin) as bag:
        kind = "geometry_msgs/msg/WrenchStamped"
        connection = bag.add_connection("/ft", kind, typestore=typestore())
        for i in range(ROWS):
            wrench = [float(i), 0.0, 0.0, 0.1 * i, 0.0, 0.0]
            bag.write(connection, 10**9 + i * 10**8, stamped(1000 + 100 * i, wrench))
    return next((folder / f"{name}-bag").glob(f"*{Path(name).suffix}"))


def good_logs(folder: Path) -> dict[str, bytes]:
    """Bytes of a small valid log by file name: one of each format, and their variants."""
    columns, logs = _columns(), {}
    frame = pd.DataFrame(columns)
    savemat(folder / "plain.mat", columns)
    savemat(folder / "packed.mat", {"log": columns}, do_compression=True)
    savemat(folder / "four.mat", columns, format="4")
    for name, before, packing in (
        ("log.h5", 0, None), ("packed.h5", 0, "gzip"), ("v73.mat", 512, None)
    ):  # fmt: skip
        with h5py.File(folder / name, "w", userblock_size=before) as file:
            for key, values in columns.items():
                file.create_dataset(key, data=values, compression=packing)
    np.savez(folder / "log.npz", **columns)
    np.savez_compressed(folder / "packed.npz", **columns)
    np.save(folder / "log.npy", frame.to_records(index=False))
    np.save(folder / "bare.npy", frame.to_numpy())
    frame.to_parquet(folder / "log.parquet")
    frame.to_parquet(folder / "plain.parquet", compression=None)
    (folder / "log.csv").write_text(csv_text(columns), encoding="utf-8")
    (folder / "tabs.txt").write_text(csv_text(columns).replace(",", "\t"), encoding="utf-16")
    for name in ("log.db3", "log.mcap"):
        (folder / name).write_bytes(_bag(folder, name).read_bytes())
    for path in sorted(folder.iterdir()):
        if path.is_file():
            logs[path.name] = path.read_bytes()
    return logs


def spoilt(content: bytes, count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Copies that are cut off, or have bytes flipped, zeroed, repeated or left out."""
    random = np.random.default_rng(seed)
    for i in range(count):
        place = int(random.integers(len(content)))
        # Headers are small, and most of what a reader believes stands there and at the end.
        if i % 3 == 1:
            place = int(random.integers(min(512, len(content))))
        elif i % 3 == 2:
            place = len(content) - 1 - int(random.integers(min(512, len(content))))
        kind = i % 5
        changed = bytearray(content)
        if kind == 0:
            yield f"cut at {place}", content[:place]
        elif kind == 1:
            changed[place] ^= 1 << int(random.integers(8))
            yield f"bit at {place}", bytes(changed)
        elif kind == 2:
            changed[place : place + 8] = random.bytes(len(changed[place : place + 8]))
            yield f"eight bytes at {place}", bytes(changed)
        elif kind == 3:
            changed[place : place + 4] = b"\xff" * len(changed[place : place + 4])
            yield f"ones at {place}", bytes(changed)
        else:
            yield f"left out from {place}", content[:place] + content[place + 16 :]
