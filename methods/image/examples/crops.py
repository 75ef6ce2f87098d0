"""Writes the pictures that docs/explain/pictures.md measures, from photos: crops.py FOLDER PHOTO.. (Pillow 11.3 or later).

Of PHOTO.jpg: PHOTO.png, all of it at one megapixel (2^20), and PHOTO-512.png, the middle 512 x 512 pixels of it at a longest side of 2048.
"""
import os
import sys

from PIL import Image, ImageOps

folder, *photos = sys.argv[1:]
os.makedirs(folder, exist_ok=True)
for path in photos:
    photo = ImageOps.exif_transpose(Image.open(path)).convert("RGB")
    stem = os.path.join(folder, os.path.splitext(os.path.basename(path))[0])
    width = round((2**20 * photo.width / photo.height) ** 0.5)
    photo.resize((width, round(2**20 / width)), Image.LANCZOS).save(stem + ".png")
    size = [round(side * 2048 / max(photo.size)) for side in photo.size]
    x, y = [(side - 512) // 2 for side in size]
    photo.resize(size, Image.LANCZOS).crop((x, y, x + 512, y + 512)).save(stem + "-512.png")
