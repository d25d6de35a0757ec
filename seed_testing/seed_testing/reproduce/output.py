# SPDX-License-Identifier: Apache-2.0
"""Tables and progress that the reproduced figures share."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from seed_core.files import shared_path


def shipped(name: str) -> Path:
    """A file of config/reproduce."""
    return shared_path("seed_testing", f"config/reproduce/{name}")


class Progress:
    """A line on the terminal per run: name, share, phase; told to `evaluate.run`."""

    def __init__(self, name: str) -> None:
        self._name, self._began, self._last = name, time.monotonic(), 0.0

    def __call__(self, share: float, phase: str) -> None:
        now = time.monotonic()
        if sys.stderr.isatty() and now - self._last > 0.2:
            self._last = now
            print(f"\r{self._name}: {100 * share:3.0f} %  {phase:30s}", end="", file=sys.stderr, flush=True)

    def done(self) -> None:
        """End the line."""
        lead = "\r" if sys.stderr.isatty() else ""
        took = time.monotonic() - self._began
        print(f"{lead}{self._name}: done in {took:.0f} s{' ' * 30}", file=sys.stderr, flush=True)


def table(header: list[str], rows: list[list[str]]) -> str:
    """Aligned text, first column left, the others right."""
    widths = [max(len(r[i]) for r in [header, *rows]) for i in range(len(header))]
    lines = [
        "  ".join(c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(r, widths, strict=True)))
        for r in [header, *rows]
    ]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])


def write(folder: Path, name: str, text: str, values: Any) -> list[Path]:
    """name.txt with the table and name.json with the numbers."""
    files = [folder / f"{name}.txt", folder / f"{name}.json"]
    files[0].write_text(text + "\n", encoding="utf-8")
    files[1].write_text(json.dumps(_plain(values), indent=2) + "\n", encoding="utf-8")
    return files


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if hasattr(value, "item") else value
