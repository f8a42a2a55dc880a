"""Colours of markers: learn them from boxes, and find them while the light falls, with and without following it."""

import numpy as np

from pieper.perception.adapt import LightAdaptation
from pieper.perception.color_learning import learn
from pieper.perception.color_regions import Region
from pieper.perception.frame import Frame
from pieper.perception.segment import segment

# A green field with three discs of 11 px radius; blue, green, red of their paint.
PAINT = {"red": (45, 40, 205), "blue": (205, 90, 25), "green": (95, 225, 60)}
PLACES = {"red": (30, 30), "blue": (90, 50), "green": (150, 30)}


def picture(light: float, cast: float, number: int) -> Frame:
    """The field under a light, with red stronger and blue weaker by a cast, and some noise."""
    image = np.full((80, 180, 3), (62.0, 104.0, 46.0))
    v, u = np.mgrid[:80, :180]
    for name, (x, y) in PLACES.items():
        image[(u - x) ** 2 + (v - y) ** 2 <= 11**2] = PAINT[name]
    image *= light * np.array([1 - cast, 1.0, 1 + cast])
    image += np.random.default_rng(number).normal(0.0, 3.0, image.shape)
    return Frame(np.clip(np.rint(image), 0, 255).astype(np.uint8), number, number / 10)


# 1. A box inside each marker of the first frame.
boxes = [Region(name, 0, x - 6, y - 6, 13, 13) for name, (x, y) in PLACES.items()]
learned = learn(lambda number: picture(1.0, 0.0, number).image, boxes)
model = learned.model
print(f"learned {', '.join(model.names)}; Mahalanobis distance up to {model.threshold:g}: {model.share_inside:.2%}")
for pair, apart in model.notes["validation"]["separation"].items():
    print(f"{pair}: {apart:.1f} apart")

# 2. In ten seconds the light falls to 0.4 and takes on a cast of 15 %.
following, fixed = LightAdaptation(model), LightAdaptation(model, enabled=False)
found = {"following": 0, "fixed": 0}
frames = [picture(1.0 - 0.6 * k / 99, 0.15 * k / 99, k) for k in range(100)]
for frame in frames:
    for name, light in (("following", following), ("fixed", fixed)):
        blobs = segment(frame.image, light.table, min_area=100)
        found[name] += len(set(blobs.color.tolist()))
        light.update(frame, blobs)  # a tracker would pass those of its confirmed tracks

# 3. What came of it.
for name, count in found.items():
    print(f"{name}: {count / (3 * len(frames)):.1%} of the markers found")
print(following.summary())
