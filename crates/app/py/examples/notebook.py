# %% [markdown]
# A scene in a notebook. Open this file in VS Code or Jupyter (with jupytext), beside the folder `scene` of
# `splatweaver.reconstruct("photos", "scene")`.

# %%
import splatweaver

run = splatweaver.open_run("scene")
scene, cameras = run.scene, run.cameras
print(scene, cameras)

# %% Turn it and fly through; the last line of a cell is shown.
view = scene.show(cameras)
view

# %% What is near the middle of the scene, without its harmonics, as a file of its own.
middle = scene.means.mean(0)
near = scene.crop(center=middle.tolist(), radius=float(scene.means.std())).to(degree=0)
near.save("near.spz")
print(near)

# %% A picture as an array.
picture = scene.render(cameras[0])
print(picture.shape, picture.mean())
