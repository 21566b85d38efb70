#!/usr/bin/env python3
"""Puts pictures side by side and says how they differ.

Above: all pictures. Below: 4 × what each differs from the first of ours. Prints, over the pixels where either is not black:
mean |difference| × 255, the greatest one, the share of pixels off by more than 8/255; for each of ours and the first of ours,
and for each peer and the first of ours, and those of ours that are not like the first.
"""
import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

CAPTION = 24
AMPLIFIED = 4
# Mean |difference| × 255 up to which two of ours are one picture.
ALIKE = 0.5


def labelled(text):
    label, _, path = text.rpartition("=")
    return label, np.asarray(Image.open(path).convert("RGB")).astype(np.int32)


def difference(a, b):
    """Over the pixels where either shows something."""
    shown = (a.max(axis=2) > 0) | (b.max(axis=2) > 0)
    if not shown.any():
        return dict(mean=0.0, max=0, off=0.0, pixels=0)
    inside = np.abs(a - b)[shown]
    return dict(mean=round(float(inside.mean()), 3), max=int(inside.max()),
                off=round(float((inside.max(axis=1) > 8).mean()), 5), pixels=int(shown.sum()))


def captioned(text, picture):
    height, width, _ = picture.shape
    out = Image.new("RGB", (width, height + CAPTION))
    out.paste(Image.fromarray(picture.astype(np.uint8)), (0, CAPTION))
    ImageDraw.Draw(out).text((4, 4), text, fill=(200, 200, 200), font=ImageFont.load_default(16))
    return np.asarray(out)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="MONTAGE.png")
    parser.add_argument("--ours", type=labelled, nargs="+", required=True, metavar="LABEL=FILE")
    parser.add_argument("--peers", type=labelled, nargs="*", default=[], metavar="LABEL=FILE")
    args = parser.parse_args()
    first_label, first = args.ours[0]
    pictures = [*args.ours, *args.peers]
    above = [captioned(label, picture) for label, picture in pictures]
    below = [captioned(first_label if picture is first else f"{AMPLIFIED} x difference from {first_label}",
                       picture if picture is first else np.minimum(np.abs(picture - first) * AMPLIFIED, 255))
             for _, picture in pictures]
    montage = np.concatenate([np.concatenate(row, axis=1) for row in (above, below)])
    Image.fromarray(montage).save(args.out, optimize=True)
    found = []
    for label, picture in args.ours:
        among_ours = difference(picture, first)
        if picture is not first:
            found.append(dict(ours=label, other=first_label, **among_ours))
        if picture is first or among_ours["mean"] > ALIKE:
            found += [dict(ours=label, other=other, **difference(picture, theirs)) for other, theirs in args.peers]
    print(json.dumps(found))


if __name__ == "__main__":
    main()
