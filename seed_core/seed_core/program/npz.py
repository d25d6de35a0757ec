# SPDX-License-Identifier: Apache-2.0
"""Arrays from npz files, and into them."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seed_core.errors import SeedError
from seed_core.program.files import written_whole

MAX_BYTES = 2_000_000_000


def read_npz(
    path: Path, problem: str, most_bytes: int = MAX_BYTES, names: Collection[str] = ()
) -> dict[str, NDArray[Any]]:
    """The named arrays of an npz file, or all.

    Raises:
        SeedError: it is larger than `most_bytes`; or it is none, is damaged or lacks an array, told with `problem`.
    """
    try:
        if not path.is_file():
            raise SeedError(f"{path}: there is no such file")
        size = path.stat().st_size
        if size > most_bytes:
            raise SeedError(f"{path}: {size} bytes are too many (at most {most_bytes})")
        with np.load(path, allow_pickle=False) as data:
            return {name: np.asarray(data[name]) for name in names or data.files}
    except SeedError:
        raise
    except Exception as error:  # zip, zlib and NumPy raise a dozen kinds of errors for a damaged file
        raise SeedError(f"{path}: {problem}: {error}") from error


def write_npz(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write named arrays, compressed, whole or not at all; read_npz reads them. Raises OSError."""
    with written_whole(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **arrays)
