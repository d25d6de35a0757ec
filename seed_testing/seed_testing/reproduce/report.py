# SPDX-License-Identifier: Apache-2.0
"""Text tables and files of the reproduced figures."""

from pathlib import Path
from typing import Any

from seed_core.program.command_line import to_json


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
    files = {folder / f"{name}.txt": text, folder / f"{name}.json": to_json(values, indent=2)}
    for file, content in files.items():
        file.write_text(content + "\n", encoding="utf-8")
    return list(files)
