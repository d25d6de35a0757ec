# SPDX-License-Identifier: Apache-2.0
"""The pictures of the documents that are PNGs: python -m seed_bringup.pictures docs/images [NAME ...]"""

from pathlib import Path

from seed_bringup.pictures import concepts, drawing, gallery, gel, grip, insertion, surface, tutorial
from seed_core.program.command_line import Parser

PICTURES = {
    "frames": drawing.frames_drawing,
    "bubble": drawing.bubble_drawing,
    "series_elastic": concepts.series_elastic,
    "chain": concepts.chain,
    "wipes": gallery.wipes,
    "writes": gallery.writes,
    "fits": gallery.fits,
    "inserts": insertion.inserts,
    "follows": surface.follows,
    "sees": gallery.sees,
    "holds": gallery.holds,
    "deforms": gallery.deforms,
    "gel": gel.gel_images,
    "answers_slip": grip.answers_slip,
    "first_wipe": tutorial.first_wipe,
    "triangle": tutorial.triangle,
}


def main(argv: list[str] | None = None) -> None:
    """Write those that are named, or all."""
    parser = Parser(description="Draw the pictures of the documents.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(PICTURES)}; default: all")
    options = parser.parse_args(argv)
    if unknown := sorted(set(options.names) - set(PICTURES)):
        parser.error(f"unknown: {', '.join(unknown)}; known: {', '.join(PICTURES)}")
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in options.names or PICTURES:
        (options.folder / f"{name}.png").write_bytes(PICTURES[name]())


if __name__ == "__main__":
    main()
