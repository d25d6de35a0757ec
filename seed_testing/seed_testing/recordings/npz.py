# SPDX-License-Identifier: Apache-2.0
"""Reads the arrays of a recording."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from seed_core.errors import SeedError


def read_arrays(
    path: Path, names: Sequence[str], what: str, problem: str, most_bytes: int
) -> list[NDArray[np.generic]]:
    """The named arrays of an npz file.

    Raises:
        SeedError: The file is larger than `most_bytes`, told with `what` it is of; or it is none, or lacks an array,
            told with `problem`.
    """
    try:
        size = path.stat().st_size
        if size > most_bytes:
            raise SeedError(f"{path}: {size} bytes are too many for {what} (at most {most_bytes})")
        with np.load(path, allow_pickle=False) as data:
            return [np.asarray(data[name]) for name in names]
    except SeedError:
        raise
    except Exception as error:  # zip, zlib and NumPy raise a dozen kinds of errors for a damaged file
        raise SeedError(f"{path}: {problem}: {error}") from error
