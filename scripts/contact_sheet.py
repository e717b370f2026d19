#!/usr/bin/env python3
"""Puts pictures on one sheet, each under its name.

    python scripts/contact_sheet.py results/tasks/*.png --out results/tasks.png
"""

import argparse
import sys
from pathlib import Path

from PIL import Image, ImageDraw, UnidentifiedImageError

# Pixels of a picture on the sheet and of the name over it, and how many stand side by side.
SIZE = (200, 150)
NAME = 16
COLUMNS = 5


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="+", type=Path, metavar="PNG")
    parser.add_argument("--out", type=Path, required=True, help="picture to write")
    arguments = parser.parse_args()

    (width, height), rows = SIZE, -(-len(arguments.pictures) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * width, rows * (height + NAME)), "white")
    draw = ImageDraw.Draw(sheet)
    for i, path in enumerate(arguments.pictures):
        row, column = divmod(i, COLUMNS)
        left, top = column * width, row * (height + NAME)
        try:
            picture = Image.open(path).convert("RGB").resize(SIZE, Image.Resampling.LANCZOS)
        except (OSError, UnidentifiedImageError) as error:
            sys.exit(f"{path}: not a readable picture: {error}")
        draw.text((left + width / 2, top + NAME / 2), path.stem, fill="black", anchor="mm")
        sheet.paste(picture, (left, top + NAME))
    sheet.save(arguments.out, optimize=True)


if __name__ == "__main__":
    main()
