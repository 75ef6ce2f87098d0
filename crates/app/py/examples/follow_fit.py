# %% [markdown]
# A fit that is followed by a callback, which plots the quality: python follow_fit.py, or cell by cell in a notebook.
#
# The curve is OUT/curve.svg, drawn anew while the fit goes on; no package for plots is needed.

# %%
import re
from pathlib import Path

import splatweaver

CAPTURE, OUT = "capture", "scene"


# %% A line through points, as SVG; the last value of a notebook's cell is shown.
class Curve(list):
    def _repr_svg_(self, width=640, height=320):
        steps, values = zip(*self)
        low, high = min(values), max(values)
        across = [width * step / max(steps) for step in steps]
        down = [height - height * (value - low) / max(high - low, 1e-9) for value in values]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(across, down))
        path = f'<polyline points="{line}" fill="none" stroke="black"/>'
        return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">{path}</svg>'


# %% The callback is told of each step; "21.34 dB, 5000 Gaussians" is its note. An answer of False would end the fit.
def follow(capture, out, **settings):
    curve = Curve()

    def watch(progress):
        psnr = re.match(r"([\d.]+) dB", progress.note)
        if progress.label == "fit" and psnr:
            curve.append((progress.done, float(psnr[1])))
            if progress.done % 20 == 0:
                Path(out, "curve.svg").write_text(curve._repr_svg_(), encoding="utf-8")

    run = splatweaver.fit(capture, out, callback=watch, **{"minutes": 1, **settings})
    print(f"{len(curve)} steps, {run.summary['train']['psnr']:.2f} dB, {len(run.scene)} Gaussians")
    return run, curve


# %%
if __name__ == "__main__":
    run, curve = follow(CAPTURE, OUT)
    curve
