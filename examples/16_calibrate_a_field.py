"""Four corners of a field tell where it lies before a camera; a marker on top of a robot is then where its robot is."""

import tempfile
from pathlib import Path

import numpy as np

from pieper.perception import field
from pieper.perception.calibration_file import load_view
from pieper.perception.camera import Camera

# A lens with barrel distortion, as `pieper calibrate-camera` finds it, and the pixels of the four corners of a field of 1.5 x 1.3 m.
matrix, distortion = (
    np.array([[620, 0, 324.0], [0, 625, 236], [0, 0, 1]]),
    np.array([-0.28, 0.09, 0.0008, -0.0005, -0.01]),
)
camera = Camera(matrix, distortion, (640, 480))
corners = [[-0.75, 0.65], [0.75, 0.65], [0.75, -0.65], [-0.75, -0.65]]
seen = [[107.7, 26.5], [564.4, 46.2], [542.0, 447.3], [89.5, 420.6]]

found = field.from_points(seen, corners, camera=camera, size=(1.5, 1.3))
print(found.report())

# A marker at 150 mm, seen at one pixel: taken for one on the floor it would be displaced.
pixel = [501.1, 123.8]
on_floor, on_robot = found.view.to_field(pixel), found.view.to_field(pixel, height=0.15)
print(f"marker    on the floor {np.round(on_floor * 1e3)} mm, on a robot of 150 mm {np.round(on_robot * 1e3)} mm")
print(f"parallax  {np.hypot(*(on_floor - on_robot)) * 1e3:.0f} mm")

# How well a pixel is known there becomes how well a place is known: J J^T.
J = found.view.jacobian(pixel, height=0.15)
print(f"one pixel is {np.sqrt(np.trace(J @ J.T) / 2) * 1e3:.1f} mm")

with tempfile.TemporaryDirectory() as folder:
    found.save(Path(folder) / "field.yaml", sources=["four corners"])
    again = load_view(Path(folder) / "field.yaml")
    print(f"read again: {np.round(again.to_field(pixel, height=0.15) * 1e3)} mm")
