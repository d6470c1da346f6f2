# SPDX-License-Identifier: Apache-2.0
"""The stages as functions: load what a run made, and make it again from the images to the traits on arrays.

python examples/python_api.py plant_017

A notebook would have these parts as cells. docs/python.md lists all functions; help(cotton3dg.lift) explains one.
"""

import json
import sys

import numpy as np

import cotton3dg as c3d

# A plant's folder: run what is stale, as `cotton3dg run` does, and read what stands there.
plant = c3d.measure(sys.argv[1]).plant
cameras = c3d.read_cameras(plant.undistorted / "sparse")
points, colours, *_ = c3d.read_points(plant.undistorted / "sparse")
photos = [c3d.read_image(plant.undistorted_image(camera.name)) for camera in cameras]
gaussians = c3d.read_gaussians(plant.gaussians_ply)
pixel_su = json.loads(plant.metrics_json.read_text())["pixel_su"]
print(f"{len(cameras)} cameras, {len(points)} points, {len(gaussians)} Gaussians")

# train: 50 steps on small images, and how like a photo the render is.
options = c3d.resolve("train", {"steps": 50, "max_gaussians": 5000})
views = [c3d.View(camera, photo).limited(160) for camera, photo in zip(cameras, photos, strict=True)]
quick = c3d.fit(c3d.start_gaussians(points, colours, views, options), views, options).gaussians
for name, model in ("50 steps", quick), ("saved model", gaussians):
    image = np.rint(255 * np.clip(c3d.render(model, views[0].camera).image, 0, 1)).astype(np.uint8)
    print(f"{name}: {c3d.psnr_db(image, views[0].image):.1f} dB")

# masks: what the network that comes with the program says of 36 views around the plant.
orbit = c3d.fit_orbit(cameras)
chosen = [int(i) for i in c3d.evenly_spaced(c3d.azimuths(cameras, orbit), 36)]
seen = [cameras[i] for i in chosen]
network = c3d.open_bolls()
maps = [network.maps(photos[i]) for i in chosen]

# segment: how much each Gaussian is lint. docs/python.md has the functions for masks of another source.
inside = c3d.within_orbit(gaussians.means, cameras, orbit)
shares = c3d.gather_lint(maps, seen, gaussians, inside)

# scale: the table top, 120 x 60 cm.
surfaces = np.concatenate([points, gaussians.means[gaussians.opacities > 0.5]])
table = c3d.find_table(surfaces, cameras, [photos[i] for i in chosen], seen, tracks=points, aspect=120 / 60)
scale = c3d.scale_from_table(table, 120, 60) if isinstance(table, c3d.TableFit) else None

# cluster: votes of all views that meet in space.
bolls = c3d.locate_bolls(maps, seen, gaussians, shares, orbit.axis, scale.cm_per_su if scale else None).bolls

# traits: without a scale, all but the count is NaN.
is_boll = c3d.boll_labels(bolls, len(gaussians)) > 0
body = c3d.isolate_plant(gaussians, scale, 4.0, is_boll) if scale else None
drawn = c3d.dilate_gaussians(gaussians, pixel_su)
measured = c3d.measure_bolls(drawn, bolls, scale, body.foot if body else None, pixel_su)
silhouette = c3d.measure_silhouette(drawn, body, scale) if body and scale else None
traits = c3d.summarise_plant(measured, silhouette, scale, pixel_su)
print(f"{traits.boll_count} bolls of {traits.boll_volume_cm3:.0f} cm3, {traits.plant_height_cm:.1f} cm high")
