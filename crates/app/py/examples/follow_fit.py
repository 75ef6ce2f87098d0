"""Fits a capture and draws the curve of its quality: python follow_fit.py CAPTURE OUT.

The curve goes to OUT/curve.svg, without any package for plots.
"""

import re
import sys
from pathlib import Path

import splatweaver


def curve(points, width=640, height=320):
    """A line through points, as SVG."""
    steps, values = zip(*points)
    low, high = min(values), max(values)
    across = [width * step / max(steps) for step in steps]
    down = [height - height * (value - low) / max(high - low, 1e-9) for value in values]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across, down))
    path = f'<polyline points="{line}" fill="none" stroke="black"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">{path}</svg>'


def main(capture, out, **settings):
    points = []

    def watch(progress):
        psnr = re.match(r"([\d.]+) dB", progress.note)
        if progress.label == "fit" and psnr:
            points.append((progress.done, float(psnr[1])))

    run = splatweaver.fit(capture, out, callback=watch, **{"minutes": 1, **settings})
    Path(out, "curve.svg").write_text(curve(points), encoding="utf-8")
    print(f"{len(points)} steps, {run.summary['train']['psnr']:.2f} dB, {len(run.scene)} Gaussians")
    return run


if __name__ == "__main__":
    main(*sys.argv[1:3])
