"""Writes pictures as JPEG, WebP and AVIF at many qualities: others.py FOLDER PICTURE.. (Pillow 11.3 or later).

For PICTURE.png there are PICTURE-30.jpg, PICTURE-30.webp and PICTURE-30.avif, the last with what it decodes to,
PICTURE-30.avif.png: what `splatweaver image bench --others FOLDER` reads.
"""
import os
import sys

from PIL import Image, ImageOps

QUALITIES = [1, 3, 7, 12, 20, 30, 42, 56, 70, 84]
KINDS = {
    "jpg": dict(format="JPEG", progressive=True, optimize=True, subsampling="4:2:0"),
    "webp": dict(format="WEBP", method=6),
    "avif": dict(format="AVIF", speed=4),
}

folder, *pictures = sys.argv[1:]
os.makedirs(folder, exist_ok=True)
for path in pictures:
    picture = ImageOps.exif_transpose(Image.open(path)).convert("RGB")
    stem = os.path.splitext(os.path.basename(path))[0]
    for kind, options in KINDS.items():
        for quality in QUALITIES:
            file = os.path.join(folder, f"{stem}-{quality}.{kind}")
            picture.save(file, quality=quality, **options)
            if kind == "avif":
                Image.open(file).convert("RGB").save(file + ".png", compress_level=1)
