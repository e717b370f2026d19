#!/usr/bin/env python3
"""Puts pictures on one sheet, each under its name.

    python scripts/contact_sheet.py results/tasks/*.png --out results/tasks.png
"""

import argparse
import math
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# Pixels of a picture on the sheet, of the name over it, and how many stand side by side.
WIDTH, HEIGHT, TITLE = 240, 180, 22
COLUMNS = 5
DPI = 100


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="+", type=Path, metavar="PNG")
    parser.add_argument("--out", type=Path, required=True, help="picture to write")
    arguments = parser.parse_args()

    rows = math.ceil(len(arguments.pictures) / COLUMNS)
    size = (COLUMNS * WIDTH / DPI, rows * (HEIGHT + TITLE) / DPI)
    figure = plt.figure(figsize=size, dpi=DPI)
    for i, path in enumerate(arguments.pictures):
        try:
            picture = plt.imread(path)
        except (OSError, ValueError, SyntaxError) as error:
            sys.exit(f"{path}: not a readable picture: {error}")
        row, column = divmod(i, COLUMNS)
        bottom = (rows - 1 - row) * (HEIGHT + TITLE)
        left, height = column / COLUMNS, rows * (HEIGHT + TITLE)
        axes = figure.add_axes([left, bottom / height, 1 / COLUMNS, HEIGHT / height])
        axes.imshow(picture, aspect="auto", interpolation="antialiased")
        axes.set_axis_off()
        axes.set_title(path.stem, fontsize=8, pad=3)
    figure.savefig(arguments.out)


if __name__ == "__main__":
    main()
